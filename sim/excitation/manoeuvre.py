"""What a manoeuvre is: throttle and helm as a function of time, and what it tells.

Sticks are (throttle, steer) in [−1, 1]: ahead and to starboard are positive. A manoeuvre draws its
dice in an order that does not depend on the time grid: finer sampling is the same manoeuvre.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.random import Generator

from sim.excitation.limits import Limits
from sim.state import Floats

if TYPE_CHECKING:
    from sim.vessel import Vessel

Leg = tuple[float, float, float]  # seconds, throttle, steer: held


class Stick(IntEnum):
    """Columns of an array of sticks: (..., 2) in [−1, 1]."""

    THROTTLE = 0
    STEER = 1


class Manoeuvre(ABC):
    """One family of excitations; its options are the fields of the final class."""

    name: ClassVar[str]
    tells: ClassVar[str]  # which parameter or effect shows in it, in one line

    @property
    @abstractmethod
    def seconds(self) -> float:
        """How long it takes [s]; played for longer it begins again."""

    @abstractmethod
    def sticks(self, time: Floats, dice: Generator) -> Floats:
        """Times (T,) in [0, seconds) [s] -> throttle and steer (T, 2) in [−1, 1]."""

    def suited(self, vessel: "Vessel", limits: Limits) -> "Manoeuvre":
        """The same manoeuvre with options that suit a vessel under those limits."""
        return self


def held(time: Floats, legs: Sequence[Leg]) -> Floats:
    """Legs one after the other, at times (T,) [s] -> throttle and steer (T, 2)."""
    seconds, *sticks = np.array(legs, dtype=float).T
    ends = np.cumsum(seconds)
    row = np.searchsorted(ends, np.asarray(time) + 1e-9, side="right")
    return np.stack(sticks, axis=-1)[np.minimum(row, len(ends) - 1)]


def lasting(legs: Sequence[Leg]) -> float:
    """How long legs take [s]."""
    return float(sum(seconds for seconds, _, _ in legs))
