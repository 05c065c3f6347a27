"""The stated covariance is true: normalised errors (NEES) over many voyages of known truth."""

import numpy as np
import pytest
from scipy.stats import chi2

from gateway.estimation import FilterSettings, State
from gateway.estimation.filter import Estimator
from gateway.estimation.smoother import smooth
from tests.gateway.estimation.boat import singer_boat, telemetry, weaving_boat

RUNS = 30
MOMENT = 9.0  # s into a voyage of 12 s
VELOCITY = [State.U, State.V, State.R]
# Matched: what the filter assumes is exactly so. The gyro's delay is an approximation in it.
MATCHED = FilterSettings(gyro_delay_s=0.0)


def wrapped(error):
    error = error.copy()
    error[..., State.YAW] = (error[..., State.YAW] + np.pi) % (2 * np.pi) - np.pi
    return error


def nees(error, covariance, part):
    """(K, 9), (K, 9, 9) -> (K,) over the components of a part."""
    e, P = error[:, part], covariance[:, part][:, :, part]
    return np.einsum("ki,ki->k", e, np.linalg.solve(P, e[..., None])[..., 0])


@pytest.fixture(scope="module")
def errors():
    """Error and covariance at one moment of each voyage, of the filter and of the smoother."""
    found = {"filter": ([], []), "smoother": ([], [])}
    estimator = Estimator(MATCHED)
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        truth = singer_boat(rng, 12.0, MATCHED)
        events = telemetry(rng, truth, MATCHED)
        _, rows = estimator.advance(estimator.start(), events, covariance=True)
        row = np.searchsorted(rows.time_s, MOMENT, side="right") - 1
        now = truth.at(rows.time_s[[row]])[0]
        found["filter"][0].append(wrapped(rows.motion[row] - now))
        found["filter"][1].append(rows.covariance[row])
        whole = smooth(events, np.array([MOMENT]), MATCHED)
        motion = np.hstack([whole.eta, whole.nu, whole.nu_dot])[0]
        found["smoother"][0].append(wrapped(motion - truth.at(np.array([MOMENT]))[0]))
        found["smoother"][1].append(whole.covariance[0])
    return {name: (np.array(e), np.array(P)) for name, (e, P) in found.items()}


@pytest.mark.parametrize("which", ["filter", "smoother"])
@pytest.mark.parametrize("part", [VELOCITY, list(range(9))], ids=["u,v,r", "motion"])
def test_nees_lies_in_its_95_percent_band(errors, which, part):
    mean = nees(*errors[which], part).mean()
    low, high = chi2.ppf([0.025, 0.975], RUNS * len(part)) / RUNS
    assert low < mean < high


def test_nis_is_one_per_component():
    rng = np.random.default_rng(0)
    truth = singer_boat(rng, 120.0, MATCHED)
    estimator = Estimator(MATCHED)
    _, rows = estimator.advance(estimator.start(), telemetry(rng, truth, MATCHED))
    for components in (1, 2):
        mine = rows.used == components
        assert rows.nis[mine].mean() == pytest.approx(components, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("attitude_hz", "position_hz"), [(50.0, 25.0), (10.0, 3.0)])
def test_on_a_smooth_course_with_a_slow_gyro_nothing_is_claimed_too_good(attitude_hz, position_hz):
    settings = FilterSettings()
    values = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        truth = weaving_boat(rng, 40.0)
        events = telemetry(rng, truth, settings, attitude_hz, position_hz)
        grid = np.array([10.0, 20.0, 30.0])
        whole = smooth(events, grid, settings)
        error = wrapped(np.hstack([whole.eta, whole.nu, whole.nu_dot]) - truth.at(grid))
        values.append(nees(error, whole.covariance, VELOCITY).mean())
    assert np.mean(values) < chi2.ppf(0.975, 12 * 3) / 12


def test_accelerations_are_good_enough_to_identify_from():
    settings = FilterSettings()
    rng = np.random.default_rng(5)
    truth = weaving_boat(rng, 120.0)
    grid = np.arange(5.0, 115.0, 0.1)
    whole = smooth(telemetry(rng, truth, settings), grid, settings)
    true = truth.at(grid)[:, State.U_DOT :]
    share = np.sqrt(np.mean((whole.nu_dot - true) ** 2, axis=0)) / true.std(axis=0)
    assert share[0] < 0.3
    assert share[2] < 0.4
    estimator = Estimator(settings)
    _, rows = estimator.advance(estimator.start(), telemetry(rng, truth, settings))
    stated = np.sqrt(whole.covariance[:, State.U, State.U]).mean()
    assert stated < rows.std[len(rows) // 2 :, State.U].mean()
