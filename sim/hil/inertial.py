"""What an inertial unit at (x, y) feels on a hull that moves in six degrees of freedom.

Attitude R = R_z(ψ) R_y(θ) R_x(φ); rates of the body from those of the angles (Fossen §2.2):

    p = φ̇ − ψ̇ sin θ
    q = θ̇ cos φ + ψ̇ cos θ sin φ
    r = −θ̇ sin φ + ψ̇ cos θ cos φ

    f = Rᵀ (a − g ẑ) + α × l + ω × (ω × l)

a [m/s²] acceleration of the body origin in the world (NED), g = 9.80665 m/s² down, l = (x, y, 0)
[m] the lever arm, α the rate of ω. At rest and level f = (0, 0, −g). Source: Fossen, Handbook of
Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021, §2.2, §14.4 (kinematics, sensors).
"""

from math import cos, sin
from typing import NamedTuple

from sim.plants.hydrostatics import GRAVITY
from sim.state import to_world

Vector = tuple[float, float, float]


class Attitude(NamedTuple):
    """Roll, pitch, yaw [rad], their rates [rad/s] and accelerations [rad/s²]."""

    roll: float
    pitch: float
    yaw: float
    roll_rate: float
    pitch_rate: float
    yaw_rate: float
    roll_acc: float
    pitch_acc: float
    yaw_acc: float


def world_acceleration(
    u: float, v: float, r: float, u_dot: float, v_dot: float, yaw: float
) -> tuple[float, float]:
    """Velocity and its rate in the body -> acceleration north, east [m/s²]."""
    north, east = to_world(u_dot - r * v, v_dot + r * u, yaw)
    return float(north), float(east)


def body_rates(a: Attitude) -> Vector:
    """p, q, r [rad/s]."""
    sf, cf, st, ct = sin(a.roll), cos(a.roll), sin(a.pitch), cos(a.pitch)
    return (
        a.roll_rate - a.yaw_rate * st,
        a.pitch_rate * cf + a.yaw_rate * ct * sf,
        -a.pitch_rate * sf + a.yaw_rate * ct * cf,
    )


def body_accelerations(a: Attitude) -> Vector:
    """ṗ, q̇, ṙ [rad/s²]."""
    sf, cf, st, ct = sin(a.roll), cos(a.roll), sin(a.pitch), cos(a.pitch)
    f, t, y = a.roll_rate, a.pitch_rate, a.yaw_rate
    return (
        a.roll_acc - a.yaw_acc * st - y * t * ct,
        a.pitch_acc * cf - t * f * sf + a.yaw_acc * ct * sf + y * (f * ct * cf - t * st * sf),
        -a.pitch_acc * sf - t * f * cf + a.yaw_acc * ct * cf - y * (f * ct * sf + t * st * cf),
    )


def to_hull(a: Attitude, north: float, east: float, down: float) -> Vector:
    """A world vector seen in the tilted body frame: forward, starboard, down of the hull."""
    sf, cf, st, ct = sin(a.roll), cos(a.roll), sin(a.pitch), cos(a.pitch)
    ahead = cos(a.yaw) * north + sin(a.yaw) * east
    side = cos(a.yaw) * east - sin(a.yaw) * north
    below = st * ahead + ct * down
    return ct * ahead - st * down, cf * side + sf * below, cf * below - sf * side


def specific_force(a: Attitude, acceleration: Vector, lever: tuple[float, float]) -> Vector:
    """World acceleration of the origin (NED) [m/s²], lever arm [m] -> f in the body [m/s²]."""
    north, east, down = acceleration
    fx, fy, fz = to_hull(a, north, east, down - GRAVITY)
    if lever == (0.0, 0.0):
        return fx, fy, fz
    (x, y), (p, q, r), (pd, qd, rd) = lever, body_rates(a), body_accelerations(a)
    return (
        fx - rd * y - (q * q + r * r) * x + p * q * y,
        fy + rd * x + p * q * x - (p * p + r * r) * y,
        fz + pd * y - qd * x + p * r * x + q * r * y,
    )
