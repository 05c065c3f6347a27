"""Throttle up and down in steps, ahead and astern, coasting in between, a little helm both ways."""

from dataclasses import dataclass
from typing import ClassVar, final

from numpy.random import Generator

from sim.excitation.manoeuvre import Leg, Manoeuvre, held, lasting
from sim.state import Floats


@final
@dataclass(frozen=True)
class Steps(Manoeuvre):
    """Each level is held for `hold` [s], neutral (coasting) for `coast` [s]."""

    name: ClassVar = "steps"
    tells: ClassVar = (
        "surge: m11, X_u, X_uu; accelerating against coasting parts drag from thrust (advance loss)"
    )
    levels: tuple[float, ...] = (0.3, 0.6, 0.9, 0.45, 0.0, -0.4, 0.2, 1.0, 0.0, 0.5)
    helm: float = 0.1
    hold: float = 8.0
    coast: float = 12.0

    @property
    def legs(self) -> list[Leg]:
        """Seconds, throttle, steer."""
        return [
            (self.hold, level, self.helm * (-1) ** k) if level else (self.coast, 0.0, 0.0)
            for k, level in enumerate(self.levels)
        ]

    @property
    def seconds(self) -> float:
        return lasting(self.legs)

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, self.legs)
