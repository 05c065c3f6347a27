"""What a manoeuvre is: throttle and helm as a function of time, their limits, and few points of it.

Sticks are (throttle, steer) in [−1, 1]: ahead and to starboard are positive. A manoeuvre draws its
random numbers in an order that does not depend on the time grid: finer sampling is the same
manoeuvre.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.random import Generator

from sim.state import Floats
from sim.vessel import Vessel


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
