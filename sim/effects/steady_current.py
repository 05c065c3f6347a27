"""Steady current: the water moves as one, in one direction, at one speed.

    V_c = speed (cos direction, sin direction)

speed [m/s], towards direction [rad from north]. Hull forces follow the velocity through the water.
Valid for: uniform, irrotational currents. Source: Fossen, Handbook of Marine Craft Hydrodynamics,
2nd ed. 2021, §10.3.
"""

from typing import NamedTuple

import numpy as np

from sim.effects.effect import Effect, Kind, Parameter, Scope, Shown
from sim.state import Pose, Water


class Parameters(NamedTuple):
    speed: float
    direction: float


def water(time: float, pose: Pose, p: Parameters) -> Water:
    """Anywhere, at any time -> velocity [m/s] and acceleration [m/s²] of the water."""
    return Water(p.speed * np.cos(p.direction), p.speed * np.sin(p.direction), 0.0, 0.0)


EFFECT = Effect(
    name="steady_current",
    scope=Scope.VOYAGE,
    water=water,
    parameters=(
        Parameter("speed", "m/s", lower=0.0, upper=3.0, start=0.2, scale=0.05, neutral=0.0),
        Parameter("direction", "rad", lower=-7.0, upper=7.0, start=0.0, scale=0.1,
                  kind=Kind.CIRCLE, says="towards, clockwise from north"),
    ),
    looks_like="a velocity offset that stays fixed in the world while the boat turns, "
    "whatever its speed",
    mistaken_for=(
        "varying_current", "steady_wind", "inertial_force", "heading_offset", "compass_deviation",
    ),
    shown_by=(Shown.OPPOSITE,),
)  # fmt: skip
