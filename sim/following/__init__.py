"""The reference velocity, and the controller that makes a plant follow it: here, its law.

Bumpless transfer: the offset between the reference and its new source decays.

    p(t) = (a + b t + c t²) e^(−t/T)    a = p₀,  b = ṗ₀ + a/T,  c = ½ p̈₀ + b/T − ½ a/T²

for north, east and yaw in the world frame, so that pose, velocity and acceleration are continuous
and consistent: η̇ = J(ψ) ν holds for the blend if it holds for the sources.

The model-following law: the force that makes the plant move as the reference does.

    e = ν_ref − ν_s,   γ = ν̇_ref + K e + K_i ∫e,   τ_c = M_s γ + C_s ν_s + D_s ν_s
    outer loop:  ν_ref ← ν_ref + Jᵀ(ψ_s) K_p (η_ref − η_s)      slow, keeps the positions together

Source: Saldarriaga-Mesa et al., Robotics 14(9), 124 (2025), after Fossen 2021, §15.3. The paper
prints k_d ė in γ; closing that loop gives (1 + k_d) ė = 0, an error that never decays. It is the
special case K = K_i = 0 here (`Gains.printed`).

**Bounds**: what a boat can do, and how long a state may run on: a state beyond either begins anew.

    |u|, |v| <= MAX_SPEED_MPS,   |r| <= MAX_TURN_RADPS,   all finite

    |offset| · PEAK_RATE / T <= MAX_RETURN_MPS, MAX_RETURN_RADPS        where it comes back from

Beyond the first two a model has diverged: its numbers describe no boat at the motion that was
asked of it.
An offset beyond the last would bring the reference back faster than boats move, sideways too: the
model ran on alone for long, and the reference is set to the measurement instead.
"""

from typing import NamedTuple

import numpy as np

from sim.body import Report
from sim.jit import jitable
from sim.state import Pose, Velocity, to_body, to_world, wrap


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


CORRECTION_LIMIT = 1.0  # m/s and rad/s, of the outer loop; chosen, not measured


class Gains(NamedTuple):
    """Gains of the follower; sway = 0 leaves sway to coupling, as in the paper."""

    rate: float = 10.0  # K [1/s]
    integral: float = 0.5  # K_i [1/s²]
    position: float = 0.1  # K_p of north and east [1/s]
    heading: float = 0.2  # K_p of yaw [1/s]
    sway: float = 1.0  # 1: three axes; 0: surge and yaw only

    @classmethod
    def printed(cls) -> "Gains":
        """The law as the paper prints it, its loop closed: γ = ν̇_ref."""
        return cls(rate=0.0, integral=0.0, position=0.0, heading=0.0)


@jitable
def clamp(value: float, limit: float) -> float:
    """The value, limited to −limit … limit."""
    return np.minimum(np.maximum(value, -limit), limit)


@jitable
def corrected_reference(eta_ref: Pose, nu_ref: Velocity, pose: Pose, gains: Gains) -> Velocity:
    """ν_ref with the outer loop's correction -> u, v [m/s], r [rad/s]."""
    forward, starboard = to_body(eta_ref.north - pose.north, eta_ref.east - pose.east, pose.yaw)
    return Velocity(
        nu_ref.u + clamp(gains.position * forward, CORRECTION_LIMIT),
        nu_ref.v + clamp(gains.position * starboard, CORRECTION_LIMIT),
        nu_ref.r + clamp(gains.heading * wrap(eta_ref.yaw - pose.yaw), CORRECTION_LIMIT),
    )


@jitable
def commanded_acceleration(
    nu_ref: Velocity, nu_ref_dot: Velocity, nu: Velocity, integral: Velocity, gains: Gains
) -> Velocity:
    """γ = ν̇_ref + K e + K_i ∫e -> [m/s², m/s², rad/s²]."""
    return Velocity(
        nu_ref_dot.u + gains.rate * (nu_ref.u - nu.u) + gains.integral * integral.u,
        nu_ref_dot.v + gains.rate * (nu_ref.v - nu.v) + gains.integral * integral.v,
        nu_ref_dot.r + gains.rate * (nu_ref.r - nu.r) + gains.integral * integral.r,
    )


MAX_SPEED_MPS = 150.0  # the fastest boat so far went 142 m/s (Spirit of Australia, 1978)
MAX_TURN_RADPS = 20.0  # chosen: small racing boats on a short line turn about half as fast
PEAK_RATE = 2.0 * np.exp(-2.0)  # the fastest that an offset of 1 decays, with T = 1 s: after 2 s
MAX_RETURN_MPS = 1.5  # chosen, as the next: 5.5 m with T = 1 s
MAX_RETURN_RADPS = 0.5  # 106° with T = 1 s
# Between two rows; a state older than that says nothing about now. The estimator begins anew after
# as long a silence, see `gap_s` of its settings.
LONGEST_SPAN_S = 60.0


@jitable
def is_possible(u: float, v: float, r: float) -> bool:
    """Velocities [m/s, m/s, rad/s] of a state -> whether a boat can have them; not where NaN."""
    return abs(u) <= MAX_SPEED_MPS and abs(v) <= MAX_SPEED_MPS and abs(r) <= MAX_TURN_RADPS


@jitable
def can_return(offset: WorldMotion, fade: float) -> bool:
    """Whether an offset decays, with the time constant `fade` [s], no faster than a boat moves."""
    rate = PEAK_RATE / fade
    distance = np.sqrt(offset.north**2 + offset.east**2)
    return distance * rate <= MAX_RETURN_MPS and abs(offset.yaw) * rate <= MAX_RETURN_RADPS


@jitable
def within(value: float, limit: float) -> float:
    """The value cut off at ±limit; NaN becomes the limit."""
    if np.isnan(value):
        return limit
    return min(max(value, -limit), limit)


@jitable
def runs_on(now: float, before: float) -> bool:
    """Whether a state of `before` [s] can be carried to `now`; not where there is none (NaN)."""
    return abs(now - before) <= LONGEST_SPAN_S
