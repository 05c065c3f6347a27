"""Scores against numbers worked out by hand, and the interval against its own promise."""

import numpy as np
import pytest

from sim.prediction.free_runs import nrmse, nrmse_interval, scaled_squares, scores


def test_scores_by_hand():
    measured = np.zeros((4, 6))
    measured[:, 3] = [1.0, 2.0, 3.0, 4.0]  # sum of squares about the mean: 5
    error = np.zeros((4, 6))
    error[:, 3] = [1.0, -1.0, 1.0, 0.0]
    found = scores(measured, error)
    assert found.rmse["u"] == pytest.approx(np.sqrt(0.75))
    assert found.mae["u"] == pytest.approx(0.75)
    assert found.r2["u"] == pytest.approx(1.0 - 3.0 / 5.0)
    assert found.fit_percent["u"] == pytest.approx(100.0 * (1.0 - np.sqrt(3.0 / 5.0)))
    assert found.rmse["psi"] == 0.0
    assert "psi" not in found.r2  # never moved: R² has no value


def test_nrmse_weighs_each_channel_by_its_scale():
    error = np.zeros((10, 6))
    error[:, 3:] = [0.3, 0.0, 0.02]
    assert nrmse(error, np.array([0.3, 0.05, 0.02])) == pytest.approx(np.sqrt(2.0 / 3.0))


@pytest.mark.slow
def test_the_interval_covers_the_truth_for_correlated_errors():
    """Errors that last 5 s: intervals from samples would cover next to nothing."""
    rng = np.random.default_rng(7)
    dt, keep = 0.2, np.exp(-0.2 / 5.0)
    covered, count = 0, 150
    for _ in range(count):
        e = np.empty((3000, 6))
        e[0] = rng.normal(size=6)
        noise = rng.normal(size=e.shape) * np.sqrt(1.0 - keep**2)
        for k in range(1, len(e)):
            e[k] = keep * e[k - 1] + noise[k]
        block = (dt * np.arange(len(e)) // 30.0).astype(np.int64)
        low, high = nrmse_interval(scaled_squares(e, np.ones(3)), block, seed=1)
        covered += low <= 1.0 <= high
    assert 0.88 <= covered / count <= 0.99


def test_the_interval_is_seeded_and_needs_two_blocks():
    squares = np.random.default_rng(1).random(100)
    block = np.arange(100) // 10
    assert nrmse_interval(squares, block, 3) == nrmse_interval(squares, block, 3)
    assert nrmse_interval(squares, np.zeros(100, np.int64), 3) is None
