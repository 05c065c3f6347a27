"""What the autopilot believes: the truth, late, through the sensors' errors.

Its errors are those of an estimator fed by a GNSS receiver and a compass: they wander. The white
part on top is small.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.random import Generator as Dice
from scipy.signal import lfilter

from benchmarks.hidden.nature import Nature
from benchmarks.hidden.pilots import TICK
from benchmarks.hidden.sail import Floats, Truth
from benchmarks.hidden.scene import Report

GRAVITY = 9.80665
GPS_AGE = 0.12  # s


class Wander(NamedTuple):
    """A first-order Gauss–Markov error: standard deviation, correlation time [s], white part."""

    std: float
    seconds: float
    white: float


POSITION = Wander(0.3, 20.0, 0.01)  # m
VELOCITY = Wander(0.025, 2.0, 0.006)  # m/s
HEADING = Wander(0.012, 60.0, 0.001)  # rad
TURNING = Wander(0.0005, 100.0, 0.002)  # rad/s
TILT = Wander(0.008, 1.5, 0.0005)  # rad
GPS_POSITION = Wander(0.5, 15.0, 0.05)
GPS_VELOCITY = Wander(0.04, 1.5, 0.02)
ACCELERATION = Wander(0.02, 200.0, 0.05)  # m/s²

ESTIMATE = Report(POSITION, POSITION, HEADING, VELOCITY, VELOCITY, TURNING)
RECEIVER = (GPS_POSITION, GPS_POSITION, GPS_VELOCITY, GPS_VELOCITY)


def wandering(wander: Wander, ticks: int, dice: Dice) -> Floats:
    """One realisation of the error without its white part: (ticks,)."""
    stay = math.exp(-TICK / wander.seconds)
    leap = math.sqrt(1.0 - stay * stay)
    shocks = dice.standard_normal(ticks)
    shocks[0] /= leap  # the error is as large at the start as ever
    return np.asarray(np.round(wander.std * lfilter([leap], [1.0, -stay], shocks), 9))


def estimate_error(ticks: int, dice: Dice, errors: Report = ESTIMATE) -> Report:
    """Errors of the autopilot's estimate: six columns (ticks,)."""
    return Report(*(wandering(w, ticks, dice) for w in errors))


class Reading(NamedTuple):
    """All that an autopilot could say at one moment, SI units; columns or scalars."""

    time: float  # s after arming
    north: float
    east: float
    yaw: float
    v_north: float
    v_east: float
    r: float
    roll: float
    pitch: float
    forward: float  # specific force
    starboard: float
    gps_north: float
    gps_east: float
    gps_v_north: float
    gps_v_east: float
    volts: float
    amperes: float
    used: float  # A s
    armed: bool
    pulses: tuple[int, ...]


class Sensors:
    """The truth of a voyage, and every error of the sensors that watched it."""

    def __init__(
        self, nature: Nature, truth: Truth, noise: Report, dice: Dice, errors: Report = ESTIMATE
    ) -> None:
        ticks = len(truth.time)
        self._nature, self._truth, self._noise, self._dice = nature, truth, noise, dice
        self._errors = errors
        self._tilt = [wandering(TILT, ticks, dice) for _ in range(2)]
        self._receiver = [wandering(w, ticks, dice) for w in RECEIVER]
        self._bias = [wandering(ACCELERATION, ticks, dice) for _ in range(2)]
        self._newton = np.asarray(np.gradient(truth.motion[:, 3:5], TICK, axis=0))
        self._used = np.cumsum(truth.amperes) * TICK

    def read(self, times: Floats) -> list[Reading]:
        """What would be said at these times [s after arming]: (T,) -> T readings."""
        row = np.clip(np.searchsorted(self._truth.time, times, "right") - 1, 0, None)
        roll, pitch = (self._at(column, times) for column in self._tilt)
        truth = self._truth
        columns = (
            times,
            *self._estimate(times),
            roll,
            pitch,
            *self._specific_force(times, roll, pitch),
            *self._receive(times - GPS_AGE),
            truth.volts[row],
            truth.amperes[row],
            self._used[row],
            truth.armed[row],
        )
        rows = zip(*(column.tolist() for column in columns), strict=True)
        pulses = truth.pulses[row].tolist()
        return [Reading._make((*r, tuple(p))) for r, p in zip(rows, pulses, strict=True)]

    def _estimate(self, times: Floats) -> Report:
        late = self._motion(times - self._nature.latency)
        now = self._motion(times)._replace(
            north=late.north, east=late.east, v_north=late.v_north, v_east=late.v_east
        )
        noise = (self._at(column, times) for column in self._noise)
        white = (w.white * self._dice.standard_normal(len(times)) for w in self._errors)
        return Report(*(x + e + w for x, e, w in zip(now, noise, white, strict=True)))

    def _receive(self, times: Floats) -> list[Floats]:
        seen = self._motion(times - self._nature.latency)
        true = (seen.north, seen.east, seen.v_north, seen.v_east)
        return [
            x + self._at(e, times) + w.white * self._dice.standard_normal(len(times))
            for x, e, w in zip(true, self._receiver, RECEIVER, strict=True)
        ]

    def _motion(self, times: Floats) -> Report:
        """Motion with the sensors' hidden errors, without noise."""
        columns = [self._at(column, times) for column in self._truth.motion.T]
        return self._nature.reported(Report(*columns))

    def _specific_force(self, times: Floats, roll: Floats, pitch: Floats) -> list[Floats]:
        """What accelerometers feel: acceleration less gravity, forward and to starboard."""
        yaw = self._at(self._truth.motion[:, 2], times)
        north, east = (self._at(self._newton[:, i], times) for i in range(2))
        forward = np.cos(yaw) * north + np.sin(yaw) * east + GRAVITY * np.sin(pitch)
        starboard = np.cos(yaw) * east - np.sin(yaw) * north - GRAVITY * np.sin(roll)
        return [
            f + self._at(b, times) + ACCELERATION.white * self._dice.standard_normal(len(times))
            for f, b in zip((forward, starboard), self._bias, strict=True)
        ]

    def _at(self, column: Floats, times: Floats) -> Floats:
        return np.interp(times, self._truth.time, column)
