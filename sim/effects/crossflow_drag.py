"""Cross-flow drag: every strip of the hull is dragged by the water that crosses it there.

    Y = −drag ( ⟨|V| V⟩ − |v| v ),   N = −drag ( ⟨x |V| V⟩ − ⟨x² |x|⟩ |r| r )
    V = v + x r,   ⟨ ⟩ the mean over the length, −L/2 … L/2

drag [N s²/m²] of the whole length where it moves straight sideways, ½ ρ C_d T L; v through the
water [m/s], r [rad/s]; L [m] the hull's length. What |v| v and |r| r hold alone is left out, for
Y_vv and N_rr hold it: what is new is that turning brakes a slip and slipping a turn, by −drag L²
|v| r / 6 where the hull slips faster than its ends swing. The mean is Gauss's of six strips. Valid
for: a hull alike at bow and stern. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed.
2021, §6.4 (strip theory); Faltinsen, Sea Loads on Ships and Offshore Structures, 1990, ch. 6 (the
cross-flow principle).
"""

from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    TURN_SLOW_AND_FAST,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
)
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Wrench

# Gauss and Legendre's six places between −1 and 1, half of them, and what each counts of the mean
NEAR, MID, FAR = 0.2386191860831969, 0.6612093864662645, 0.9324695142031521
OF_NEAR, OF_MID, OF_FAR = 0.2339569672863455, 0.1803807865240693, 0.0856622461895852


@jitable
def strip(v: float, r: float, x: float) -> tuple[float, float]:
    """Of the strips x ahead and x astern [m]: |V| V and x |V| V, beyond what v or r does alone."""
    ahead, astern = v + x * r, v - x * r
    a, b = np.abs(ahead) * ahead, np.abs(astern) * astern
    return a + b - 2.0 * np.abs(v) * v, x * (a - b) - 2.0 * x**2 * np.abs(x) * np.abs(r) * r


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity through the water -> X, Y, N [N, N, N m]."""
    half = 0.5 * flow.body.length
    near, n = strip(flow.v, flow.r, NEAR * half)
    mid, m = strip(flow.v, flow.r, MID * half)
    far, f = strip(flow.v, flow.r, FAR * half)
    Y = -p.drag * (OF_NEAR * near + OF_MID * mid + OF_FAR * far)
    return Wrench(0.0, Y, -p.drag * (OF_NEAR * n + OF_MID * m + OF_FAR * f))


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        "the hull is dragged strip by strip by the water that crosses it, so that slipping brakes "
        f"a turn: as by {p.size('drag', 'N')} on the whole side at 1 m/s"
    )


EFFECT = Effect(
    name="crossflow_drag",
    scope=Scope.BOAT,
    force=force,
    parameters=(
        Parameter("drag", "N s²/m²", lower=0.0, upper=2e4, start=20.0, scale=5.0, neutral=0.0),
    ),
    looks_like="turns as modelled on the spot, and less the more it slips sideways",
    mistaken_for=("hull_lift", "cross_damping", "cg_offset"),
    evidence=EvidenceAxis(ForceAxis.YAW, "sway"),
    separated=dict.fromkeys(("hull_lift", "cross_damping", "cg_offset"), TURN_SLOW_AND_FAST),
    in_words=in_words,
)
