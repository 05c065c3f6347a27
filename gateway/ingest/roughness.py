"""Errors and accelerations of a source that nothing is known about, from its values alone.

    std of the fourth difference of white errors = √70 σ

Motion of a boat has hardly any fourth difference over a few tenths of a second. Its hardest
accelerations are second differences over a little longer.
"""

import numpy as np

from sim.state import Floats

CLIP = 4.0  # medians: a jump is no noise
SAFE = 2.0  # errors are not quite white
SPAN_S = 0.4  # of a second difference
HARD = 0.99  # of the accelerations are below the hardest, which are two standard deviations


def white_std(values: Floats, smallest: float) -> float:
    """Values (K, n) -> σ, not below `smallest` nor a step of their resolution over √12."""
    if len(values) < 10:
        return smallest
    fourth = np.abs(np.diff(values, n=4, axis=0)) / np.sqrt(70.0)
    usual = np.median(fourth, axis=0)
    rough = np.sqrt(np.mean(np.minimum(fourth, CLIP * np.maximum(usual, 1e-12)) ** 2, axis=0))
    steps = np.abs(np.diff(values, axis=0))
    moved = steps[steps > 0.0]
    finest = float(np.quantile(moved, 0.01)) if len(moved) else 0.0
    return float(max(SAFE * rough.max(), finest / np.sqrt(12.0), smallest))


def acceleration_std(time: Floats, values: Floats) -> float:
    """Times (K,) [s], values (K, n) -> standard deviation of their second derivative."""
    grid = np.arange(time[0], time[-1], SPAN_S)
    if len(grid) < 10:
        return 0.0
    path = np.stack([np.interp(grid, time, values[:, i]) for i in range(values.shape[1])], axis=1)
    change = np.linalg.norm(np.diff(path, n=2, axis=0), axis=1) / SPAN_S**2
    return float(0.5 * np.quantile(change, HARD))
