"""Advance loss: a propeller that moves ahead pushes less, for the water comes to meet it.

    F → F max(1 − per_mps max(u_a, 0), 0)   for F > 0
    u_a = u cos α + v sin α

per_mps [s/m], u_a [m/s] the boat's speed through the water along the thruster's azimuth α (for one
that points ahead: u). Valid for: the first quadrant, advance ahead and thrust ahead; at 1 / per_mps
the propeller pushes no more. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021,
ch. 9 (K_T falls linearly with the advance number).
"""

from typing import Any

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.effects.words import FittedValues


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust and velocity through the water -> thrust [N]."""
    inflow = flow.u * np.cos(drive.azimuth) + flow.v * np.sin(drive.azimuth)
    left = np.maximum(1.0 - p.per_mps * np.maximum(inflow, 0.0), 0.0)
    return F * (1.0 + (F > 0.0) * (left - 1.0))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        f"the propellers lose {p.size('per_mps', '%', 100.0)} of their thrust with each m/s ahead"
    )


EFFECT = Effect(
    name="advance_loss",
    scope=Scope.BOAT,
    thrust=thrust,
    parameters=(
        Parameter("per_mps", "s/m", lower=0.0, upper=2.0, start=0.1, scale=0.02, neutral=0.0),
    ),
    looks_like="pulls away as modelled but tops out too slow; coasts down as modelled once the "
    "motors stop",
    mistaken_for=("cubic_drag", "towed_load"),
    evidence=EvidenceAxis(ForceAxis.SURGE, "surge"),
    in_words=in_words,
)
