"""Astern stall: a propeller that turns astern while the boat still runs ahead stalls.

    F → F max(1 − per_mps max(u_a − above, 0), 0)   for F < 0
    u_a = u cos α + v sin α

per_mps [s/m], above [m/s], u_a [m/s] the boat's speed through the water along the thruster's
azimuth α (for one that points ahead: u). Valid for: braking, the second half of a crash stop.
Source: Carlton, Marine Propellers and Propulsion, 4th ed. 2018, ch. 6 (four quadrants: thrust
breaks down between ahead and astern).
"""

from typing import Any

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Shown
from sim.effects.words import FittedValues


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust and velocity through the water -> thrust [N]."""
    inflow = flow.u * np.cos(drive.azimuth) + flow.v * np.sin(drive.azimuth)
    left = np.maximum(1.0 - p.per_mps * np.maximum(inflow - p.above, 0.0), 0.0)
    return F * (1.0 + (F < 0.0) * (left - 1.0))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (f"motors that go astern while the boat runs ahead lose {p.size('per_mps', '%', 100.0)} "
            f"of their thrust with each m/s above {p['above']:.1f} m/s")  # fmt: skip


EFFECT = Effect(
    name="astern_stall",
    scope=Scope.BOAT,
    thrust=thrust,
    parameters=(
        Parameter("per_mps", "s/m", lower=0.0, upper=5.0, start=0.3, scale=0.05, neutral=0.0),
        Parameter("above", "m/s", lower=0.0, upper=10.0, start=0.5, scale=0.1),
    ),
    looks_like="hardly brakes when the motors go astern at speed, and turns too little when only "
    "one does; backs as modelled from rest",
    mistaken_for=("reverse_loss",),
    shown_by=(Shown.ASTERN,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "astern"),
    in_words=in_words,
)
