"""Helm and throttle swing faster and faster.

phase = 2π (f₀ t + ½ (f₁ − f₀) t² / T)      steer ∝ sin phase,  throttle ∝ sin 0.7 phase
"""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre
from sim.state import Floats


@final
@dataclass(frozen=True)
class Chirp(Manoeuvre):
    """From `low` to `high` [Hz] in `seconds`."""

    name: ClassVar = "chirp"
    tells: ClassVar = "lag against delay (a lag attenuates, a delay does not); m33, m11"
    low: float = 0.03
    high: float = 0.5
    mean: float = 0.5
    swing: float = 0.3
    helm: float = 0.3
    seconds: float = 60.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        rise = 0.5 * (self.high - self.low) / self.seconds
        phase = 2.0 * np.pi * (self.low * time + rise * time**2)
        throttle = self.mean + self.swing * np.sin(0.7 * phase)
        return np.stack([throttle, self.helm * np.sin(phase)], axis=-1)
