"""Identification by free runs, and channels that nothing confirms."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification import IdentifySettings
from sim.identification.identify import identify, is_confirmed, unconfirmed_channels
from tests.sim.identification.noisy_trials import noisy, off
from tests.sim.vessels import WAMV

OUTPUT_ERROR = IdentifySettings(method="simulation")


@pytest.fixture(scope="module")
def fit():
    return identify([noisy(WAMV, 250.0, 1)], off(WAMV), OUTPUT_ERROR, [noisy(WAMV, 60.0, 9)])


def test_the_numbers_are_found_by_free_runs(fit):
    for e in fit.estimates:
        if e.name in ("m11", "m22", "m33", "X_uu", "N_r"):
            assert e.value == pytest.approx(getattr(WAMV.dynamics, e.name), rel=0.08)
    inside = [e.ci95[0] <= getattr(WAMV.dynamics, e.name) <= e.ci95[1] for e in fit.estimates]
    assert sum(inside) >= 7


def test_a_free_run_on_another_voyage_is_better(fit):
    (judged,) = fit.validation
    before, after = judged.before.free_run.scores.rmse, judged.after.free_run.scores.rmse
    assert after["u"] < 0.7 * before["u"]


def test_a_channel_that_a_voyage_confirms_is_not_listed(fit):
    assert unconfirmed_channels(fit.validation) == ()


def test_a_channel_no_better_than_zero_is_called_not_identifiable(fit):
    (judged,) = fit.validation
    run = judged.after.free_run
    rng = np.random.default_rng(1)
    wrong = run.error.copy()
    wrong[:, 4] = rng.normal(0.0, 0.2, len(wrong)) - run.model[:, 4]
    poor = replace(run, error=wrong)
    after = replace(judged, after=replace(judged.after, free_run=poor))
    (sentence,) = unconfirmed_channels([after])
    assert sentence.startswith("sway is not identifiable from these data")
    assert unconfirmed_channels([after, judged]) == ()  # one recording that confirms is enough


def test_a_channel_that_never_moved_tells_nothing(fit):
    run = fit.validation[0].after.free_run
    still = replace(run, model=run.model * 0.0, error=run.error * 0.0)
    assert is_confirmed(still, "v") is None
