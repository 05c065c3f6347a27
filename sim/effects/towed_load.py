"""Towed load: something on a line, a drogue or a float, that holds the boat at one point.

    (X, Y) = −drag |V| V,   N = x Y
    V = (u, v + x r) of the point (x, 0) through the water

drag [N s²/m²], x [m] ahead of the origin (astern: negative). Valid for: a taut, short line. A load
behind the stern also holds an unstable hull on its course. Source: Hoerner, Fluid-Dynamic Drag,
1965, ch. 3 (bodies in cross flow: drag ∝ V²).
"""

from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    COAST_DOWN,
    TURN_SLOW_AND_FAST,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
)
from sim.effects.words import FittedValues
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity through the water -> X, Y, N [N, N, N m]."""
    u, v = flow.u, flow.v + p.x * flow.r
    pull = -p.drag * np.sqrt(u * u + v * v)
    return Wrench(pull * u, pull * v, p.x * pull * v)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        f"something holds the boat {abs(p['x']):.1f} m {p.side('x', 'ahead of', 'aft of')} the "
        f"middle, with {p.size('drag', 'N')} at 1 m/s"
    )


EFFECT = Effect(
    name="towed_load",
    scope=Scope.VOYAGE,
    force=force,
    parameters=(
        Parameter("drag", "N s²/m²", lower=0.0, upper=2000.0, start=5.0, scale=2.0, neutral=0.0),
        Parameter(
            "x",
            "m",
            lower=-20.0,
            upper=20.0,
            start=-1.0,
            scale=0.2,
            description="ahead of the origin; start a fit on both sides",
        ),
    ),
    looks_like="too slow at speed, and swinging less (or more) behind the point that is held",
    mistaken_for=("advance_loss", "hull_lift", "cubic_drag"),
    alike="motors, a skeg or a keel that hold the hull at one point",
    evidence=EvidenceAxis(ForceAxis.SURGE, "surge"),
    separated={
        "advance_loss": COAST_DOWN,
        "hull_lift": COAST_DOWN,
        "cubic_drag": TURN_SLOW_AND_FAST,
    },
    in_words=in_words,
)
