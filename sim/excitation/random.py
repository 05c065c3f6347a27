"""Levels and times that nobody could foresee (the paper's random excitation)."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre, held
from sim.state import Floats


@final
@dataclass(frozen=True)
class Random(Manoeuvre):
    """Each level is held for 2 to 6 s; ranges are lowest and highest."""

    name: ClassVar = "random"
    tells: ClassVar = "a bit of everything at many frequencies; for validation"
    throttle: tuple[float, float] = (-0.3, 0.9)
    steer: tuple[float, float] = (-0.4, 0.4)
    hold: tuple[float, float] = (2.0, 6.0)

    @property
    def seconds(self) -> float:
        return 120.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        count = int(np.ceil(self.seconds / self.hold[0]))  # enough, however short they are
        ranges = (self.hold, self.throttle, self.steer)
        seconds, throttle, steer = (dice.uniform(*ends, count).tolist() for ends in ranges)
        return held(time, list(zip(seconds, throttle, steer, strict=True)))
