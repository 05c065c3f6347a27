"""Steady current: the water moves as one, in one direction, at one speed.

    V_c = speed (cos direction, sin direction)

speed [m/s], towards direction [rad from north]. Hull forces follow the velocity through the water.
Valid for: uniform, irrotational currents. Source: Fossen, Handbook of Marine Craft Hydrodynamics,
2nd ed. 2021, §10.3.
"""

from typing import Any

import numpy as np

from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Separation,
    Shown,
    circular_parameter,
)
from sim.effects.words import FittedValues
from sim.state import Pose, Water


def water(time: float, pose: Pose, p: Any) -> Water:
    """Anywhere, at any time -> velocity [m/s] and acceleration [m/s²] of the water."""
    return Water(p.speed * np.cos(p.direction), p.speed * np.sin(p.direction), 0.0, 0.0)


DRIFT = Separation("drift with the motors off, then run one course at two speeds", "still")


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"a current of {p.size('speed', 'm/s')} sets towards {p.towards('direction')}"


EFFECT = Effect(
    name="steady_current",
    scope=Scope.VOYAGE,
    water=water,
    parameters=(
        Parameter(
            "speed",
            "m/s",
            lower=0.0,
            upper=3.0,
            start=0.2,
            scale=0.05,
            neutral=0.0,
            direction="direction",
        ),
        circular_parameter("direction", "towards, clockwise from north", sided=True),
    ),
    looks_like="a velocity offset that stays fixed in the world while the boat turns, "
    "whatever its speed",
    mistaken_for=(
        "varying_current",
        "current_change",
        "steady_wind",
        "inertial_force",
        "heading_offset",
        "compass_deviation",
    ),
    shown_by=(Shown.OPPOSITE,),
    of_each_day=True,
    evidence=EvidenceAxis(ForceAxis.SURGE, "heading"),
    separated={
        "varying_current": Separation(
            "stay out longer than one period: the same circles again and again", "circles"
        ),
        "steady_wind": DRIFT,
        "inertial_force": DRIFT,
        "heading_offset": Separation(
            "full circles at two speeds: one turns with the boat, the other stays with the "
            "compass rose",
            "circles",
        ),
        "compass_deviation": Separation(
            "full circles, ahead and astern: a deviation keeps its sign astern", "circles"
        ),
    },
    in_words=in_words,
    pattern_for=("place", "flow"),
)
