"""Steering offset: amidships is not straight ahead.

    δ → δ + angle        δ of all rudders and steered motors [rad], angle [rad]

Positive turns the bow to starboard when going ahead. Valid for: a trim that is off, a linkage that
slipped. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, (rudder bias and
integral action against it).
"""

from typing import Any

from sim.body import RudderParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Need, Parameter, Scope, Separation
from sim.effects.words import DEG, FittedValues


def angle(δ: float, blade: RudderParameters, p: Any) -> float:
    """Angle -> angle [rad]."""
    return δ + p.angle


TWO_THROTTLES = Separation(
    "straight runs at two throttles, then coast with the helm amidships", "steps"
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "amidships, the steering stands " + p.size(
        "angle", "°", DEG, after=" to " + p.side("angle", "starboard", "port")
    )


EFFECT = Effect(
    name="steering_offset",
    scope=Scope.BOAT,
    angle=angle,
    needs=(Need.STEERING,),
    parameters=(
        Parameter(
            "angle", "rad", lower=-0.5, upper=0.5, start=0.0, scale=0.02, neutral=0.0, sided=True
        ),
    ),
    looks_like="turns to one side with the rudder amidships, the more the faster it goes",
    mistaken_for=("thruster_imbalance", "thruster_misalignment"),
    evidence=EvidenceAxis(ForceAxis.YAW, "surge"),
    separated={"thruster_imbalance": TWO_THROTTLES, "thruster_misalignment": TWO_THROTTLES},
    in_words=in_words,
)
