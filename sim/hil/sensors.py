"""Readings of a boat's sensors, with the errors that its vessel file gives them.

White noise of gyro and accelerometer is a density n [unit/√Hz]: one reading that stands for dt [s]
errs by n / √dt. All errors are 0 unless the vessel file says otherwise. The errors of one reading
depend on the seed and the number of the reading alone.
"""

from functools import lru_cache
from typing import NamedTuple

from numpy.random import PCG64, Generator

from sim.hil.inertial import Vector
from sim.state import Floats
from sim.vessel import Sensors

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
