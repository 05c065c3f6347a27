"""Identification by free runs, and channels that nothing confirms."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification.identify import identify
from sim.identification.settings import IdentifySettings
from sim.identification.validation import is_confirmed, unconfirmed_channels
from tests.sim.identification.boats import noisy, off
from tests.sim.vessels import WAMV

ALONE = IdentifySettings(method="simulation")


@pytest.fixture(scope="module")
def found():
    return identify([noisy(WAMV, 250.0, 1)], off(WAMV), ALONE, [noisy(WAMV, 60.0, 9)])


def test_the_numbers_are_found_by_free_runs(found):
    for e in found.estimates:
        if e.name in ("m11", "m22", "m33", "X_uu", "N_r"):
            assert e.value == pytest.approx(getattr(WAMV.dynamics, e.name), rel=0.08)
    held = [e.ci95[0] <= getattr(WAMV.dynamics, e.name) <= e.ci95[1] for e in found.estimates]
    assert sum(held) >= 7


def test_a_free_run_on_another_voyage_is_better(found):
    (judged,) = found.validation
    before, after = judged.before.free_run.scores.rmse, judged.after.free_run.scores.rmse
    assert after["u"] < 0.7 * before["u"]


def test_what_a_voyage_confirms_is_not_called_untold(found):
    assert unconfirmed_channels(found.validation) == ()


def test_a_channel_no_better_than_zero_is_called_not_identifiable(found):
    (judged,) = found.validation
    run = judged.after.free_run
    rng = np.random.default_rng(1)
    wrong = run.error.copy()
    wrong[:, 4] = rng.normal(0.0, 0.2, len(wrong)) - run.model[:, 4]
    poor = replace(run, error=wrong)
    after = replace(judged, after=replace(judged.after, free_run=poor))
    (says,) = unconfirmed_channels([after])
    assert says.startswith("sway is not identifiable from these data")
    assert unconfirmed_channels([after, judged]) == ()  # one recording that confirms is enough


def test_a_channel_that_never_moved_tells_nothing(found):
    run = found.validation[0].after.free_run
    still = replace(run, model=run.model * 0.0, error=run.error * 0.0)
    assert is_confirmed(still, "v") is None
