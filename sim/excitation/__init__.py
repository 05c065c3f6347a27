"""Excitations: throttle and helm over time that make a boat show its parameters.

Here: what a manoeuvre is, its limits, and few points of it; from throttle and helm to the actuators
of a vessel; and a plan: sticks on a time grid, the polyline that the autopilot plays, and the
predicted motion.

Sticks are (throttle, steer) in [−1, 1]: ahead and to starboard are positive. A manoeuvre draws its
random numbers in an order that does not depend on the time grid: finer sampling is the same
manoeuvre.

    thruster   c = throttle · cos α + steer · lever / longest lever
               lever = x sin α − y cos α  [m], the yaw moment per newton
    rudder     c = steer

Where there are rudders they steer alone. A thruster across the boat (bow thruster) has no share of
the throttle; one that makes no yaw moment has none of the helm. This is how an autopilot with skid
steering mixes: with throttle and steer together above full travel it keeps the helm and reduces the
throttle, as does `within_travel`.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.random import Generator

from sim.model import Model
from sim.state import Floats
from sim.vessel import Rudder, Thruster, Vessel


@dataclass(frozen=True)
class StickLimits:
    """Largest throttle and steer (0, 1], fastest change [1/s]: ArduRover's throttle, a hand."""

    throttle: float = 1.0
    steer: float = 1.0
    throttle_rate: float = 1.0
    steer_rate: float = 2.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise ValueError(f"{field.name} = {value}: expected a number above 0")
        if max(self.throttle, self.steer) > 1.0:
            raise ValueError("throttle and steer: expected at most 1, full travel")

    @property
    def largest(self) -> Floats:
        """Throttle, steer (2,)."""
        return np.array([self.throttle, self.steer])

    @property
    def rates(self) -> Floats:
        """Throttle, steer (2,) [1/s]."""
        return np.array([self.throttle_rate, self.steer_rate])


def slew_limited(desired: Floats, rates: Floats, dt: float) -> Floats:
    """Sticks (T, n) on a grid of dt [s] -> the same no faster than `rates` (n,) [1/s].

    The first row and the one after the last are neutral.
    """
    if not len(desired):
        return desired.copy()
    step = np.asarray(rates) * dt
    reach = np.arange(len(desired), 0, -1)[:, None] * step  # from which neutral is reached in time
    columns = np.clip(desired, -reach, reach).T.tolist()
    return np.array([_follow(column, s) for column, s in zip(columns, step, strict=True)]).T


def _follow(desired: list[float], step: float) -> list[float]:
    """Follow from 0 with at most `step` a row."""
    out, now = [0.0], 0.0
    for value in desired[1:]:
        now += min(max(value - now, -step), step)
        out.append(now)
    return out


Leg = tuple[float, float, float]  # seconds, throttle, steer: held


class Stick(IntEnum):
    """Columns of an array of sticks: (..., 2) in [−1, 1]."""

    THROTTLE = 0
    STEER = 1


class Manoeuvre(ABC):
    """One family of excitations; its options are the fields of the final class."""

    name: ClassVar[str]
    reveals: ClassVar[str]  # which parameter or effect shows in it, in one line

    @property
    @abstractmethod
    def seconds(self) -> float:
        """Duration [s]; played for longer it begins again."""

    @abstractmethod
    def sticks(self, time: Floats, rng: Generator) -> Floats:
        """Times (T,) in [0, seconds) [s] -> throttle and steer (T, 2) in [−1, 1]."""

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> "Manoeuvre":
        """The same manoeuvre with options that suit a vessel under those limits."""
        return self


class LegManoeuvre(Manoeuvre):
    """A manoeuvre of sticks held, leg after leg."""

    @property
    @abstractmethod
    def legs(self) -> Sequence[Leg]:
        """Seconds, throttle, steer."""

    @property
    def seconds(self) -> float:
        return float(sum(seconds for seconds, _, _ in self.legs))

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        return held_sticks(time, self.legs)


def held_sticks(time: Floats, legs: Sequence[Leg]) -> Floats:
    """Legs one after the other, at times (T,) [s] -> throttle and steer (T, 2)."""
    seconds, *sticks = np.array(legs, dtype=float).T
    ends = np.cumsum(seconds)
    row = np.searchsorted(ends, np.asarray(time) + 1e-9, side="right")
    return np.stack(sticks, axis=-1)[np.minimum(row, len(ends) - 1)]


def corner_rows(time: Floats, values: Floats, tolerance: float) -> list[int]:
    """Rows of (T,), (T, n) whose polyline is off by no more than the tolerance.

    A script aboard has kilobytes for a plan, not a row for every tenth of a second. Source: Ramer
    1972, Douglas and Peucker 1973, with the distance along the value axis.
    """
    kept, todo = {0, len(time) - 1}, [(0, len(time) - 1)]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        share = (time[inside] - time[first]) / (time[last] - time[first])
        line = values[first] + share[:, None] * (values[last] - values[first])
        off = np.abs(values[inside] - line).max(axis=1)
        worst = int(np.argmax(off))
        if off[worst] > tolerance:
            middle = first + 1 + worst
            kept.add(middle)
            todo += [(first, middle), (middle, last)]
    return sorted(kept)


def polyline(time: Floats, at: Floats, values: Floats) -> Floats:
    """Straight lines through values (K, n) at times (K,), read at times (T,) -> (T, n)."""
    return np.stack([np.interp(time, at, column) for column in values.T], axis=-1)


RUDDER_HELM_GAIN = 2.0  # a rudder needs more helm than a difference of thrust; chosen


def mixing_matrix(vessel: Vessel) -> Floats:
    """Each actuator's share of throttle and of steer (actuators, 2)."""
    return np.array([_share(vessel, actuator) for actuator in vessel.actuators])


def mix_sticks(vessel: Vessel, sticks: Floats) -> Floats:
    """Throttle and steer (..., 2) -> commands (..., actuators) in [−1, 1]."""
    return np.clip(sticks @ mixing_matrix(vessel).T, -1.0, 1.0)


def helm_gain(vessel: Vessel) -> float:
    """How much more helm the vessel needs than one that steers by thrust."""
    return RUDDER_HELM_GAIN if vessel.rudders else 1.0


def within_travel(vessel: Vessel, sticks: Floats) -> Floats:
    """Sticks (T, 2) with which all thrusters stay within full travel: the helm has priority."""
    out = np.clip(sticks, -1.0, 1.0)
    if not vessel.rudders:
        room = 1.0 - np.abs(out[:, Stick.STEER])
        out[:, Stick.THROTTLE] = np.clip(out[:, Stick.THROTTLE], -room, room)
    return out


def _share(vessel: Vessel, actuator: Thruster | Rudder) -> tuple[float, float]:
    if isinstance(actuator, Rudder):
        return 0.0, 1.0
    longest = max(abs(_lever(thruster)) for thruster in vessel.thrusters)
    steers = not vessel.rudders and longest > 0.0
    return float(np.cos(actuator.azimuth)), _lever(actuator) / longest if steers else 0.0


def _lever(thruster: Thruster) -> float:
    x, y = thruster.position
    return float(x * np.sin(thruster.azimuth) - y * np.cos(thruster.azimuth))


FULL = StickLimits()


def manoeuvre_sticks(
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    dt: float,
    seed: int = 0,
    limits: StickLimits = FULL,
    seconds: float | None = None,
) -> Floats:
    """Throttle and steer (T, 2) on a grid of dt [s], from neutral to neutral.

    `seconds` cuts the manoeuvre short, or repeats it. Amplitudes are scaled to the limits,
    not clipped: the shape stays.
    """
    adapted = manoeuvre.adapted_to(vessel, limits)
    count = max(round((adapted.seconds if seconds is None else seconds) / dt), 1)
    time = dt * np.arange(count, dtype=float) % adapted.seconds
    desired = adapted.sticks(time, np.random.default_rng(seed)) * limits.largest
    desired[:, Stick.STEER] = np.clip(
        helm_gain(vessel) * desired[:, Stick.STEER], -limits.steer, limits.steer
    )
    return slew_limited(within_travel(vessel, desired), limits.rates, dt)


def manoeuvre_commands(
    manoeuvre: Manoeuvre,
    vessel: Vessel,
    dt: float,
    seed: int = 0,
    limits: StickLimits = FULL,
    seconds: float | None = None,
) -> Floats:
    """Commands (T, actuators) in [−1, 1] on a grid of dt [s]."""
    return mix_sticks(vessel, manoeuvre_sticks(manoeuvre, vessel, dt, seed, limits, seconds))


DT = 0.1  # s
TOLERANCE = 0.01  # of full travel, between the polyline and the manoeuvre


@dataclass(frozen=True)
class Plan:
    """Sticks (K, 2) at the corners (K,) [s]; on the grid (T,) sticks, commands, motion (T, 9)."""

    manoeuvre: Manoeuvre
    vessel: Vessel
    limits: StickLimits
    seed: int
    corner_time: Floats
    corner_sticks: Floats
    time: Floats
    sticks: Floats
    commands: Floats
    motion: Floats

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return float(self.time[-1])

    @property
    def distance(self) -> Floats:
        """Distance from the start (T,) [m]."""
        return np.hypot(*(self.motion[:, :2] - self.motion[0, :2]).T)

    @property
    def reach(self) -> float:
        """Largest distance from the start [m]."""
        return float(self.distance.max())

    @property
    def speed(self) -> Floats:
        """Speed over ground (T,) [m/s]."""
        return np.hypot(self.motion[:, 3], self.motion[:, 4])


def plan_of(
    manoeuvre: Manoeuvre,
    model: Model,
    limits: StickLimits,
    seed: int = 0,
    seconds: float | None = None,
) -> Plan:
    """The sticks as the script will play them, and the motion that they make."""
    vessel = model.vessel
    desired = np.vstack(
        [manoeuvre_sticks(manoeuvre, vessel, DT, seed, limits, seconds), np.zeros(2)]
    )
    time = DT * np.arange(len(desired), dtype=float)
    kept = corner_rows(time, desired, TOLERANCE)
    corners: Floats = np.round(desired[kept], 3).astype(float)
    sticks = polyline(time, time[kept], corners)
    commands = mix_sticks(vessel, sticks)
    motion = model.simulate(commands, DT)[1][0, :-1]
    return Plan(
        manoeuvre, vessel, limits, seed, time[kept], corners, time, sticks, commands, motion
    )
