"""Blocks held out: is what the fit sees free of them, although one smoother saw both sides?"""

from dataclasses import replace

import numpy as np

from gateway.ingest.open import open_log
from gateway.offline.trials import TrialOptions, source_of
from sim.identification.validation import held_out
from tests.conftest import ROOT

LOG = ROOT / "recordings" / "voyage_1.tlog"


def test_beyond_the_guard_held_out_data_move_the_motion_by_3_percent_of_its_error():
    """So that a fit moves by 3 % of its standard deviation: smoothing twice would gain nothing."""
    options = TrialOptions()
    source = source_of(open_log(LOG), None, options)
    (span,) = source.spans()
    whole = source.trial("whole", span, options)
    cut = held_out(whole)
    assert cut is not None
    fit, judge = cut
    row = np.floor((source.events.time_s - span[0]) / whole.dt).astype(int)
    inside = (row >= 0) & (row < len(whole))
    kept = ~(inside & judge[np.clip(row, 0, len(whole) - 1)])
    alone = replace(source, events=source.events[kept]).trial("alone", span, options)
    std = whole.std()[:, 3:6]
    judged = np.sqrt(np.mean((alone.nu - whole.nu)[judge] ** 2 / std[judge] ** 2, axis=0))
    moved = np.sqrt(np.mean((alone.nu - whole.nu)[fit] ** 2 / std[fit] ** 2, axis=0))
    assert np.all(judged > 1.0)  # they are really left out
    assert np.all(moved < 0.03)
