"""Error in numbers, per channel and as one: RMSE, MAE, R², fit per cent, nrmse and its interval.

    R² = 1 − Σe²/Σ(y − ȳ)²      fit = 100 (1 − √(Σe²/Σ(y − ȳ)²))
    nrmse = √( mean over u, v, r of (RMSE_i / scale_i)² )

R² and fit are MATLAB's; all sums run over the predicted rows of all segments.

The interval of an nrmse is a bootstrap over blocks of time, never over samples: errors within a
segment, and of segments that overlap, are not independent. Whole blocks are drawn with replacement;
the interval holds the middle 95 % of the nrmse of the draws, widened by √(n/(n − 1)) for the few
blocks there are.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.state import Floats, Ints

BOOTSTRAP_DRAWS = 2000
COLUMN = {"u": 3, "v": 4, "r": 5, "x": 0, "y": 1, "psi": 2}  # of (eta, nu); x north, y east


@dataclass(frozen=True)
class Scores:
    """Errors by channel [m/s, rad/s, m, rad]; one that never moved has no R² and no fit."""

    rmse: Mapping[str, float]
    mae: Mapping[str, float]
    r2: Mapping[str, float]
    fit_percent: Mapping[str, float]

    def to_dict(self) -> dict[str, dict[str, float]]:
        """For JSON."""
        return {key: dict(values) for key, values in vars(self).items()}


def scores(measured: Floats, error: Floats) -> Scores:
    """Measured (M, 6) and error (M, 6) of (eta, nu) -> scores by channel."""
    squares = np.sum(error**2, axis=0)
    about_mean = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    moved = {name: i for name, i in COLUMN.items() if about_mean[i] > 0.0}
    return Scores(
        {name: float(np.sqrt(squares[i] / len(error))) for name, i in COLUMN.items()},
        {name: float(np.mean(np.abs(error[:, i]))) for name, i in COLUMN.items()},
        {name: float(1.0 - squares[i] / about_mean[i]) for name, i in moved.items()},
        {name: float(100.0 * (1.0 - np.sqrt(squares[i] / about_mean[i])))
         for name, i in moved.items()},
    )  # fmt: skip


def scaled_squares(error: Floats, scales: Floats) -> Floats:
    """Error (..., 6), scales (3,) of u, v, r -> mean squared error in scales (...)."""
    return np.mean((error[..., 3:] / scales) ** 2, axis=-1)


def nrmse(error: Floats, scales: Floats) -> float:
    """Error (M, 6), scales (3,) of u, v, r -> one number."""
    return float(np.sqrt(np.mean(scaled_squares(error, scales))))


def nrmse_interval(squares: Floats, block: Ints, seed: int) -> tuple[float, float] | None:
    """Squared scaled errors (M,) and their blocks (M,) -> 95 % interval; None below two blocks."""
    _, number = np.unique(block, return_inverse=True)
    total, count = np.bincount(number, squares), np.bincount(number)
    n = len(total)
    if n < 2:
        return None
    draw = np.random.default_rng(seed).integers(0, n, (BOOTSTRAP_DRAWS, n))
    mean = total.sum() / count.sum()
    means = total[draw].sum(axis=1) / count[draw].sum(axis=1)
    means = mean * np.maximum(means / mean, 1e-12) ** np.sqrt(n / (n - 1)) if mean > 0 else means
    low, high = np.quantile(np.sqrt(means), [0.025, 0.975])
    return float(low), float(high)
