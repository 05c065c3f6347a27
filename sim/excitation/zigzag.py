"""Helm from side to side at two speeds (after Kempf's zigzag, open loop)."""

from dataclasses import dataclass
from typing import ClassVar, final

from numpy.random import Generator

from sim.excitation.manoeuvre import Leg, Manoeuvre, held, lasting
from sim.state import Floats


@final
@dataclass(frozen=True)
class Zigzag(Manoeuvre):
    """The helm lies over for `hold` [s], on the first and last side for half a swing."""

    name: ClassVar = "zigzag"
    tells: ClassVar = "yaw and sway: m33, m22, N_r, Y_v, cross damping; steering lag and offset"
    speeds: tuple[float, ...] = (0.5, 0.8)
    helm: float = 0.35
    hold: float = 5.0

    @property
    def legs(self) -> list[Leg]:
        """Seconds, throttle, steer."""
        sides = (1, -1, -1, 1, 1, -1)
        return [(self.hold, speed, side * self.helm) for speed in self.speeds for side in sides]

    @property
    def seconds(self) -> float:
        return lasting(self.legs)

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, self.legs)
