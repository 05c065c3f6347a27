"""Throttle and helm held (the paper's constant excitation)."""

from dataclasses import dataclass
from typing import ClassVar, final

from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre, held
from sim.state import Floats


@final
@dataclass(frozen=True)
class Constant(Manoeuvre):
    """One steady turn."""

    name: ClassVar = "constant"
    tells: ClassVar = "steady speed and turn rate: thrust against drag alone, no inertia"
    throttle: float = 0.6
    steer: float = 0.1
    seconds: float = 60.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, [(self.seconds, self.throttle, self.steer)])
