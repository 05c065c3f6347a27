"""Manoeuvres drawn by a seed: random levels, and a hand on the stick. For validation."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator
from scipy.interpolate import PchipInterpolator

from sim.excitation.manoeuvre import Manoeuvre, held_sticks
from sim.state import Floats


@final
@dataclass(frozen=True)
class Random(Manoeuvre):
    """Levels held for 2 to 6 s (the paper's random excitation); ranges are lowest and highest."""

    name: ClassVar = "random"
    reveals: ClassVar = "a bit of everything at many frequencies; for validation"
    throttle: tuple[float, float] = (-0.3, 0.9)
    steer: tuple[float, float] = (-0.4, 0.4)
    hold: tuple[float, float] = (2.0, 6.0)
    seconds: float = 120.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        count = int(np.ceil(self.seconds / self.hold[0]))  # enough, however short they are
        ranges = (self.hold, self.throttle, self.steer)
        seconds, throttle, steer = (rng.uniform(*ends, count).tolist() for ends in ranges)
        return held_sticks(time, list(zip(seconds, throttle, steer, strict=True)))


@final
@dataclass(frozen=True)
class Joystick(Manoeuvre):
    """The stick moves to a new place within `move` [s] and rests there for `rest` [s].

    Smooth and monotone between places, without overshoot (PCHIP, Fritsch and Butland 1984). Ranges
    are lowest and highest.
    """

    name: ClassVar = "joystick"
    reveals: ClassVar = "what a pilot does by hand: slow changes, little astern; for validation"
    throttle: tuple[float, float] = (-0.1, 0.8)
    steer: tuple[float, float] = (-0.35, 0.35)
    move: tuple[float, float] = (0.7, 2.0)
    rest: tuple[float, float] = (1.0, 5.0)
    seconds: float = 120.0

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        return np.stack([self._axis(time, rng, ends) for ends in (self.throttle, self.steer)], -1)

    def _axis(self, time: Floats, rng: Generator, ends: tuple[float, float]) -> Floats:
        count = int(np.ceil(self.seconds / (self.move[0] + self.rest[0])))
        spans = np.stack([rng.uniform(*self.move, count), rng.uniform(*self.rest, count)], -1)
        knots = np.concatenate([[0.0], np.cumsum(spans)])
        places = np.concatenate([[0.0], np.repeat(rng.uniform(*ends, count), 2)])
        return PchipInterpolator(knots, places)(time)
