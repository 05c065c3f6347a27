"""Straight ahead, astern, ahead: full reversals, the throttle crossing neutral at speed."""

from dataclasses import dataclass
from typing import ClassVar, final

from numpy.random import Generator

from sim.excitation.manoeuvre import Leg, Manoeuvre, held, lasting
from sim.state import Floats


@final
@dataclass(frozen=True)
class Reversals(Manoeuvre):
    """Ahead, then astern, at two levels, each for `hold` [s]."""

    name: ClassVar = "reversals"
    tells: ClassVar = "thrust astern against ahead: reverse loss, astern stall; X_u, X_uu"
    levels: tuple[float, ...] = (0.5, 0.8)
    hold: float = 10.0

    @property
    def legs(self) -> list[Leg]:
        """Seconds, throttle, steer."""
        return [
            (self.hold, side * level, 0.0)
            for level in self.levels
            for side in (1.0, -1.0, 1.0, -1.0)
        ]

    @property
    def seconds(self) -> float:
        return lasting(self.legs)

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, self.legs)
