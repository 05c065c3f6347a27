"""A push that is fixed in the world and changes once, looked for in what a model lacks.

    F = S R(ψ)ᵀ x,   x = x₁ before a moment, x₂ after

F missing force on board (surge, sway) [N], S what a unit of x does there. For a moment x₁ and x₂
follow by least squares, of all moments at once from running sums: those that take most are where
a search begins. Source: Basseville and Nikiforov, Detection of Abrupt Changes, 1993, ch. 2 (the
likelihood of a change at an unknown moment, of means that are unknown).
"""

from typing import NamedTuple

import numpy as np

from sim.effects.effect import ResidualForce
from sim.state import Floats

MOMENTS = 100  # along the recording
SHORTEST_S, SHORTEST_SHARE = 20.0, 0.05  # of a stretch; of the recording
STARTS = 2  # moments to begin from, apart by the shortest stretch
BEND = 4.0  # standard deviations from which on more does not count


class PushChange(NamedTuple):
    """What a change at a moment [s] takes of the missing force, in squares of its spread; size and
    direction [rad from north] of the push before and after.
    """

    taken: float
    time: float
    size: float
    direction: float
    later_size: float
    later_direction: float


def push_changes(found: ResidualForce, ahead: Floats, abeam: Floats) -> list[PushChange]:
    """The moments that take most of a missing force; `ahead`, `abeam` (T,): what a push of one does
    there [N]. None where the recording is too short.
    """
    time, force = found.time, found.body[:, :2]
    shortest = max(SHORTEST_S, SHORTEST_SHARE * float(np.ptp(time))) if len(time) else SHORTEST_S
    if len(time) < MOMENTS or len(force) < len(time) or np.ptp(time) < 2.0 * shortest:
        return []
    spread = np.median(np.abs(force - np.median(force, axis=0)), axis=0) / 0.6745
    if not (np.isfinite(force).all() and (spread > 0.0).all()):
        return []
    c, s = np.cos(found.yaw), np.sin(found.yaw)
    unit = np.stack([ahead / spread[0] * [c, s], abeam / spread[1] * [-s, c]])  # (2, 2, T)
    y = np.clip(force / spread, -BEND, BEND)
    normal = np.cumsum(np.einsum("kit,kjt->tij", unit, unit), axis=0)
    right = np.cumsum(np.einsum("kit,tk->ti", unit, y), axis=0)
    tried = []
    for t in np.linspace(time[0] + shortest, time[-1] - shortest, MOMENTS):
        i = np.searchsorted(time, t) - 1
        parts = [_best(normal[i], right[i]), _best(normal[-1] - normal[i], right[-1] - right[i])]
        (taken, size, direction), (more, *later) = parts
        tried.append(PushChange(taken + more, float(t), size, direction, *later))
    chosen: list[PushChange] = []
    for one in sorted(tried, reverse=True):
        if len(chosen) < STARTS and all(abs(one.time - c.time) > shortest for c in chosen):
            chosen.append(one)
    return chosen


def _best(normal: Floats, right: Floats) -> tuple[float, float, float]:
    """What the best push of one stretch takes, its size and direction."""
    x = np.linalg.lstsq(normal, right, rcond=None)[0]
    return float(right @ x), float(np.hypot(*x)), float(np.arctan2(x[1], x[0]))
