"""Accelerations that hold gravity: they do not agree with the change of speed.

    a = u̇ − r v + g sin θ      reported ahead      (to starboard: v̇ + r u − g sin φ)

A bow that rises by 10° under full throttle adds 1.7 m/s². Compared are means over a second or two:
slope and mean of what is reported against what the speed did. Source: Fossen 2021, §14.4 (what an
accelerometer measures).
"""

from typing import NamedTuple

import numpy as np

from sim.state import Floats

MEAN_S = 1.0  # means over so long are compared
SLOPE = 0.25  # that the slope may be off by
BIAS = 0.15  # m/s², that the mean may be off by
MOVES = 0.05  # m/s²: an acceleration that stays below this says nothing


class Agreement(NamedTuple):
    """How an acceleration follows the change of speed: both would be 1 and 0."""

    slope: float
    bias: float  # m/s²

    @property
    def good(self) -> bool:
        """No more than a sensor's faults."""
        return abs(self.slope - 1.0) <= SLOPE and abs(self.bias) <= BIAS


def agreement(time: Floats, reported: Floats, expected: Floats) -> Agreement | None:
    """Accelerations (K,) [m/s²] on a grid (K,) [s] -> agreement; None: nothing moves."""
    rows = max(round(MEAN_S / float(np.median(np.diff(time)))), 1)
    count = len(time) // rows * rows
    a, b = (x[:count].reshape(-1, rows).mean(axis=1) for x in (reported, expected))
    if len(a) < 10 or np.std(b) < MOVES:
        return None
    about = b - b.mean()
    return Agreement(float(about @ a / (about @ about)), float(np.mean(a - b)))
