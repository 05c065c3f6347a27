"""Full circles either way at two speeds. How long a circle takes depends on the vessel."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, final

from numpy.random import Generator

from sim.excitation.limits import Limits
from sim.excitation.manoeuvre import Leg, Manoeuvre, held, lasting
from sim.excitation.turning import seconds_of_a_turn
from sim.state import Floats

if TYPE_CHECKING:
    from sim.vessel import Vessel


@final
@dataclass(frozen=True)
class Circles(Manoeuvre):
    """`holds` [s] of a circle at each speed, to starboard and then to port."""

    name: ClassVar = "circles"
    tells: ClassVar = "current, wind, heading offset, compass deviation: every heading, two speeds"
    speeds: tuple[float, ...] = (0.4, 0.7)
    helm: float = 0.3
    holds: tuple[float, ...] = (20.0, 20.0)

    @property
    def legs(self) -> list[Leg]:
        """Seconds, throttle, steer."""
        pairs = list(zip(self.speeds, self.holds, strict=True))
        return [(hold, speed, side * self.helm) for speed, hold in pairs for side in (1, -1)]

    @property
    def seconds(self) -> float:
        return lasting(self.legs)

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, self.legs)

    def suited(self, vessel: "Vessel", limits: Limits) -> Manoeuvre:
        holds = (seconds_of_a_turn(vessel, limits, speed, self.helm) for speed in self.speeds)
        return replace(self, holds=tuple(holds))
