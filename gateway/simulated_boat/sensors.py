"""Sensors and the autopilot's estimate: the true state with their errors.

The estimate errs as a GNSS-aided filter does: a slow first-order Gauss-Markov error with a little
white noise on top. The gyro goes through the autopilot's second-order low-pass (INS_GYRO_FILTER),
which delays it. The sizes are chosen like those of a small autopilot, not fitted to one.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.signal import butter

from gateway.simulated_boat.hull import TrueState
from sim.state import Floats

GRAVITY = 9.80665  # m/s²
GPS_AGE = 0.12  # s, of a receiver's solution when it is sent


class SensorError(NamedTuple):
    """Standard deviation and time constant [s] of the slow part, std of the white part."""

    std: float
    seconds: float
    white: float


class SensedValues(NamedTuple):
    """One number (or one kind of error) for everything that is sensed."""

    north: float  # m
    east: float
    yaw: float  # rad
    north_mps: float
    east_mps: float
    yaw_rate: float  # rad/s
    roll: float
    pitch: float
    forward: float  # specific force, m/s²
    starboard: float
    gps_north: float
    gps_east: float
    gps_north_mps: float
    gps_east_mps: float
    volts: float


ERRORS = {
    "north": SensorError(0.3, 60.0, 0.01),
    "east": SensorError(0.3, 60.0, 0.01),
    "yaw": SensorError(0.012, 120.0, 0.0006),
    "north_mps": SensorError(0.02, 2.0, 0.006),
    "east_mps": SensorError(0.02, 2.0, 0.006),
    "yaw_rate": SensorError(0.0004, 100.0, 0.003),
    "roll": SensorError(0.01, 1.5, 0.0005),
    "pitch": SensorError(0.006, 1.5, 0.0005),
    "forward": SensorError(0.02, 200.0, 0.08),
    "starboard": SensorError(0.02, 200.0, 0.08),
    "gps_north": SensorError(0.6, 30.0, 0.05),
    "gps_east": SensorError(0.6, 30.0, 0.05),
    "gps_north_mps": SensorError(0.05, 2.0, 0.03),
    "gps_east_mps": SensorError(0.05, 2.0, 0.03),
    "volts": SensorError(0.01, 10.0, 0.01),
}
TABLE = np.array([ERRORS[name] for name in SensedValues._fields])  # (n, 3)


@dataclass(frozen=True)
class SensorState:
    """Slow errors (n,), memory of the gyro's filter (2,)."""

    slow: Floats
    gyro: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class SensorModel:
    """The sensors of a boat, read every `dt` seconds."""

    dt: float
    noise: float
    gyro_filter_hz: float

    def start(self, rng: Generator) -> SensorState:
        """Slow errors as large as they will ever be."""
        return SensorState(self.noise * TABLE[:, 0] * rng.standard_normal(len(TABLE)))

    @cached_property
    def _decay(self) -> Floats:
        return np.exp(-self.dt / TABLE[:, 1])

    @cached_property
    def _step_std(self) -> Floats:
        return self.noise * TABLE[:, 0] * np.sqrt(1.0 - self._decay**2)

    @cached_property
    def _low_pass(self) -> tuple[list[float], list[float]] | None:
        """Numerator and denominator; None where the filter is off or faster than the loop."""
        if not 0.0 < self.gyro_filter_hz < 0.5 / self.dt:
            return None
        b, a = butter(2, self.gyro_filter_hz, fs=1.0 / self.dt)
        return b.tolist(), a.tolist()

    def read(
        self, state: SensorState, truth: TrueState, rng: Generator
    ) -> tuple[SensorState, SensedValues]:
        """One reading of everything."""
        normal = rng.standard_normal((2, len(TABLE)))
        slow = self._decay * state.slow + self._step_std * normal[0]
        errors = SensedValues._make((slow + self.noise * TABLE[:, 2] * normal[1]).tolist())
        memory, yaw_rate = self._filter_gyro(state.gyro, truth.report.r)
        ideal = _error_free(truth, yaw_rate, errors)
        sensed = SensedValues._make(v + e for v, e in zip(ideal, errors, strict=True))
        return SensorState(slow, memory), sensed

    def _filter_gyro(
        self, memory: tuple[float, float], x: float
    ) -> tuple[tuple[float, float], float]:
        """One step of the gyro's low-pass (transposed direct form II)."""
        if self._low_pass is None:
            return memory, x
        b, a = self._low_pass
        y = b[0] * x + memory[0]
        return (b[1] * x - a[1] * y + memory[1], b[2] * x - a[2] * y), y


def _error_free(truth: TrueState, yaw_rate: float, tilt: SensedValues) -> SensedValues:
    """Error-free values, on a hull that rolls and pitches by `tilt`."""
    motion = truth.report
    c, s = math.cos(motion.yaw), math.sin(motion.yaw)
    v_n, v_e = c * motion.u - s * motion.v, s * motion.u + c * motion.v
    ahead, side = motion.u_dot - motion.r * motion.v, motion.v_dot + motion.r * motion.u
    a_n, a_e = c * ahead - s * side, s * ahead + c * side
    return SensedValues(
        north=motion.north,
        east=motion.east,
        yaw=motion.yaw,
        north_mps=v_n,
        east_mps=v_e,
        yaw_rate=yaw_rate,
        roll=0.0,
        pitch=0.0,
        forward=truth.forward + GRAVITY * math.sin(tilt.pitch),
        starboard=truth.starboard - GRAVITY * math.sin(tilt.roll),
        gps_north=motion.north - GPS_AGE * v_n,
        gps_east=motion.east - GPS_AGE * v_e,
        gps_north_mps=v_n - GPS_AGE * a_n,
        gps_east_mps=v_e - GPS_AGE * a_e,
        volts=truth.volts,
    )
