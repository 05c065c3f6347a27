"""How long a vessel takes to turn once round.

Full circles either way at two speeds. How long a circle takes depends on the vessel.

Helm from side to side at two speeds (after Kempf's zigzag, open loop).

On the spot to starboard and to port, coasting after each.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Leg, Limits, Manoeuvre, held, lasting
from sim.excitation.sticks import helm_gain, mixed, within_travel
from sim.model import Model
from sim.state import Eta, Floats
from sim.vessel import Vessel

if TYPE_CHECKING:
    from sim.vessel import Vessel

DT = 0.1  # s
LONGEST, SHORTEST = 120.0, 8.0  # s


def seconds_of_a_turn(vessel: Vessel, limits: Limits, throttle: float, steer: float) -> float:
    """Sticks held -> when the bow has been round [s]: the slower of the two ways to begin.

    From rest, and out of a steady turn to the other side; slew is allowed for. Two minutes at most.
    """
    helm = min(helm_gain(vessel) * steer * limits.steer, limits.steer)
    ahead, count = throttle * limits.throttle, round(LONGEST / DT)
    other, turn = within_travel(vessel, np.array([[ahead, -helm], [ahead, helm]]))
    before = np.stack([np.zeros(2), other])  # (2, 2): one row per run
    sticks = np.concatenate([np.repeat(row[:, None], count, axis=1)
                             for row in (before, np.stack([turn, turn]))], axis=1)  # fmt: skip
    yaw = Model.of(vessel).simulate(mixed(vessel, sticks), DT)[0][:, count:, Eta.YAW]
    round_it = np.abs(yaw - yaw[:, :1]) >= 2.0 * np.pi
    steps = np.where(round_it.any(axis=1), round_it.argmax(axis=1), count)
    eased = max(2.0 * helm / limits.steer_rate, ahead / limits.throttle_rate)
    return min(max(float(steps.max()) * DT + eased, SHORTEST), LONGEST)


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
