"""The list of all manoeuvres, one line each; the first is several of them in one."""

from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre, StickLimits
from sim.excitation.sequences import (
    Chirp,
    Constant,
    Joystick,
    MotorsOff,
    Ramp,
    Random,
    Reversals,
    Sinusoid,
    Square,
    Steps,
)
from sim.excitation.turns import Circles, Spin, Zigzag
from sim.state import Floats
from sim.vessel import Vessel


@final
@dataclass(frozen=True)
class Mixed(Manoeuvre):
    """Manoeuvres one after the other (the paper's mixed excitation)."""

    name: ClassVar = "mixed"
    reveals: ClassVar = "all base parameters in one go; begin with this one"
    parts: tuple[Manoeuvre, ...] = (Steps(), Zigzag(), Circles(), Spin(), Chirp(), Random())

    @property
    def seconds(self) -> float:
        return sum(part.seconds for part in self.parts)

    def sticks(self, time: Floats, rng: Generator) -> Floats:
        out, start = np.zeros((len(time), 2)), 0.0
        for part in self.parts:
            into = time - start
            inside = (into >= 0.0) & (into < part.seconds)
            out[inside] = part.sticks(into[inside], rng)  # also where empty: it draws all the same
            start += part.seconds
        return out

    def adapted_to(self, vessel: Vessel, limits: StickLimits) -> Manoeuvre:
        return replace(self, parts=tuple(part.adapted_to(vessel, limits) for part in self.parts))


MANOEUVRES: tuple[Manoeuvre, ...] = (
    Mixed(),
    Steps(),
    Reversals(),
    Zigzag(),
    Ramp(),
    Chirp(),
    Circles(),
    Spin(),
    MotorsOff(),
    Sinusoid(),
    Square(),
    Constant(),
    Random(),
    Joystick(),
)
BY_NAME = {manoeuvre.name: manoeuvre for manoeuvre in MANOEUVRES}
