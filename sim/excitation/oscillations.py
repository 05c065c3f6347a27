"""Manoeuvres of sines: at fixed periods, and faster and faster."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre
from sim.state import Floats


@final
@dataclass(frozen=True)
class Sinusoid(Manoeuvre):
    """Throttle and helm swing at a period [s] each (the paper's sinusoidal excitation).

    throttle = mean + swing sin(2πt / T₁),  steer = helm sin(2πt / T₂)
    """

    name: ClassVar = "sinusoid"
    reveals: ClassVar = "inertia against damping at one frequency each: m11, m33, X_u, N_r"
    mean: float = 0.45
    swing: float = 0.4
    helm: float = 0.3
    throttle_period: float = 24.0
    helm_period: float = 15.0
    seconds: float = 120.0  # a whole number of both periods

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        turns = 2.0 * np.pi * time
        throttle = self.mean + self.swing * np.sin(turns / self.throttle_period)
        return np.stack([throttle, self.helm * np.sin(turns / self.helm_period)], axis=-1)


@final
@dataclass(frozen=True)
class Chirp(Manoeuvre):
    """Helm and throttle swing faster and faster, from `low` to `high` [Hz].

    phase = 2π (f₀ t + ½ (f₁ − f₀) t² / T),  steer ∝ sin phase,  throttle ∝ sin 0.7 phase
    """

    name: ClassVar = "chirp"
    reveals: ClassVar = "lag against delay (a lag attenuates, a delay does not); m33, m11"
    low: float = 0.03
    high: float = 0.5
    mean: float = 0.5
    swing: float = 0.3
    helm: float = 0.3
    seconds: float = 60.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        rise = 0.5 * (self.high - self.low) / self.seconds
        phase = 2.0 * np.pi * (self.low * time + rise * time**2)
        throttle = self.mean + self.swing * np.sin(0.7 * phase)
        return np.stack([throttle, self.helm * np.sin(phase)], axis=-1)
