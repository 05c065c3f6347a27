"""A hand on the stick: it moves on to a new place, rests there, moves on (joystick-like).

Smooth and monotone between places (PCHIP, Fritsch and Butland 1984): no overshoot.
"""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator
from scipy.interpolate import PchipInterpolator

from sim.excitation.manoeuvre import Manoeuvre
from sim.state import Floats


@final
@dataclass(frozen=True)
class Joystick(Manoeuvre):
    """Ranges are lowest and highest; `move` and `rest` [s]."""

    name: ClassVar = "joystick"
    tells: ClassVar = "what a pilot does by hand: slow changes, little astern; for validation"
    throttle: tuple[float, float] = (-0.1, 0.8)
    steer: tuple[float, float] = (-0.35, 0.35)
    move: tuple[float, float] = (0.7, 2.0)
    rest: tuple[float, float] = (1.0, 5.0)

    @property
    def seconds(self) -> float:
        return 120.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return np.stack([self._axis(time, dice, ends) for ends in (self.throttle, self.steer)], -1)

    def _axis(self, time: Floats, dice: Generator, ends: tuple[float, float]) -> Floats:
        count = int(np.ceil(self.seconds / (self.move[0] + self.rest[0])))
        spans = np.stack([dice.uniform(*self.move, count), dice.uniform(*self.rest, count)], -1)
        knots = np.concatenate([[0.0], np.cumsum(spans)])
        places = np.concatenate([[0.0], np.repeat(dice.uniform(*ends, count), 2)])
        return PchipInterpolator(knots, places)(time)
