"""How sure an nrmse is: a bootstrap over blocks of time, never over samples.

Errors within a segment, and of segments that overlap, are one story told many times. Whole blocks
are drawn with replacement; the interval holds the middle 95 % of the nrmse of 2000 such draws,
widened by √(n/(n − 1)) for the few blocks there are.
"""

import numpy as np

from sim.state import Floats, Ints

DRAWS = 2000


def nrmse_interval(squares: Floats, block: Ints, seed: int) -> tuple[float, float] | None:
    """Squared scaled errors (M,) and their blocks (M,) -> 95 % interval; None below two blocks."""
    _, number = np.unique(block, return_inverse=True)
    total, count = np.bincount(number, squares), np.bincount(number)
    n = len(total)
    if n < 2:
        return None
    draw = np.random.default_rng(seed).integers(0, n, (DRAWS, n))
    mean = total.sum() / count.sum()
    means = total[draw].sum(axis=1) / count[draw].sum(axis=1)
    means = mean * np.maximum(means / mean, 1e-12) ** np.sqrt(n / (n - 1)) if mean > 0 else means
    low, high = np.quantile(np.sqrt(means), [0.025, 0.975])
    return float(low), float(high)
