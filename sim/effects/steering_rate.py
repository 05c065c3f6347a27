"""Steering rate: the rudder, or the steered motor, turns no faster than its gear can.

    δ̇ = clip(e / 0.1 s, −rate, rate),        e = δ_commanded − δ

rate [rad/s], alike to either side; one state δ [rad] per rudder. A small turn of the helm is there
at once, a large one takes its time, which no lag does. Valid for: servos under load, steering
motors, hydraulic gear. Source: Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, ch. 9
(steering machine with a limit of its rate; van Amerongen, 1982).
"""

from typing import Any

import numpy as np

from sim.body import RudderParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Need,
    Parameter,
    Scope,
    Shown,
)
from sim.effects.steering_play import FOLLOWS_S, SMALL_AND_LARGE
from sim.effects.words import DEG, FittedValues


def angle_rate(angle: float, state: float, blade: RudderParameters, p: Any) -> float:
    """Commanded and acting angle [rad] -> rate of the acting angle [rad/s]."""
    return np.minimum(np.maximum((angle - state) / FOLLOWS_S, -p.rate), p.rate)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"the steering turns no faster than {p.size('rate', '°/s', DEG)}"


EFFECT = Effect(
    name="steering_rate",
    scope=Scope.BOAT,
    angle_rate=angle_rate,
    needs=(Need.STEERING,),
    parameters=(
        Parameter(
            "rate", "rad/s", lower=0.01, upper=10.0, start=0.2, scale=0.05, starts=(0.1, 0.25, 0.6)
        ),
    ),
    looks_like="large turns of the helm take effect slowly, small ones at once",
    mistaken_for=("steering_lag", "steering_play", "command_delay"),
    shown_by=(Shown.COMMANDS,),
    evidence=EvidenceAxis(ForceAxis.YAW, "helm_change"),
    separated=dict.fromkeys(("steering_lag", "steering_play", "command_delay"), SMALL_AND_LARGE),
    in_words=in_words,
)
