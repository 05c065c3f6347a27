"""A yaw rate that is off by a constant: told by the heading, and kept from bending it.

    ∫ r dt − ψ = b t + …

An estimate that takes the rate's bias b for a turn leans its heading over, and with it the speed
sideways, by some multiple of b. So a bias that is plain is taken out of the measured rate before
the two are combined, and put back into the rate that comes out: what the gyro said stays as it was
said, for an effect of the catalogue to explain, and nothing else bends with it.
"""

from dataclasses import replace

import numpy as np

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.events import Events
from gateway.estimation.smoother import SmoothedMotion, smooth
from gateway.offline.usable_time import MAX_STEP_S, heading_and_turn
from sim.state import Floats, Nu

PIECE_S = 20.0  # over which heading and rate are held against each other
MIN_PIECES = 5
MIN_BIAS = 0.008  # rad/s: an estimator that works leaves a tenth of it
MIN_ERRORS = 5.0  # standard errors of the median


def rate_bias(events: Events) -> float:
    """Rate less turn of the heading [rad/s], the median of many pieces; 0 where it is not plain."""
    heading, turn = heading_and_turn(events)
    if len(heading.time) < 2 or len(turn.time) < 2:
        return 0.0
    turned = turn.integral()
    edges = np.arange(heading.time[0], heading.time[-1], PIECE_S)
    if len(edges) <= MIN_PIECES:
        return 0.0
    apart = (turned.at(edges) - heading.at(edges))[:, 0]
    piece = np.diff(apart) / PIECE_S
    whole = _whole(heading.time, edges) & _whole(turn.time, edges)
    if whole.sum() < MIN_PIECES:
        return 0.0
    bias = float(np.median(piece[whole]))
    spread = 1.4826 * float(np.median(np.abs(piece[whole] - bias)))
    error = 1.2533 * spread / np.sqrt(whole.sum())  # of a median
    return bias if abs(bias) > max(MIN_BIAS, MIN_ERRORS * error) else 0.0


def _whole(time: Floats, edges: Floats) -> np.ndarray:
    """Which pieces between edges have no silence: times (K,), edges (n + 1,) -> (n,)."""
    silent = np.flatnonzero(np.diff(time) > MAX_STEP_S)
    out = np.ones(len(edges) - 1, np.bool_)
    for i in silent:
        out &= (edges[1:] <= time[i]) | (edges[:-1] >= time[i + 1])
    return out


def smooth_with_bias(events: Events, grid: Floats, settings: FilterSettings) -> SmoothedMotion:
    """As `smooth`, but for a plain bias of the yaw rate, which bends no heading."""
    bias = rate_bias(events)
    if bias == 0.0:
        return smooth(events, grid, settings)
    z = events.z.copy()
    z[events.kind == int(MeasurementKind.YAW_RATE), 0] -= bias
    motion = smooth(replace(events, z=z), grid, settings)
    motion.nu[:, Nu.R] += bias
    return motion
