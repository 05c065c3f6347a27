"""Steering scale: rudders and steered motors turn further, or less far, than the file says.

    δ → gain δ        δ of all rudders and steered motors [rad], gain [-]

Valid for: a servo arm or a linkage of another length, a servo whose travel was taken from its data
sheet; and, as long as no rudder stalls, one that pushes more or less than its area says. Source:
Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (rudders in proportion to their
angle).
"""

from typing import Any

from sim.body import RudderParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Need, Parameter, Scope, Separation
from sim.effects.words import FittedValues

AMIDSHIPS = Separation(
    "turns to both sides, and in each the helm amidships while she still turns: what is left then "
    "is the hull's",
    "zigzag",
)


def angle(δ: float, blade: RudderParameters, p: Any) -> float:
    """Angle -> angle [rad]."""
    return p.gain * δ


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"the steering turns {p.scaled('gain', 'further', 'less far')}"


EFFECT = Effect(
    name="steering_scale",
    scope=Scope.BOAT,
    angle=angle,
    needs=(Need.STEERING,),
    parameters=(
        Parameter(
            "gain", "-", lower=0.0, upper=3.0, start=1.0, scale=0.05, neutral=1.0, least=0.05
        ),
    ),
    looks_like="turns less, or more, than modelled for the same helm, to both sides alike",
    mistaken_for=("hull_lift", "cross_damping"),
    evidence=EvidenceAxis(ForceAxis.YAW, "helm"),
    separated={"hull_lift": AMIDSHIPS, "cross_damping": AMIDSHIPS},
    in_words=in_words,
)
