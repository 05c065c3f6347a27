"""Manoeuvres of turning: full circles, zigzag, on the spot."""

from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np

from sim.excitation.manoeuvre import Leg, LegManoeuvre, Manoeuvre, StickLimits
from sim.excitation.sticks import helm_gain, mix_sticks, within_travel
from sim.model import Model
from sim.state import Eta
from sim.vessel import Vessel

DT = 0.1  # s
MIN_TURN_S, MAX_TURN_S = 8.0, 120.0  # of a circle: beyond, a boat is taken not to come round
STEERAGE_THROTTLE = 0.2  # of a spin with a rudder, which turns nothing without a flow


def full_turn_seconds(vessel: Vessel, limits: StickLimits, throttle: float, steer: float) -> float:
    """Duration [s] of a full turn with sticks held: the slower of two starts.

    From rest, and out of a steady turn to the other side; slew is allowed for.
    """
    helm = min(helm_gain(vessel) * steer * limits.steer, limits.steer)
    ahead, count = throttle * limits.throttle, round(MAX_TURN_S / DT)
    other, turn = within_travel(vessel, np.array([[ahead, -helm], [ahead, helm]]))
    before = np.stack([np.zeros(2), other])  # (2, 2): one row per run
    sticks = np.concatenate([np.repeat(row[:, None], count, axis=1)
                             for row in (before, np.stack([turn, turn]))], axis=1)  # fmt: skip
    yaw = Model.of(vessel).simulate(mix_sticks(vessel, sticks), DT)[0][:, count:, Eta.YAW]
    turned = np.abs(yaw - yaw[:, :1]) >= 2.0 * np.pi
    steps = np.where(turned.any(axis=1), turned.argmax(axis=1), count)
    slew = max(2.0 * helm / limits.steer_rate, ahead / limits.throttle_rate)
    return min(max(float(steps.max()) * DT + slew, MIN_TURN_S), MAX_TURN_S)


@final
@dataclass(frozen=True)
class Circles(LegManoeuvre):
    """Full circles to starboard and to port at each speed, `holds` [s] as the vessel needs."""

    name: ClassVar = "circles"
    reveals: ClassVar = (
        "current, wind, heading offset, compass deviation: every heading, two speeds"
    )
    speeds: tuple[float, ...] = (0.4, 0.7)
    helm: float = 0.3
    holds: tuple[float, ...] = (20.0, 20.0)

    @property
    def legs(self) -> list[Leg]:
        pairs = list(zip(self.speeds, self.holds, strict=True))
        return [(hold, speed, side * self.helm) for speed, hold in pairs for side in (1, -1)]

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> Manoeuvre:
        holds = (full_turn_seconds(vessel, limits, speed, self.helm) for speed in self.speeds)
        return replace(self, holds=tuple(holds))


@final
@dataclass(frozen=True)
class Zigzag(LegManoeuvre):
    """Helm from side to side at two speeds (after Kempf's zigzag, open loop).

    It lies over for twice `hold` [s], on the first and the last side for half of that.
    """

    name: ClassVar = "zigzag"
    reveals: ClassVar = "yaw and sway: m33, m22, N_r, Y_v, cross damping; steering lag and offset"
    speeds: tuple[float, ...] = (0.5, 0.8)
    helm: float = 0.35
    hold: float = 5.0

    @property
    def legs(self) -> list[Leg]:
        sides = (1, -1, -1, 1, 1, -1)
        return [(self.hold, speed, side * self.helm) for speed in self.speeds for side in sides]


@final
@dataclass(frozen=True)
class Spin(LegManoeuvre):
    """Turns on the spot to starboard and to port: helm for `hold` [s], neutral for `coast` [s]."""

    name: ClassVar = "spin"
    reveals: ClassVar = (
        "yaw alone: m33, N_r, N_rr; left against right: imbalance, misalignment; "
        "sway with it: cross damping, centre of gravity, antenna"
    )
    helm: float = 0.5
    throttle: float = 0.0
    hold: float = 12.0
    coast: float = 8.0

    @property
    def legs(self) -> list[Leg]:
        coast = (self.coast, 0.0, 0.0)
        return [leg for side in (1, -1)
                for leg in ((self.hold, self.throttle, side * self.helm), coast)]  # fmt: skip

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> Manoeuvre:
        return replace(self, throttle=STEERAGE_THROTTLE) if vessel.rudders else self
