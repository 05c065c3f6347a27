"""Which forces the thrusters of a vessel can give: allocation by pseudo-inverse, then clipping.

    τ = B F,   B columns (cos α, sin α, x sin α − y cos α),   F = clip(B⁺ τ, astern, ahead)

What no thruster can give (sway of a boat with two thrusters astern) is left out. Source: Fossen,
Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. 2021, §11.2.
"""

from typing import NamedTuple

import numpy as np

from sim.state import Floats, Tau
from sim.vessel import Thruster, Vessel


class Limits(NamedTuple):
    """allocate (n, 3), effect (3, n) [-, -, m], low and high (n,) [N] of n thrusters."""

    allocate: Floats
    effect: Floats
    low: Floats
    high: Floats

    @classmethod
    def none(cls) -> "Limits":
        """A virtual force, as large as it needs to be."""
        return cls(np.zeros((0, 3)), np.zeros((3, 0)), np.zeros(0), np.zeros(0))

    @classmethod
    def of(cls, vessel: Vessel) -> "Limits":
        """The limits of a vessel's thrusters; ValueError where they alone cannot turn it."""
        effect = np.array([_column(thruster) for thruster in vessel.thrusters]).T.reshape(3, -1)
        if np.linalg.matrix_rank(effect[[Tau.X, Tau.N]]) < 2:
            raise ValueError(
                f"following with limits needs thrusters that can push and turn the plant; "
                f"those of {vessel.name} cannot: set limits = false"
            )
        low, high = np.array([thruster.thrust for thruster in vessel.thrusters], dtype=float).T
        return cls(np.linalg.pinv(effect), np.ascontiguousarray(effect), low.copy(), high.copy())


def _column(t: Thruster) -> tuple[float, float, float]:
    """Wrench of one newton of a thruster -> X, Y, N [-, -, m]."""
    forward, starboard = float(np.cos(t.azimuth)), float(np.sin(t.azimuth))
    return forward, starboard, t.position[0] * starboard - t.position[1] * forward
