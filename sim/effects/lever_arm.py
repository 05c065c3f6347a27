"""Lever arm: motors are nearer to the middle of the boat, or further from it, than the file says.

    N = F (x sin α − y cos α),      y → gain y for all thrusters (which = 0), for those with y < 0
                                    (1), for those with y > 0 (2); or x → gain x for all (3)

gain [-]; x, y and α are place ahead and to starboard [m] and azimuth [rad] of a thruster, F its
thrust [N]. Arms of half the length turn a boat as one turns who has twice the moment of inertia and
twice the damping in yaw: a boat is known well enough that this is told of all motors only where her
own numbers would have to move much further than they are known. An arm of one side alone turns her
on every straight course. Valid for: the distance between two motors taken for that from the middle,
a steered motor whose place is told from the bow, motors moved to other brackets. Source: Fossen,
Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9 (thruster configuration matrix).
"""

from collections.abc import Callable
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
    ResidualForce,
    Scope,
    Separation,
    Values,
)
from sim.effects.words import FittedValues
from sim.state import Wrench

STRAIGHT = Separation(
    "steps of throttle on a straight course: arms of both sides alike neither turn the boat there "
    "nor make her slower",
    "steps",
)
WHOSE = (
    ("the motors are", "the centre line"),
    ("the motors to port are", "the centre line"),
    ("the motors to starboard are", "the centre line"),
    ("the motors are", "midships"),
)
ATHWART, ALONG = (0.0, 1.0, 2.0), 3.0


def reaction(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> Wrench:
    """Thrust -> moment beside that of the arm in the file [N m]."""
    of_side = (p.which == 1.0) * (drive.y < 0.0) + (p.which == 2.0) * (drive.y > 0.0)
    athwart = -drive.y * np.cos(drive.azimuth) * ((p.which == 0.0) + of_side)
    along = drive.x * np.sin(drive.azimuth) * (p.which == ALONG)
    return Wrench(0.0, 0.0, (p.gain - 1.0) * F * (athwart + along))


def arms_of(vessel: Any, residual: Callable[[], ResidualForce]) -> list[Values]:
    """Where a search begins: the arms that turn this boat."""
    sides = {np.sign(t.position[1]) for t in vessel.thrusters} - {0.0}
    athwart = ATHWART if len(sides) > 1 else ATHWART[: len(sides)]
    which = (*athwart, *((ALONG,) if vessel.has_arms_along else ()))
    return [{"gain": 1.0, "which": one} for one in which]


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    who, where = WHOSE[int(p.values.get("which", 0.0))]
    way = p.side("gain", "further from", "nearer to", 1.0)
    return f"{who} " + p.size("gain", "%", 100.0, 1.0, f" {way} {where} than in the file")


EFFECT = Effect(
    name="lever_arm",
    scope=Scope.BOAT,
    reaction=reaction,
    needs=(Need.ARM,),
    parameters=(
        Parameter("gain", "-", lower=0.1, upper=4.0, start=1.0, scale=0.05, neutral=1.0, least=0.1),
        Parameter(
            "which",
            "-",
            lower=0.0,
            upper=ALONG,
            start=0.0,
            scale=1.0,
            kind=Kind.CHOICE,
            default=0.0,
            description="distance from the centre line of all motors (0), of those to port (1), "
            "to starboard (2); from midships (3)",
        ),
    ),
    looks_like="turns quicker, or slower, than modelled for the same difference between the "
    "motors, to both sides alike, and is right on a straight course; with one side alone off, "
    "pulls to one side in proportion to the throttle and is as fast as modelled",
    mistaken_for=(
        "thrust_scale",
        "thruster_imbalance",
        "thruster_misalignment",
        "hull_lift",
        "steering_scale",
    ),
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
        "steering_scale": Separation(
            "spin up with the helm over, from rest: a boat that is pushed less to the side drifts "
            "less",
            "zigzag",
        ),
    },
    search=arms_of,
    in_words=in_words,
)
