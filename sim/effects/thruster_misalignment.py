"""Thruster misalignment: all thrusters point a little to one side.

    α → α + angle

α azimuth of a thruster [rad], angle [rad], clockwise positive. Valid for: brackets bent or mounted
askew alike; where all motors are steered an offset of the steering is the same. Source: Fossen,
Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (thruster configuration matrix).
"""

from typing import Any

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Need, Parameter, Scope
from sim.effects.words import DEG, FittedValues


def turn(azimuth: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Direction of a thruster -> direction [rad]."""
    return azimuth + p.angle


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "the motors point " + p.size(
        "angle", "°", DEG, after=" to " + p.side("angle", "starboard", "port")
    )


EFFECT = Effect(
    name="thruster_misalignment",
    scope=Scope.BOAT,
    turn=turn,
    needs=(Need.FIXED_MOTOR,),
    parameters=(
        Parameter(
            "angle", "rad", lower=-0.8, upper=0.8, start=0.0, scale=0.02, neutral=0.0, sided=True
        ),
    ),
    looks_like="pulls to one side and slips sideways in proportion to the throttle, on every "
    "heading, and the other way astern",
    mistaken_for=("thruster_imbalance", "steering_offset", "cg_offset", "steady_wind"),
    evidence=EvidenceAxis(ForceAxis.SWAY, "throttle"),
    in_words=in_words,
)
