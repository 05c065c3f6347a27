"""Stretches that a user leaves out."""

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.offline.usable_time import (
    Exclusion,
    exclude_stretches,
    parse_exclusions,
)
from tests.sim.voyages import WAM_V, simulated


@pytest.mark.parametrize(
    ("text", "means"),
    [
        ("10:20", Exclusion(10.0, 20.0)),
        (":20", Exclusion(0.0, 20.0)),
        ("10:", Exclusion(10.0, np.inf)),
        ("voyage:10:20", Exclusion(10.0, 20.0, "voyage")),
        ("a:b #2:1.5:2", Exclusion(1.5, 2.0, "a:b #2")),
    ],
)
def test_what_a_command_line_says(text, means):
    assert parse_exclusions([text]) == (means,)


@pytest.mark.parametrize("text", ["", "10", "20:10", "ten:20", "voyage:10:ten", "5:5"])
def test_nonsense_is_one_line(text):
    with pytest.raises(BadInput, match="expected FROM:TO"):
        parse_exclusions([text])


def test_only_the_stretch_is_left_out_and_it_is_told():
    trial = simulated(WAM_V, 60.0)
    (cut,) = exclude_stretches([trial], parse_exclusions(["10:20", "voyage:50:"]))
    out = (trial.time >= 10.0) & (trial.time < 20.0) | (trial.time >= 50.0)
    np.testing.assert_array_equal(cut.usable, trial.usable & ~out)
    assert [(s.start, s.why) for s in cut.excluded] == [
        (10.0, "left out by --exclude"),
        (50.0, "left out by --exclude"),
    ]


def test_a_stretch_behind_the_end_leaves_nothing_out():
    trial = simulated(WAM_V, 60.0)
    (cut,) = exclude_stretches([trial], parse_exclusions(["5000:6000"]))
    np.testing.assert_array_equal(cut.usable, trial.usable)
    assert cut.excluded == trial.excluded


def test_a_recording_that_is_not_there_is_named():
    with pytest.raises(BadInput, match="no recording 'other'"):
        exclude_stretches([simulated(WAM_V, 30.0)], parse_exclusions(["other:1:2"]))
