"""Payload change: from one moment on the boat is heavier, or lighter.

    M → factor M   for t >= time

time [s after the first sample], factor [-]. All inertia, added mass included, changes alike;
velocity does not jump. Valid for: loads that come aboard, or are dropped, within a second or two
and change draught little. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch.
3 (rigid-body mass matrix).
"""

from typing import NamedTuple

from sim.body import Flow
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Kind, Parameter, Scope, Shown
from sim.state import Inertia


class Parameters(NamedTuple):
    factor: float
    time: float


def inertia(M: Inertia, flow: Flow, p: Parameters) -> Inertia:
    """Mass matrix and time -> mass matrix [kg, kg m, kg m²]."""
    f = 1.0 + (flow.time >= p.time) * (p.factor - 1.0)
    return Inertia(f * M.m11, f * M.m12, f * M.m13, f * M.m22, f * M.m23, f * M.m33)


EFFECT = Effect(
    name="payload_change",
    scope=Scope.VOYAGE,
    inertia=inertia,
    parameters=(
        Parameter("factor", "-", lower=0.3, upper=3.0, start=1.0, scale=0.05, neutral=1.0),
        Parameter("time", "s", lower=0.0, upper=1e5, start=60.0, scale=5.0, kind=Kind.MOMENT,
                  says="after the first sample"),
    ),
    looks_like="from one moment on slow to speed up, to turn and to stop (or quicker), with the "
    "same top speed",
    mistaken_for=("drag_growth", "thruster_fault"),
    shown_by=(Shown.CHANGE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "acceleration"),
)  # fmt: skip
