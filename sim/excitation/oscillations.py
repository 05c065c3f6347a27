"""Throttle and helm swing as two sines of different period (the paper's sinusoidal excitation).

throttle = mean + swing sin(2πt / T₁)        steer = helm sin(2πt / T₂)

Helm and throttle swing faster and faster.

phase = 2π (f₀ t + ½ (f₁ − f₀) t² / T)      steer ∝ sin phase,  throttle ∝ sin 0.7 phase

Levels and times that nobody could foresee (the paper's random excitation).

Manoeuvres one after the other (the paper's mixed excitation).
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.legs import Steps
from sim.excitation.manoeuvre import Limits, Manoeuvre, held
from sim.excitation.turns import Circles, Spin, Zigzag
from sim.state import Floats

if TYPE_CHECKING:
    from sim.vessel import Vessel


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


@final
@dataclass(frozen=True)
class Random(Manoeuvre):
    """Each level is held for 2 to 6 s; ranges are lowest and highest."""

    name: ClassVar = "random"
    tells: ClassVar = "a bit of everything at many frequencies; for validation"
    throttle: tuple[float, float] = (-0.3, 0.9)
    steer: tuple[float, float] = (-0.4, 0.4)
    hold: tuple[float, float] = (2.0, 6.0)

    @property
    def seconds(self) -> float:
        return 120.0

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        count = int(np.ceil(self.seconds / self.hold[0]))  # enough, however short they are
        ranges = (self.hold, self.throttle, self.steer)
        seconds, throttle, steer = (dice.uniform(*ends, count).tolist() for ends in ranges)
        return held(time, list(zip(seconds, throttle, steer, strict=True)))


@final
@dataclass(frozen=True)
class Mixed(Manoeuvre):
    """Each part begins where the one before ended."""

    name: ClassVar = "mixed"
    tells: ClassVar = "all base parameters in one go; begin with this one"
    parts: tuple[Manoeuvre, ...] = (Steps(), Zigzag(), Circles(), Spin(), Chirp(), Random())

    @property
    def seconds(self) -> float:
        return sum(part.seconds for part in self.parts)

    def sticks(self, time: Floats, dice: Generator) -> Floats:
        out, start = np.zeros((len(time), 2)), 0.0
        for part in self.parts:
            into = time - start
            inside = (into >= 0.0) & (into < part.seconds)
            out[inside] = part.sticks(into[inside], dice)  # also where empty: the dice go on
            start += part.seconds
        return out

    def suited(self, vessel: "Vessel", limits: Limits) -> Manoeuvre:
        return replace(self, parts=tuple(part.suited(vessel, limits) for part in self.parts))
