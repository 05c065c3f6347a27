"""Payload change: from one moment on the boat is heavier, or lighter.

    M → factor M   for t >= time

time [s after the first sample], factor [-]. All inertia, added mass included, changes alike;
velocity does not jump. Valid for: loads that come aboard, or are dropped, within a second or two
and change draught little. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch.
3 (rigid-body mass matrix).
"""

from typing import Any

from sim.body import Flow
from sim.effects.effect import (
    TIME_OF_CHANGE,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Shown,
)
from sim.effects.words import FittedValues
from sim.state import Inertia


def inertia(M: Inertia, flow: Flow, p: Any) -> Inertia:
    """Mass matrix and time -> mass matrix [kg, kg m, kg m²]."""
    f = 1.0 + (flow.time >= p.time) * (p.factor - 1.0)
    return Inertia(f * M.m11, f * M.m12, f * M.m13, f * M.m22, f * M.m23, f * M.m33)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    weight = p.side("factor", " heavier", " lighter", 1.0)
    changed = p.size("factor", "%", 100.0, 1.0, after=weight)
    return f"the boat is {changed} from {p.moment('time')} on"


EFFECT = Effect(
    name="payload_change",
    scope=Scope.VOYAGE,
    inertia=inertia,
    parameters=(
        Parameter("factor", "-", lower=0.3, upper=3.0, start=1.0, scale=0.05, neutral=1.0),
        TIME_OF_CHANGE,
    ),
    looks_like="from one moment on slow to speed up, to turn and to stop (or quicker), with the "
    "same top speed",
    mistaken_for=("drag_growth", "thruster_fault"),
    shown_by=(Shown.CHANGE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "acceleration"),
    in_words=in_words,
)
