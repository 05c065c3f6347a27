"""Manoeuvres one after the other (the paper's mixed excitation)."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.chirp import Chirp
from sim.excitation.circles import Circles
from sim.excitation.limits import Limits
from sim.excitation.manoeuvre import Manoeuvre
from sim.excitation.random import Random
from sim.excitation.spin import Spin
from sim.excitation.steps import Steps
from sim.excitation.zigzag import Zigzag
from sim.state import Floats

if TYPE_CHECKING:
    from sim.vessel import Vessel


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
