"""Thrust curve: thrust grows with another power of the command than the vessel file says.

    c → sign(c) |c|^exponent

exponent [-], on top of the curve in the vessel file. exponent > 1: less thrust at half throttle; on
a linear curve, 2 makes it quadratic. Full throttle stays. Valid for: one curve for all thrusters,
the same ahead and astern. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch.
9 (thrust ∝ n |n|).
"""

from typing import Any

import numpy as np

from sim.body import ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.effects.words import FittedValues


def command(c: float, drive: ThrusterParameters, p: Any) -> float:
    """Command -> command that the curve of the vessel file takes [−1 … 1]."""
    return np.sign(c) * np.abs(c) ** p.exponent


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    half = 100.0 * 0.5 ** p["exponent"]
    return f"half throttle works like {half:.0f} % throttle"


EFFECT = Effect(
    name="thrust_curve",
    scope=Scope.BOAT,
    command=command,
    parameters=(
        Parameter("exponent", "-", lower=0.3, upper=4.0, start=1.0, scale=0.05, neutral=1.0),
    ),
    looks_like="right at full throttle, too slow (or too fast) at half, ahead and astern alike",
    mistaken_for=("thruster_deadband", "battery_sag", "cubic_drag"),
    evidence=EvidenceAxis(ForceAxis.SURGE, "throttle"),
    in_words=in_words,
    pattern_for=("thrust",),
)
