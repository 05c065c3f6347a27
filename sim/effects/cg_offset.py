"""CG offset: the centre of gravity does not lie at the origin of the body.

    M₂₃ = M₃₂ = … + mass x_g

mass [kg] of the hull, x_g [m] ahead of the origin. The Coriolis forces follow from M, so that at
speed the bow is pushed out of a turn where x_g > 0 and into it where x_g < 0: N = −mass x_g u r.
Valid for: offsets along the keel. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed.
2021, ch. 3 (rigid-body mass matrix about the origin).
"""

from typing import Any

from sim.body import Flow
from sim.effects.effect import (
    TURN_SLOW_AND_FAST,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Separation,
)
from sim.effects.words import FittedValues
from sim.state import Inertia


def inertia(M: Inertia, flow: Flow, p: Any) -> Inertia:
    """Mass matrix -> with the coupling of sway and yaw [kg, kg m, kg m²]."""
    m23 = M.m23 + flow.body.mass * p.x_g
    return Inertia(M.m11, M.m12, M.m13, M.m22, m23, M.m33)


SPINS_BOTH_WAYS = Separation("spin on the spot to the left and to the right, and go astern", "spin")


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "the centre of gravity lies " + p.size(
        "x_g", "m", after=p.side("x_g", " ahead of", " aft of") + " the middle"
    )


EFFECT = Effect(
    name="cg_offset",
    scope=Scope.BOAT,
    inertia=inertia,
    parameters=(Parameter("x_g", "m", lower=-2.0, upper=2.0, start=0.0, scale=0.02, neutral=0.0),),
    looks_like="sideways speed where a turn begins and ends, other sign when it ends, and a bow "
    "that is held out of or into every turn at speed",
    mistaken_for=(
        "cross_damping",
        "antenna_offset",
        "heading_offset",
        "thruster_imbalance",
        "thruster_misalignment",
    ),
    evidence=EvidenceAxis(ForceAxis.YAW, "turn_rate"),
    separated={
        "cross_damping": TURN_SLOW_AND_FAST,
        "antenna_offset": TURN_SLOW_AND_FAST,
        "heading_offset": Separation(
            "long straight runs, ahead and astern: an offset of the heading shows there", "steps"
        ),
        "thruster_imbalance": SPINS_BOTH_WAYS,
        "thruster_misalignment": SPINS_BOTH_WAYS,
    },
    in_words=in_words,
)
