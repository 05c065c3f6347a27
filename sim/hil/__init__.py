"""The boat that an autopilot drives: pulses in, motion of six degrees and sensor readings out.

Here: readings of a boat's sensors, with the errors that its vessel file gives them.

White noise of gyro and accelerometer is a density n [unit/√Hz]: one reading that stands for dt [s]
errs by n / √dt. All errors are 0 unless the vessel file says otherwise. The errors of one reading
depend on the seed and the number of the reading alone.

**An inertial unit** at (x, y) on a hull that moves in six degrees of freedom feels f.

Attitude R = R_z(ψ) R_y(θ) R_x(φ); rates of the body from those of the angles (Fossen §2.2):

    p = φ̇ − ψ̇ sin θ
    q = θ̇ cos φ + ψ̇ cos θ sin φ
    r = −θ̇ sin φ + ψ̇ cos θ cos φ

    f = Rᵀ (a − g ẑ) + α × l + ω × (ω × l)

a [m/s²] acceleration of the body origin in the world (NED), g = 9.80665 m/s² down, l = (x, y, 0)
[m] the lever arm, α the rate of ω. At rest and level f = (0, 0, −g). Source: Fossen, Handbook of
Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021, §2.2, §14.4 (kinematics, sensors).

**A battery** under load: its voltage sags with the current and falls with the charge drawn.

    I = I_full e,   I_full = 4 W/N · ΣF_max / V_n,   e = mean |c|^1.5 over the thrusters
    V = V_n (1.1 − 0.06 e − 0.15 min(Q / (I_full · 1 h), 1))

c [-] commands, F_max [N] thrust full ahead, V_n [V] nominal voltage, Q [A s] charge drawn. Chosen
like the pack of a small electric boat (an hour at full power), not fitted to one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import cos, sin
from typing import NamedTuple

from numpy.random import PCG64, Generator

from sim.plants.waves import GRAVITY
from sim.state import Floats, to_world
from sim.vessel import Sensors, Vessel

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


BLOCK = 1024  # readings whose errors are drawn together


class Readings(NamedTuple):
    """What the sensors of a boat read at one moment. Body FRD, world NED."""

    time: float  # s since the start
    gyro: Vector  # rad/s
    accel: Vector  # m/s², specific force
    position: Vector  # m from the start of the run
    velocity: Vector  # m/s over ground
    attitude: Vector  # rad: roll, pitch, yaw
    wind: tuple[float, float] | None  # m/s, velocity of the air: north, east
    vane: tuple[float, float] | None  # apparent wind: rad from the bow, clockwise; m/s
    voltage: float  # V
    current: float  # A
    depth: float | None  # m, from the hull straight down to the bottom


@lru_cache(maxsize=4)
def _normal(seed: int, block: int) -> Floats:
    """(BLOCK, 12) standard normal numbers."""
    return Generator(PCG64((seed, block, 12))).standard_normal((BLOCK, 12))


def noisy(sensors: Sensors) -> bool:
    """Whether any sensor errs."""
    noise = (sensors.gyro_noise, sensors.accel_noise, sensors.position_noise)
    return any((*noise, sensors.velocity_noise, *sensors.gyro_bias, *sensors.accel_bias))


def with_errors(readings: Readings, s: Sensors, seed: int, number: int, dt: float) -> Readings:
    """The readings with noise and bias; `number` counts them, each stands for dt [s]."""
    n = _normal(seed, number // BLOCK)[number % BLOCK].tolist()
    per_reading = dt**-0.5 if dt > 0.0 else 0.0
    gyro, accel = s.gyro_noise * per_reading, s.accel_noise * per_reading
    return readings._replace(
        gyro=_off(readings.gyro, s.gyro_bias, gyro, n[0:3]),
        accel=_off(readings.accel, s.accel_bias, accel, n[3:6]),
        position=_off(readings.position, (0.0, 0.0, 0.0), s.position_noise, n[6:9]),
        velocity=_off(readings.velocity, (0.0, 0.0, 0.0), s.velocity_noise, n[9:12]),
    )


def _off(value: Vector, bias: Vector, noise: float, n: list[float]) -> Vector:
    return (
        value[0] + bias[0] + noise * n[0],
        value[1] + bias[1] + noise * n[1],
        value[2] + bias[2] + noise * n[2],
    )


FULL_POWER_W_PER_N = 4.0  # electrical, of small propellers
SAG, DRAINED = 0.06, 0.15  # share of the voltage lost at full current; when empty
ENDURANCE_S = 3600.0  # at full current


@dataclass(frozen=True)
class Battery:
    """Nominal voltage [V] and current of all thrusters full ahead [A]."""

    nominal_v: float
    full_current: float

    @classmethod
    def of(cls, vessel: Vessel, nominal_v: float) -> "Battery":
        """The battery of a vessel: its size follows from the thrust."""
        thrust = sum(thruster.thrust[1] for thruster in vessel.thrusters)
        return cls(nominal_v, FULL_POWER_W_PER_N * thrust / nominal_v)

    def voltage(self, effort: float, used_as: float) -> float:
        """Share of the full current (0 … 1) and charge drawn [A s] -> V."""
        return self.nominal_v * (1.1 - SAG * effort - DRAINED * self.drained(used_as))

    def drained(self, used_as: float) -> float:
        """Charge drawn [A s] -> its share of the whole: 0 full, 1 empty."""
        return min(used_as / (self.full_current * ENDURANCE_S), 1.0)


def effort(thruster_commands: Sequence[float]) -> float:
    """Commands of the thrusters (−1 … 1) -> share of the full current (0 … 1)."""
    return sum(abs(c) ** 1.5 for c in thruster_commands) / max(len(thruster_commands), 1)
