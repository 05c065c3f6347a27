"""Throttle and helm jump between two levels each (the paper's square excitation)."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre
from sim.state import Floats


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
