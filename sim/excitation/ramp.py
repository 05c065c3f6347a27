"""A slow ramp of throttle through neutral, to both sides.

throttle = a triangle of height `level`: 0, +level, 0, −level, 0
"""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.random import Generator

from sim.excitation.manoeuvre import Manoeuvre
from sim.state import Floats


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
