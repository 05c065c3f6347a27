"""Motors off: the boat drifts.

Throttle and helm held (the paper's constant excitation).

Throttle up and down in steps, ahead and astern, coasting in between, a little helm both ways.

Throttle and helm jump between two levels each (the paper's square excitation).

A slow ramp of throttle through neutral, to both sides.

throttle = a triangle of height `level`: 0, +level, 0, −level, 0

Straight ahead, astern, ahead: full reversals, the throttle crossing neutral at speed.
"""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Leg, Manoeuvre, held, lasting
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


@final
@dataclass(frozen=True)
class Square(Manoeuvre):
    """Periods in seconds, not multiples of one another: all four corners come up."""

    name: ClassVar = "square"
    tells: ClassVar = "lag and delay at the edges, damping on the plateaus: m11, m33, X_uu, N_r"
    high: float = 0.8
    low: float = 0.2
    helm: float = 0.3
    throttle_period: float = 24.0
    helm_period: float = 15.0

    @property
    def seconds(self) -> float:
        return 120.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        upper = time % self.throttle_period < 0.5 * self.throttle_period
        starboard = time % self.helm_period < 0.5 * self.helm_period
        helm = np.where(starboard, self.helm, -self.helm)
        return np.stack([np.where(upper, self.high, self.low), helm], axis=-1)


@final
@dataclass(frozen=True)
class Ramp(Manoeuvre):
    """One way from ahead to astern takes half of `seconds`."""

    name: ClassVar = "ramp"
    tells: ClassVar = "small commands: dead-band, thrust curve, trim; drag at every speed"
    level: float = 0.5
    seconds: float = 100.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        corners = self.seconds * np.array([0.0, 0.25, 0.75, 1.0])
        throttle = np.interp(time, corners, (0.0, self.level, -self.level, 0.0))
        return np.stack([throttle, np.zeros_like(throttle)], axis=-1)


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
