"""Thruster imbalance: the thrusters on one side pull more, or less, than those on the other.

    F → port_gain F         for thrusters with y < 0, if it is these that changed
    F → (2 − port_gain) F   for thrusters with y > 0, if it is these (starboard = 1)

port_gain − 1 [-] is the difference between the two sides as a share of what is modelled. Two thirds
of the thrust on one side turn a boat as one and a half times as much on the other, but leave her
slower: which side it is tells what the hull is like. Valid for: a damaged propeller, a worn motor,
weed on one side; ahead and astern alike. Source: Fossen, Handbook of Marine Craft Hydrodynamics,
2nd ed. 2021, ch. 9 (thrust coefficient matrix).
"""

from typing import Any

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Kind,
    Need,
    Parameter,
    Scope,
    Separation,
)
from sim.effects.words import FittedValues


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust -> thrust [N]."""
    port, starboard = (drive.y < 0.0) * (1.0 - p.starboard), (drive.y > 0.0) * p.starboard
    return F * (1.0 + (port - starboard) * (p.port_gain - 1.0))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    if p.values.get("starboard", 0.0) > 0.0:
        size = p.scaled("port_gain", "weaker", "harder")
        return f"beside the port motor, the starboard motor pushes {size}"
    size = p.scaled("port_gain", "harder", "weaker")
    return f"beside the starboard motor, the port motor pushes {size}"


EFFECT = Effect(
    name="thruster_imbalance",
    scope=Scope.BOAT,
    thrust=thrust,
    needs=(Need.PORT_THRUSTER,),
    parameters=(
        Parameter(
            "port_gain", "-", lower=0.0, upper=2.0, start=1.0, scale=0.02, neutral=1.0, reached=2.0
        ),
        Parameter(
            "starboard",
            "-",
            lower=0.0,
            upper=1.0,
            start=0.0,
            scale=1.0,
            kind=Kind.CHOICE,
            starts=(0.0, 1.0),
            default=0.0,
            description="0: the port motors are not as modelled; 1: those to starboard are not",
        ),
    ),
    looks_like="pulls to one side in proportion to the throttle, on every heading, and to the "
    "other side astern",
    mistaken_for=("thruster_misalignment", "steering_offset", "cg_offset", "steady_wind"),
    evidence=EvidenceAxis(ForceAxis.YAW, "throttle"),
    separated={
        "thruster_misalignment": Separation(
            "spin on the spot to the left and to the right, and go astern", "reversals"
        )
    },
    in_words=in_words,
)
