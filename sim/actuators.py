"""Thrusters and rudders: from a command in [−1, 1] to a force in the body frame.

    thruster   F = sign(c) |c|^exponent · (ahead or astern thrust), or a table (`sim.vessel`)
               X += F cos α,  Y += F sin α,  N += x F sin α − y F cos α
    rudder     F_N = ½ ρ A C_Lα V_R² sin α_R,   C_Lα = 6.13 Λ / (Λ + 2.25)   (Fujii)
               α_R = δ + atan2(v_R, u_R),  v_R = v + x r,  u_R = u + slipstream,  stall limited
               X −= F_N sin δ,  Y −= F_N cos δ
    slipstream of a thruster ahead of the blade (actuator disc as wide as the blade is high):
               √(u² + 2 F / (ρ A_p)) − |u|

A positive rudder angle turns the bow to starboard when going ahead. A steered motor turns its
thruster instead. Sources: Fossen 2021, §9.5; Yasukawa and Yoshimura, MMG standard method,
J. Mar. Sci. Technol. 20 (2015), eqs. 16–24.
"""

import numpy as np

from sim.body import Flow, RudderParameters, ThrusterParameters
from sim.jit import jitable
from sim.state import Wrench

WATER_DENSITY = 1000.0  # kg/m³
STALL_SINE = 0.5  # sin of the angle of attack beyond which a small blade lifts no more (30°)


@jitable
def thrust_of(command: float, drive: ThrusterParameters) -> float:
    """Static thrust of a command in [−1, 1] -> [N]."""
    shape = np.abs(command) ** drive.exponent
    return shape * ((command > 0.0) * drive.ahead + (command < 0.0) * drive.astern)


@jitable
def ramp(command: float, low: float, high: float) -> float:
    """0 below one command, 1 above the other, a line between them."""
    return np.minimum(np.maximum((command - low) / (high - low), 0.0), 1.0)


@jitable
def thrust_at(command: float, share: float, drive: ThrusterParameters) -> float:
    """Share of full thrust [−1 … 1] that a command comes to -> [N]."""
    return share * ((command > 0.0) * drive.ahead - (command < 0.0) * drive.astern)


@jitable
def axis_of(azimuth: float) -> tuple[float, float]:
    """Azimuth [rad] -> components of a unit thrust ahead and to starboard."""
    return np.cos(azimuth), np.sin(azimuth)


@jitable
def pointing(drive: ThrusterParameters, azimuth: float) -> ThrusterParameters:
    """The same thruster, turned to another azimuth [rad]."""
    return ThrusterParameters(
        drive.number, drive.x, drive.y, azimuth, drive.astern, drive.ahead, drive.exponent
    )


@jitable
def thruster_force(thrust: float, axis: tuple[float, float], drive: ThrusterParameters) -> Wrench:
    """Thrust [N] along an axis (`axis_of`) -> X, Y, N [N, N, N m]."""
    forward, starboard = thrust * axis[0], thrust * axis[1]
    return Wrench(forward, starboard, drive.x * starboard - drive.y * forward)


@jitable
def angle_of(command: float, blade: RudderParameters) -> float:
    """Angle of a command in [−1, 1] -> [rad]; a command of zero is amidships."""
    return np.abs(command) * (
        (command > 0.0) * blade.angle_high + (command < 0.0) * blade.angle_low
    )


@jitable
def slipstream(u: float, thrust: float, blade: RudderParameters) -> float:
    """Speed [m/s] that the jet of a thruster ahead adds at the blade."""
    disc = 0.25 * np.pi * blade.area * blade.aspect
    return np.sqrt(u * u + 2.0 * np.maximum(thrust, 0.0) / (WATER_DENSITY * disc)) - np.abs(u)


@jitable
def rudder_force(angle: float, flow: Flow, jet: float, blade: RudderParameters) -> Wrench:
    """Rudder at an angle [rad] in flow and jet [m/s] -> X, Y, N [N, N, N m]."""
    u, v = flow.u + jet, flow.v + blade.x * flow.r
    attack = np.sin(angle + np.arctan2(v, u))
    lift_slope = 6.13 * blade.aspect / (blade.aspect + 2.25)
    lift = lift_slope * np.minimum(np.maximum(attack, -STALL_SINE), STALL_SINE)
    normal = 0.5 * WATER_DENSITY * blade.area * lift * (u * u + v * v)
    X, Y = -normal * np.sin(angle), -normal * np.cos(angle)
    return Wrench(X, Y, blade.x * Y - blade.y * X)
