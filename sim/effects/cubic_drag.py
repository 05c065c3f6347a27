"""Cubic surge drag: wave-making that rises faster than speed squared.

    X = X_uuu u³            X_uuu <= 0 [N s³/m³], u through the water [m/s]

Valid for: displacement speeds. Source: Fossen, Handbook of Marine Craft Hydrodynamics,
2nd ed. 2021, §6.4 (third-order damping of Abkowitz's expansion).
"""

from typing import Any

from sim.body import Flow
from sim.effects.effect import COAST_DOWN, Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.effects.words import FittedValues
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity through the water, scalars or arrays -> X, Y, N [N, N, N m]."""
    return Wrench(p.X_uuu * flow.u**3, 0.0, 0.0)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        f"drag rises more steeply at speed: {p.size('X_uuu', 'N')} more at 1 m/s, eight times "
        "that at 2 m/s"
    )


EFFECT = Effect(
    name="cubic_drag",
    scope=Scope.BOAT,
    force=force,
    parameters=(
        Parameter("X_uuu", "N s³/m³", lower=-500.0, upper=0.0, start=-1.0, scale=1.0, neutral=0.0),
    ),
    looks_like="too fast at full throttle, right at low speed",
    mistaken_for=("thrust_curve", "advance_loss"),
    evidence=EvidenceAxis(ForceAxis.SURGE, "surge"),
    separated={"thrust_curve": COAST_DOWN, "advance_loss": COAST_DOWN},
    in_words=in_words,
    pattern_for=("speed",),
)
