"""Lever arm: motors are nearer to the centre line, or further from it, than the file says.

    N = −y F cos α → −gain y F cos α        for all thrusters (side = 0), for those with y < 0
                                            (side = 1), or for those with y > 0 (side = 2)

gain [-]; y and α are place to starboard [m] and azimuth [rad] of a thruster in the file (of one
that is steered: straight ahead), F its thrust [N]. Arms of half the length turn a boat as one turns
who has twice the moment of inertia and twice the damping in yaw: a boat is known well enough that
this is told of all motors only where her own numbers would have to move much further than they are
known. An arm of one side alone turns her on every straight course. Valid for: the distance between
two motors taken for that from the middle, motors moved to other brackets. Source: Fossen, Handbook
of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (thruster configuration matrix).
"""

from typing import Any

import numpy as np

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
from sim.state import Wrench

STRAIGHT = Separation(
    "steps of throttle on a straight course: there the arms of the motors play no part", "steps"
)
WHO = ("the motors are", "the port motor is", "the starboard motor is")


def reaction(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> Wrench:
    """Thrust -> moment beside that of the arm in the file [N m]."""
    port, starboard = (p.side == 1.0) * (drive.y < 0.0), (p.side == 2.0) * (drive.y > 0.0)
    acts = (p.side == 0.0) + port + starboard
    return Wrench(0.0, 0.0, acts * (1.0 - p.gain) * drive.y * F * np.cos(drive.azimuth))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    way = p.side("gain", "further from", "nearer to", 1.0)
    who = WHO[int(p.values.get("side", 0.0))]
    return f"{who} " + p.size("gain", "%", 100.0, 1.0, f" {way} the centre line than in the file")


EFFECT = Effect(
    name="lever_arm",
    scope=Scope.BOAT,
    reaction=reaction,
    needs=(Need.PORT_THRUSTER,),
    parameters=(
        Parameter("gain", "-", lower=0.1, upper=4.0, start=1.0, scale=0.05, neutral=1.0, least=0.1),
        Parameter(
            "side",
            "-",
            lower=0.0,
            upper=2.0,
            start=0.0,
            scale=1.0,
            kind=Kind.CHOICE,
            starts=(0.0, 1.0, 2.0),
            default=0.0,
            description="0: all motors; 1: those to port; 2: those to starboard",
        ),
    ),
    looks_like="turns quicker, or slower, than modelled for the same difference between the "
    "motors, to both sides alike, and is right on a straight course; with one side alone off, "
    "pulls to one side in proportion to the throttle and is as fast as modelled",
    mistaken_for=("thrust_scale", "thruster_imbalance", "thruster_misalignment", "hull_lift"),
    evidence=EvidenceAxis(ForceAxis.YAW, "helm"),
    separated={
        "thrust_scale": STRAIGHT,
        "thruster_imbalance": Separation(
            "straight runs at two throttles: a motor that pulls less makes the boat slower, an arm "
            "does not",
            "steps",
        ),
        "thruster_misalignment": Separation(
            "straight runs ahead and astern: motors that point aside push the boat sideways",
            "reversals",
        ),
        "hull_lift": Separation(
            "turn on the spot, then the same turns at speed: a lift grows with the speed", "spin"
        ),
    },
    in_words=in_words,
)
