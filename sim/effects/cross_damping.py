"""Cross damping: turning pushes the hull sideways, and drifting turns it.

    Y = Y_r r,   N = N_v v

Y_r [N s], N_v [N s], r [rad/s], v through the water [m/s]. Either sign: it tells whether bow or
stern has the more grip. Valid for: small drift angles, low speed. Source: Fossen, Handbook of
Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 6 (linear damping, off-diagonal terms).
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
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity through the water -> X, Y, N [N, N, N m]."""
    return Wrench(0.0, p.Y_r * flow.r, p.N_v * flow.v)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        f"a turn pushes the hull sideways, and slipping turns it: {p.size('Y_r', 'N')} to "
        f"{p.side('Y_r', 'starboard', 'port')} at 1 rad/s to starboard"
    )


EFFECT = Effect(
    name="cross_damping",
    scope=Scope.BOAT,
    force=force,
    parameters=(
        Parameter("Y_r", "N s", lower=-2000.0, upper=2000.0, start=0.0, scale=5.0, neutral=0.0),
        Parameter("N_v", "N s", lower=-2000.0, upper=2000.0, start=0.0, scale=5.0, neutral=0.0),
    ),
    looks_like="slips sideways in every turn, also on the spot, to the side that the turn decides",
    mistaken_for=("cg_offset", "antenna_offset", "hull_lift"),
    evidence=EvidenceAxis(ForceAxis.SWAY, "turn_rate"),
    separated={
        "antenna_offset": Separation(
            "spin on the spot: an antenna moves although no force acts on the boat", "spin"
        ),
        "hull_lift": TURN_SLOW_AND_FAST,
    },
    in_words=in_words,
    pattern_for=("always",),
)
