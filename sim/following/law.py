"""The model-following law: the force that makes the plant move as the reference does.

    e = ν_ref − ν_s,   γ = ν̇_ref + K e + K_i ∫e,   τ_c = M_s γ + C_s ν_s + D_s ν_s
    outer loop:  ν_ref ← ν_ref + Jᵀ(ψ_s) K_p (η_ref − η_s)      slow, keeps the positions together

Source: Saldarriaga-Mesa et al., Robotics 14(9), 124 (2025), after Fossen 2021, §15.3. The paper
prints k_d ė in γ; closing that loop gives (1 + k_d) ė = 0, an error that never decays. It is the
special case K = K_i = 0 here (`Gains.printed`).
"""

from typing import NamedTuple

import numpy as np

from sim.jit import jitable
from sim.state import Pose, Velocity, to_body, wrap

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
