"""On the spot to starboard and to port, coasting after each."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, final

from numpy.random import Generator

from sim.excitation.limits import Limits
from sim.excitation.manoeuvre import Leg, Manoeuvre, held, lasting
from sim.state import Floats

if TYPE_CHECKING:
    from sim.vessel import Vessel

CREEPING = 0.2  # throttle: a blade turns nothing without a flow


@final
@dataclass(frozen=True)
class Spin(Manoeuvre):
    """Helm hard over for `hold` [s], all neutral for `coast` [s]; no throttle unless it must."""

    name: ClassVar = "spin"
    tells: ClassVar = (
        "yaw alone: m33, N_r, N_rr; left against right: imbalance, misalignment; "
        "sway with it: cross damping, centre of gravity, antenna"
    )
    helm: float = 0.5
    throttle: float = 0.0
    hold: float = 12.0
    coast: float = 8.0

    @property
    def legs(self) -> list[Leg]:
        """Seconds, throttle, steer."""
        coast = (self.coast, 0.0, 0.0)
        return [leg for side in (1, -1)
                for leg in ((self.hold, self.throttle, side * self.helm), coast)]  # fmt: skip

    @property
    def seconds(self) -> float:
        return lasting(self.legs)

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        return held(time, self.legs)

    def suited(self, vessel: "Vessel", limits: Limits) -> Manoeuvre:
        return replace(self, throttle=CREEPING) if vessel.rudders else self
