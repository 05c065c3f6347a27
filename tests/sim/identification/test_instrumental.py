"""Instrumental variables on voyages by physics that shares no code with the models."""

import numpy as np
import pytest

from sim.identification.instrumental import instrumental
from sim.identification.regression import fit_by_regression
from sim.identification.settings import BASE
from sim.model import Model
from sim.prediction.segments import NoUsableTimeError
from tests.sim.identification.boats import off, wander
from tests.sim.voyages import WAM_V, trial_of, voyage

DT = 0.1
TRUTH = np.array([getattr(WAM_V.dynamics, name) for name in BASE])


def measured(seed: int, noise: float = 1.0, seconds: float = 500.0):
    """What wandering sensors say; accelerations are the change of the velocities."""
    eta, nu, nu_dot, drive = voyage(seconds, DT, seed)
    rng = np.random.default_rng(seed)
    sizes = ((0.03, 1.0), (0.03, 1.0), (0.01, 1.0))
    nu = nu + noise * np.stack([wander(*size, len(nu), rng) for size in sizes], axis=1)
    if noise:
        nu_dot = np.gradient(nu, DT, axis=0)
    return trial_of(eta, nu, nu_dot, drive, DT, np.eye(9))


@pytest.fixture(scope="module")
def found():
    trials = [measured(seed) for seed in range(8)]
    start = Model.of(off(WAM_V))
    return (
        [instrumental([trial], start) for trial in trials],
        [fit_by_regression([trial], start) for trial in trials],
    )


def share(many):
    """Mean error of the nine in shares of the truth, and what chance may make of it."""
    error = np.array([one.value for one in many]) / TRUTH - 1.0
    return error.mean(axis=0), error.std(axis=0, ddof=1) / np.sqrt(len(many))


def test_noise_does_not_pull_where_it_pulls_least_squares(found):
    by_instruments, by_squares = found
    bias, chance = share(by_instruments)
    assert np.all(np.abs(bias) < np.maximum(3.5 * chance, 0.01))
    pulled, chance = share(by_squares)
    assert np.all(np.abs(pulled[:2]) > 3.5 * chance[:2])  # the masses, by a fifth
    assert np.all(np.abs(pulled[:2]) > 5.0 * np.abs(bias[:2]))


def test_intervals_hold(found):
    inside = [(one.low <= TRUTH) & (TRUTH <= one.high) for one in found[0]]
    assert np.mean(inside) > 0.85


def test_without_noise_it_finds_the_truth_from_a_careless_file():
    one = instrumental([measured(3, noise=0.0)], Model.of(off(WAM_V)))
    np.testing.assert_allclose(one.value, TRUTH, rtol=0.02)


def test_too_little_time_is_refused():
    with pytest.raises(NoUsableTimeError, match="three blocks"):
        instrumental([measured(1, seconds=9.0)], Model.of(WAM_V))
