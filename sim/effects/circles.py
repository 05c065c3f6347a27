"""Circles on the map that a search tries: how large, and which of them to begin from."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sim.state import Floats

MIDDLES, SIDE = 60, 7  # along the track, and along either side of what was sailed
SIZES = 5  # from two hull lengths to a share of the way across what was sailed


class Circle(NamedTuple):
    """One that was tried: what a law within it takes of the missing force, in squares, where, its
    radius [m], the factor of the law; which of several laws, and its direction [rad].
    """

    taken: float
    north: float
    east: float
    radius: float
    factor: float
    law: float = 0.0
    direction: float = 0.0


def radii(place: Floats, length: float, share: float) -> Floats:
    """From a hull's length [m] and places (n, 2) [m], outliers apart: (SIZES,) [m]."""
    across = float(np.ptp(np.quantile(place, [0.05, 0.95], axis=0), axis=0).max())
    return np.geomspace(2.0 * length, max(share * across, 3.0 * length), SIZES)


def middles(place: Floats) -> Floats:
    """Places along a track (n, 2) [m], and on a grid over what it covers: (m, 2) [m]."""
    low, high = np.quantile(place, [0.02, 0.98], axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, SIDE).T), -1).reshape(-1, 2)
    return np.concatenate([place[:: max(len(place) // MIDDLES, 1)], grid])


def best_apart(circles: Iterable[Circle], most: int) -> list[Circle]:
    """Those that take most, the middle of each outside of those before it."""
    chosen: list[Circle] = []
    for one in sorted(circles, reverse=True):
        outside = (np.hypot(one.north - c.north, one.east - c.east) > c.radius for c in chosen)
        if len(chosen) < most and all(outside):
            chosen.append(one)
    return chosen
