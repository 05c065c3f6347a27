"""Hand-over without a bump: how far the reference was from its new source dies away.

    p(t) = (a + b t + c t²) e^(−t/T)    a = p₀,  b = ṗ₀ + a/T,  c = ½ p̈₀ + b/T − ½ a/T²

for north, east and yaw in the world frame, so that pose, velocity and acceleration are continuous
and stay one motion: η̇ = J(ψ) ν holds for the blend if it holds for the sources.
"""

from typing import NamedTuple

import numpy as np

from sim.body import Report
from sim.jit import jitable
from sim.state import to_body, to_world, wrap


class Track(NamedTuple):
    """A motion in the world frame: position, velocity and acceleration of north, east, yaw."""

    north: float
    east: float
    yaw: float
    north_dot: float
    east_dot: float
    yaw_dot: float
    north_ddot: float
    east_ddot: float
    yaw_ddot: float


@jitable
def track_of(m: Report) -> Track:
    """Motion in body axes -> the same motion in the world frame [m, rad, s]."""
    north_dot, east_dot = to_world(m.u, m.v, m.yaw)
    north_ddot, east_ddot = to_world(m.u_dot - m.r * m.v, m.v_dot + m.r * m.u, m.yaw)
    return Track(
        m.north, m.east, m.yaw, north_dot, east_dot, m.r, north_ddot, east_ddot, m.r_dot
    )  # fmt: skip


@jitable
def motion_of(t: Track) -> Report:
    """Motion in the world frame -> the same motion in body axes [m, rad, s]."""
    u, v = to_body(t.north_dot, t.east_dot, t.yaw)
    forward, starboard = to_body(t.north_ddot, t.east_ddot, t.yaw)
    r = t.yaw_dot
    return Report(t.north, t.east, t.yaw, u, v, r, forward + r * v, starboard - r * u, t.yaw_ddot)


@jitable
def gap(a: Track, b: Track) -> Track:
    """a − b, the shorter way round in yaw."""
    return Track(
        a.north - b.north,
        a.east - b.east,
        wrap(a.yaw - b.yaw),
        a.north_dot - b.north_dot,
        a.east_dot - b.east_dot,
        a.yaw_dot - b.yaw_dot,
        a.north_ddot - b.north_ddot,
        a.east_ddot - b.east_ddot,
        a.yaw_ddot - b.yaw_ddot,
    )


@jitable
def fading(p: float, p_dot: float, p_ddot: float, t: float, T: float) -> tuple[float, float, float]:
    """An offset and its derivatives at 0, t seconds later -> offset and its derivatives."""
    a = p
    b = p_dot + a / T
    c = 0.5 * p_ddot + b / T - 0.5 * a / T**2
    q, q_dot, left = a + (b + c * t) * t, b + 2.0 * c * t, np.exp(-t / T)
    return q * left, (q_dot - q / T) * left, (2.0 * c - 2.0 * q_dot / T + q / T**2) * left


@jitable
def blended(source: Report, offset: Track, t: float, T: float) -> Report:
    """The source plus what is left, after t [s], of an offset that fades with T [s]."""
    s = track_of(source)
    n = fading(offset.north, offset.north_dot, offset.north_ddot, t, T)
    e = fading(offset.east, offset.east_dot, offset.east_ddot, t, T)
    y = fading(offset.yaw, offset.yaw_dot, offset.yaw_ddot, t, T)
    return motion_of(
        Track(
            s.north + n[0], s.east + e[0], s.yaw + y[0],
            s.north_dot + n[1], s.east_dot + e[1], s.yaw_dot + y[1],
            s.north_ddot + n[2], s.east_ddot + e[2], s.yaw_ddot + y[2],
        )
    )  # fmt: skip
