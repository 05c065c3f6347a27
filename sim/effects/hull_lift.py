"""Hull lift: skegs, demihulls and outboard legs work as foils while the boat moves ahead.

    Y = Y_uv u v + Y_ur u r,   N = N_uv u v + N_ur u r

Y_uv [N s²/m²], Y_ur, N_uv [N s²/m], N_ur [N s²]; u, v through the water [m/s], r [rad/s]. A foil at
the stern has Y_uv < 0, N_uv > 0, N_ur < 0. Valid for: drift angles below stall. Source: Blanke,
Ship Propulsion Losses Related to Automatic Steering and Prime Mover Control, 1981; Fossen, Handbook
of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 6 (terms in u v and u r).
"""

from typing import Any

from sim.body import Flow
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope
from sim.effects.words import FittedValues
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity through the water -> X, Y, N [N, N, N m]."""
    u, v, r = flow.u, flow.v, flow.r
    return Wrench(0.0, u * (p.Y_uv * v + p.Y_ur * r), u * (p.N_uv * v + p.N_ur * r))


def _coefficient(name: str, unit: str) -> Parameter:
    return Parameter(name, unit, lower=-5000.0, upper=5000.0, start=0.0, scale=5.0, neutral=0.0)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        "the hull lifts like a wing when it slips or turns at speed: it is pushed sideways and "
        "turned the more, the faster it goes"
    )


EFFECT = Effect(
    name="hull_lift",
    scope=Scope.BOAT,
    force=force,
    parameters=(
        _coefficient("Y_uv", "N s²/m²"),
        _coefficient("Y_ur", "N s²/m"),
        _coefficient("N_uv", "N s²/m"),
        _coefficient("N_ur", "N s²"),
    ),
    looks_like="turns and slips as modelled on the spot, less (or more) the faster the boat goes",
    mistaken_for=("cross_damping",),
    evidence=EvidenceAxis(ForceAxis.YAW, "sway"),
    in_words=in_words,
    pattern_for=("turn",),
)
