"""From the truth to what an autopilot believes.

Its estimate errs as a GNSS-aided filter does: first-order Gauss–Markov wander and a little white
noise on top. The gyro goes through the autopilot's second-order low-pass (INS_GYRO_FILTER), which
delays it.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.random import Generator
from scipy.signal import butter

from gateway.simulated_boat.hull import Truth
from sim.state import Floats

GRAVITY = 9.80665  # m/s²
GPS_AGE = 0.12  # s, of a receiver's solution when it is told


class Wander(NamedTuple):
    """An error: standard deviation and time constant [s] of its slow part, std of its white one."""

    std: float
    seconds: float
    white: float


class Columns(NamedTuple):
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
    "north": Wander(0.3, 60.0, 0.01),
    "east": Wander(0.3, 60.0, 0.01),
    "yaw": Wander(0.012, 120.0, 0.0006),
    "north_mps": Wander(0.02, 2.0, 0.006),
    "east_mps": Wander(0.02, 2.0, 0.006),
    "yaw_rate": Wander(0.0004, 100.0, 0.003),
    "roll": Wander(0.01, 1.5, 0.0005),
    "pitch": Wander(0.006, 1.5, 0.0005),
    "forward": Wander(0.02, 200.0, 0.08),
    "starboard": Wander(0.02, 200.0, 0.08),
    "gps_north": Wander(0.6, 30.0, 0.05),
    "gps_east": Wander(0.6, 30.0, 0.05),
    "gps_north_mps": Wander(0.05, 2.0, 0.03),
    "gps_east_mps": Wander(0.05, 2.0, 0.03),
    "volts": Wander(0.01, 10.0, 0.01),
}
TABLE = np.array([ERRORS[name] for name in Columns._fields])  # (n, 3)


@dataclass(frozen=True)
class SensorState:
    """Slow errors (n,), memory of the gyro's filter (2,)."""

    wander: Floats
    gyro: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Sensors:
    """The sensors of a boat, read every `dt` seconds."""

    dt: float
    noise: float
    gyro_filter_hz: float

    def start(self, dice: Generator) -> SensorState:
        """The errors are as large at the start as ever."""
        return SensorState(self.noise * TABLE[:, 0] * dice.standard_normal(len(TABLE)))

    @cached_property
    def _stay(self) -> Floats:
        return np.exp(-self.dt / TABLE[:, 1])

    @cached_property
    def _leap(self) -> Floats:
        return self.noise * TABLE[:, 0] * np.sqrt(1.0 - self._stay**2)

    @cached_property
    def _low_pass(self) -> tuple[list[float], list[float]] | None:
        """Numerator and denominator; None where the filter is off or faster than the loop."""
        if not 0.0 < self.gyro_filter_hz < 0.5 / self.dt:
            return None
        b, a = butter(2, self.gyro_filter_hz, fs=1.0 / self.dt)
        return b.tolist(), a.tolist()

    def read(
        self, state: SensorState, truth: Truth, dice: Generator
    ) -> tuple[SensorState, Columns]:
        """One reading of everything."""
        shocks = dice.standard_normal((2, len(TABLE)))
        wander = self._stay * state.wander + self._leap * shocks[0]
        errors = Columns._make((wander + self.noise * TABLE[:, 2] * shocks[1]).tolist())
        memory, yaw_rate = self._smooth(state.gyro, truth.report.r)
        believed = _believed(truth, yaw_rate, errors)
        sensed = Columns._make(b + e for b, e in zip(believed, errors, strict=True))
        return SensorState(wander, memory), sensed

    def _smooth(self, memory: tuple[float, float], x: float) -> tuple[tuple[float, float], float]:
        """One step of the gyro's low-pass (transposed direct form II)."""
        if self._low_pass is None:
            return memory, x
        b, a = self._low_pass
        y = b[0] * x + memory[0]
        return (b[1] * x - a[1] * y + memory[1], b[2] * x - a[2] * y), y


def _believed(truth: Truth, yaw_rate: float, tilt: Columns) -> Columns:
    """What error-free sensors say, on a hull that rolls and pitches by `tilt`."""
    said = truth.report
    c, s = math.cos(said.yaw), math.sin(said.yaw)
    v_n, v_e = c * said.u - s * said.v, s * said.u + c * said.v
    ahead, side = said.u_dot - said.r * said.v, said.v_dot + said.r * said.u
    a_n, a_e = c * ahead - s * side, s * ahead + c * side
    return Columns(
        north=said.north,
        east=said.east,
        yaw=said.yaw,
        north_mps=v_n,
        east_mps=v_e,
        yaw_rate=yaw_rate,
        roll=0.0,
        pitch=0.0,
        forward=truth.forward + GRAVITY * math.sin(tilt.pitch),
        starboard=truth.starboard - GRAVITY * math.sin(tilt.roll),
        gps_north=said.north - GPS_AGE * v_n,
        gps_east=said.east - GPS_AGE * v_e,
        gps_north_mps=v_n - GPS_AGE * a_n,
        gps_east_mps=v_e - GPS_AGE * a_e,
        volts=truth.volts,
    )
