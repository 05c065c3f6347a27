"""Throttle and helm swing as two sines of different period (the paper's sinusoidal excitation).

throttle = mean + swing sin(2πt / T₁)        steer = helm sin(2πt / T₂)
"""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre
from sim.state import Floats


@final
@dataclass(frozen=True)
class Sinusoid(Manoeuvre):
    """Periods in seconds; both fit the length a whole number of times."""

    name: ClassVar = "sinusoid"
    tells: ClassVar = "inertia against damping at one frequency each: m11, m33, X_u, N_r"
    mean: float = 0.45
    swing: float = 0.4
    helm: float = 0.3
    throttle_period: float = 24.0
    helm_period: float = 15.0

    @property
    def seconds(self) -> float:
        return 120.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        turns = 2.0 * np.pi * time
        throttle = self.mean + self.swing * np.sin(turns / self.throttle_period)
        return np.stack([throttle, self.helm * np.sin(turns / self.helm_period)], axis=-1)
