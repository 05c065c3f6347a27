"""Bumpless transfer: the offset between the reference and its new source decays.

    p(t) = (a + b t + c t²) e^(−t/T)    a = p₀,  b = ṗ₀ + a/T,  c = ½ p̈₀ + b/T − ½ a/T²

for north, east and yaw in the world frame, so that pose, velocity and acceleration are continuous
and consistent: η̇ = J(ψ) ν holds for the blend if it holds for the sources.
"""

from typing import NamedTuple

import numpy as np

from sim.body import Report
from sim.jit import jitable
from sim.state import to_body, to_world, wrap


class WorldMotion(NamedTuple):
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
def to_world_motion(m: Report) -> WorldMotion:
    """Motion in body axes -> the same motion in the world frame [m, rad, s]."""
    north_dot, east_dot = to_world(m.u, m.v, m.yaw)
    north_ddot, east_ddot = to_world(m.u_dot - m.r * m.v, m.v_dot + m.r * m.u, m.yaw)
    return WorldMotion(
        m.north, m.east, m.yaw, north_dot, east_dot, m.r, north_ddot, east_ddot, m.r_dot
    )  # fmt: skip


@jitable
def to_body_motion(t: WorldMotion) -> Report:
    """Motion in the world frame -> the same motion in body axes [m, rad, s]."""
    u, v = to_body(t.north_dot, t.east_dot, t.yaw)
    forward, starboard = to_body(t.north_ddot, t.east_ddot, t.yaw)
    r = t.yaw_dot
    return Report(t.north, t.east, t.yaw, u, v, r, forward + r * v, starboard - r * u, t.yaw_ddot)


@jitable
def offset_between(a: WorldMotion, b: WorldMotion) -> WorldMotion:
    """a − b, the shorter way round in yaw."""
    return WorldMotion(
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
def decayed(
    p: float, p_dot: float, p_ddot: float, t: float, T: float
) -> tuple[float, float, float]:
    """An offset and its two derivatives at 0 -> the same after t [s]."""
    a = p
    b = p_dot + a / T
    c = 0.5 * p_ddot + b / T - 0.5 * a / T**2
    q, q_dot, decay = a + (b + c * t) * t, b + 2.0 * c * t, np.exp(-t / T)
    return q * decay, (q_dot - q / T) * decay, (2.0 * c - 2.0 * q_dot / T + q / T**2) * decay


@jitable
def blend(source: Report, offset: WorldMotion, t: float, T: float) -> Report:
    """The source plus, after t [s], what an offset has decayed to with time constant T [s]."""
    s = to_world_motion(source)
    n = decayed(offset.north, offset.north_dot, offset.north_ddot, t, T)
    e = decayed(offset.east, offset.east_dot, offset.east_ddot, t, T)
    y = decayed(offset.yaw, offset.yaw_dot, offset.yaw_ddot, t, T)
    return to_body_motion(
        WorldMotion(
            s.north + n[0], s.east + e[0], s.yaw + y[0],
            s.north_dot + n[1], s.east_dot + e[1], s.yaw_dot + y[1],
            s.north_ddot + n[2], s.east_ddot + e[2], s.yaw_ddot + y[2],
        )
    )  # fmt: skip
