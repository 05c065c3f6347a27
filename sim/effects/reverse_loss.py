"""Reverse loss: astern the propellers give another thrust than the vessel file says.

    F → factor F   for F < 0        factor [-]

Valid for: propellers made for going ahead, at any speed. Source: Fossen, Handbook of Marine Craft
Hydrodynamics, 2nd ed. 2021, ch. 9 (thrust coefficients differ ahead and astern).
"""

from typing import Any

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Separation, Shown
from sim.effects.words import FittedValues


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust -> thrust [N]."""
    return F * (1.0 + (F < 0.0) * (p.factor - 1.0))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"astern the motors push {p.scaled('factor', 'harder', 'weaker')}"


EFFECT = Effect(
    name="reverse_loss",
    scope=Scope.BOAT,
    thrust=thrust,
    parameters=(
        Parameter("factor", "-", lower=0.0, upper=2.0, start=0.8, scale=0.05, neutral=1.0),
    ),
    looks_like="right ahead, but brakes and backs weaker (or stronger) than modelled, and so turns "
    "otherwise on the spot",
    mistaken_for=("astern_stall",),
    shown_by=(Shown.ASTERN,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "astern"),
    separated={
        "astern_stall": Separation(
            "astern from rest, and astern while still running ahead", "reversals"
        )
    },
    in_words=in_words,
)
