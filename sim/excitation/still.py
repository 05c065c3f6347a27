"""Motors off: the boat drifts."""

from dataclasses import dataclass
from typing import ClassVar, final

from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre, held
from sim.state import Floats


@final
@dataclass(frozen=True)
class Still(Manoeuvre):
    """Nobody touches anything."""

    name: ClassVar = "still"
    tells: ClassVar = "current and wind alone: the drift, and how the boat lies in it; sensor noise"
    seconds: float = 60.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, [(self.seconds, 0.0, 0.0)])
