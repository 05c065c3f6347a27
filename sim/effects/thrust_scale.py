"""Thrust scale: all motors push more, or less, than the vessel file says, everywhere alike.

    F → gain F        gain [-]

Motors that push two thirds move a boat as she would go who is one and a half times as heavy and as
hard to drive: a boat is known well enough that this is told only where her own numbers would have
to move much further than they are known. Valid for: a tired or another battery, fouled or other
propellers, a thrust that was measured at the bollard, or stands in the file in pounds or kilograms.
Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (thrust coefficient
matrix).
"""

import math
from typing import Any

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Separation,
    Values,
)
from sim.effects.words import FittedValues

UNITS_N = ((4.448, "pounds"), (9.807, "kilograms"))  # in which data sheets tell thrust
OF_A_UNIT = 0.15  # a factor so near to it may be it; chosen, as the next
OF_THE_GAIN = 0.5  # in logarithms: a mass that moves as far with a gain undoes it


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust -> thrust [N]."""
    return F * p.gain


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence; a factor between two units of force is told as that."""
    found = f"all motors push {p.scaled('gain', 'harder', 'weaker')}"
    for factor, unit in UNITS_N:
        if abs(p["gain"] / factor - 1.0) < OF_A_UNIT:
            return f"{found}, as if the thrust in the file were in {unit} and not in newtons"
    return found


def undone(values: Values, given: Any, fitted: Any) -> str:
    """Whether the mass moves along, at least half as far: motion tells thrust over mass alone."""
    gain, moved = math.log(values["gain"]), math.log(fitted.m11 / given.m11)
    if moved * gain <= 0.0 or abs(moved) < OF_THE_GAIN * abs(gain):
        return ""
    return (
        f"m11 goes along from {given.m11:.4g} to {fitted.m11:.4g} kg, and motion tells thrust over "
        "mass alone"
    )


EFFECT = Effect(
    name="thrust_scale",
    scope=Scope.BOAT,
    thrust=thrust,
    parameters=(
        Parameter(
            "gain",
            "-",
            lower=0.05,
            upper=15.0,
            start=1.0,
            scale=0.05,
            neutral=1.0,
            least=0.1,
            starts=(1.0, 4.0, 9.0),
        ),
    ),
    looks_like="slower to start, to turn and at the top than modelled, all in proportion to the "
    "throttle",
    mistaken_for=("battery_sag", "thruster_imbalance"),
    evidence=EvidenceAxis(ForceAxis.SURGE, "throttle"),
    separated={
        "battery_sag": Separation("one run with a full and one with a tired battery", "steps"),
        "thruster_imbalance": Separation(
            "straight runs at two throttles: motors that differ turn the boat", "steps"
        ),
    },
    undone=undone,
    in_words=in_words,
)
