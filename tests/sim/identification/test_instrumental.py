"""Instrumental variables on motion by physics that shares no code with the models; cross-check."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.steady_current import EFFECT as CURRENT
from sim.identification import BASE
from sim.identification.estimators import cross_check_by_instruments, fit_by_instruments
from sim.identification.intervals import Estimate
from sim.identification.regression import fit_by_regression
from sim.model import Model
from sim.prediction.segments import NoUsableTimeError
from sim.vessel import AddedEffect
from tests.sim.identification.noisy_trials import noisy, off, wander
from tests.sim.vessels import WAMV
from tests.sim.voyages import WAM_V, trial_of, voyage

DT = 0.1
TRUTH = np.array([getattr(WAM_V.dynamics, name) for name in BASE])


def measured(seed: int, noise: float = 1.0, seconds: float = 500.0):
    """Motion with errors that wander; accelerations are the change of the velocities."""
    eta, nu, nu_dot, drive = voyage(seconds, DT, seed)
    rng = np.random.default_rng(seed)
    sizes = ((0.03, 1.0), (0.03, 1.0), (0.01, 1.0))
    nu = nu + noise * np.stack([wander(*size, len(nu), rng) for size in sizes], axis=1)
    if noise:
        nu_dot = np.gradient(nu, DT, axis=0)
    return trial_of(eta, nu, nu_dot, drive, DT, np.eye(9))


@pytest.fixture(scope="module")
def fits():
    trials = [measured(seed) for seed in range(8)]
    start = Model.of(off(WAM_V))
    return (
        [fit_by_instruments([trial], start) for trial in trials],
        [fit_by_regression([trial], start) for trial in trials],
    )


def share(many):
    """Mean relative error of the nine, and its standard error."""
    error = np.array([one.value for one in many]) / TRUTH - 1.0
    return error.mean(axis=0), error.std(axis=0, ddof=1) / np.sqrt(len(many))


@pytest.mark.slow
def test_noise_does_not_bias_where_it_biases_least_squares(fits):
    by_instruments, by_squares = fits
    bias, chance = share(by_instruments)
    assert np.all(np.abs(bias) < np.maximum(3.5 * chance, 0.01))
    pulled, chance = share(by_squares)
    assert np.all(np.abs(pulled[:2]) > 3.5 * chance[:2])  # the masses, by a fifth
    assert np.all(np.abs(pulled[:2]) > 5.0 * np.abs(bias[:2]))


def test_intervals_hold(fits):
    inside = [(one.low <= TRUTH) & (TRUTH <= one.high) for one in fits[0]]
    assert np.mean(inside) > 0.85


def test_without_noise_it_finds_the_truth_from_a_careless_file():
    one = fit_by_instruments([measured(3, noise=0.0)], Model.of(off(WAM_V)))
    np.testing.assert_allclose(one.value, TRUTH, rtol=0.02)


def test_too_little_time_is_refused():
    with pytest.raises(NoUsableTimeError, match="three blocks"):
        fit_by_instruments([measured(1, seconds=9.0)], Model.of(WAM_V))


@pytest.fixture(scope="module")
def long_trial():
    return noisy(WAMV, 300.0, seed=1)


def estimates(**shares):
    """Estimates 2 % wide around the truth, some of them off by a share."""
    out = []
    for name in BASE:
        truth = getattr(WAMV.dynamics, name)
        value = truth * (1.0 + shares.get(name, 0.0))
        half = 0.02 * abs(truth)
        out.append(Estimate(name, "SI", truth, value, (value - half, value + half), True))
    return out


def test_the_cross_check_is_silent_where_both_agree(long_trial):
    assert cross_check_by_instruments([long_trial], Model.of(WAMV), estimates()) == ()


def test_a_mass_that_is_far_off_is_named_with_where_to_look(long_trial):
    (sentence,) = cross_check_by_instruments([long_trial], Model.of(WAMV), estimates(m11=0.3))
    assert sentence.startswith("m11: instrumental variables say")
    assert "thruster_lag" in sentence


def test_what_the_data_do_not_determine_is_not_compared(long_trial):
    vague = [replace(e, identifiable=False) for e in estimates(m11=0.3)]
    assert cross_check_by_instruments([long_trial], Model.of(WAMV), vague) == ()


def test_a_vessel_with_effects_is_not_compared(long_trial):
    moving = WAMV.with_effects(AddedEffect(CURRENT, {"speed": 0.2, "direction": 0.0}))
    assert cross_check_by_instruments([long_trial], Model.of(moving), estimates(m11=0.3)) == ()
