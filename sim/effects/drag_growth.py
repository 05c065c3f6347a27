"""Drag growth: weed gathers, or the hull fouls, and surge drag grows with time.

    X = rate t (X_u + X_uu |u|) u

rate [1/s], t [s after the first sample]. X_u, X_uu of the vessel, u through the water [m/s]. Valid
for: growth by a small factor; drag in sway and yaw hardly changes. Source: Molland, Turnock and
Hudson, Ship Resistance and Propulsion, 2nd ed. 2017, ch. 3 (fouling), taken as linear in time.
"""

from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Separation, Shown
from sim.effects.words import FittedValues
from sim.state import Wrench


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity through the water and time -> X, Y, N [N, N, N m]."""
    damping = (flow.body.X_u + flow.body.X_uu * np.abs(flow.u)) * flow.u
    return Wrench(p.rate * np.maximum(flow.time, 0.0) * damping, 0.0, 0.0)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"drag grows by {p.size('rate', '%', 6000.0)} a minute"


EFFECT = Effect(
    name="drag_growth",
    scope=Scope.VOYAGE,
    force=force,
    parameters=(
        Parameter("rate", "1/s", lower=0.0, upper=0.1, start=5e-4, scale=1e-4, neutral=0.0),
    ),
    looks_like="right at the start and slower and slower for the same throttle as time goes by; "
    "it also stops sooner",
    mistaken_for=("payload_change", "battery_sag", "thruster_fault"),
    shown_by=(Shown.CHANGE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "time"),
    separated={
        "payload_change": Separation(
            "the same run at the beginning and at the end, with a coast to a stop in each", "steps"
        )
    },
    in_words=in_words,
)
