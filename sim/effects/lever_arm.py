"""Lever arm: the motors are nearer to the centre line, or further from it, than the file says.

    N = −y F cos α → −gain y F cos α        gain [-]

y and α are place to starboard [m] and azimuth [rad] of a thruster in the file (of one that is
steered: straight ahead), F its thrust [N]. Arms of half the length turn a boat as one turns who has
twice the moment of inertia and twice the damping in yaw: a boat is known well enough that this is
told only where her own numbers would have to move much further than they are known. Valid for: the
distance between two motors taken for that from the middle, motors moved to other brackets. Source:
Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (thruster configuration matrix).
"""

from typing import Any

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Need, Parameter, Scope, Separation
from sim.effects.words import FittedValues
from sim.state import Wrench

STRAIGHT = Separation(
    "steps of throttle on a straight course: there the arms of the motors play no part", "steps"
)


def reaction(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> Wrench:
    """Thrust -> moment beside that of the arm in the file [N m]."""
    return Wrench(0.0, 0.0, (1.0 - p.gain) * drive.y * F * np.cos(drive.azimuth))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    way = p.side("gain", "further from", "nearer to", 1.0)
    return "the motors are " + p.size(
        "gain", "%", 100.0, 1.0, f" {way} the centre line than in the file"
    )


EFFECT = Effect(
    name="lever_arm",
    scope=Scope.BOAT,
    reaction=reaction,
    needs=(Need.PORT_THRUSTER,),
    parameters=(
        Parameter("gain", "-", lower=0.1, upper=4.0, start=1.0, scale=0.05, neutral=1.0, least=0.1),
    ),
    looks_like="turns quicker, or slower, than modelled for the same difference between the "
    "motors, to both sides alike, and is right on a straight course",
    mistaken_for=("thrust_scale", "thruster_imbalance", "hull_lift"),
    evidence=EvidenceAxis(ForceAxis.YAW, "helm"),
    separated={
        "thrust_scale": STRAIGHT,
        "thruster_imbalance": Separation(
            "turns to the left and to the right: arms that are wrong show on both sides alike",
            "zigzag",
        ),
        "hull_lift": Separation(
            "turn on the spot, then the same turns at speed: a lift grows with the speed", "spin"
        ),
    },
    in_words=in_words,
)
