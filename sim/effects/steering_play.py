"""Steering play: the rudder, or the steered motor, follows only what the helm turns beyond a gap.

    δ̇ = (e − clip(e, −play, play)) / 0.1 s,        e = δ_commanded − δ

play [rad] to either side, half the whole gap; one state δ [rad] per rudder. Within the gap nothing
moves; beyond it the blade is pushed along, the gap behind the helm, and as the helm comes back it
stays where it is until the gap is crossed: hysteresis, which no offset and no lag is. Valid for:
worn joints and cables, gears. Source: Tao and Kokotović, Adaptive Control of Systems with Actuator
and Sensor Nonlinearities, 1996 (backlash).
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
    Separation,
    Shown,
)
from sim.effects.words import DEG, FittedValues

FOLLOWS_S = 0.1  # chosen: what is pushed is there at once, as seen beside the turn of a boat


def angle_rate(angle: float, state: float, blade: RudderParameters, p: Any) -> float:
    """Commanded and acting angle [rad] -> rate of the acting angle [rad/s]."""
    off = angle - state
    return (off - np.minimum(np.maximum(off, -p.play), p.play)) / FOLLOWS_S


SMALL_AND_LARGE = Separation(
    "small swings of the helm to either side, then large ones at the same pace", "chirp"
)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (
        f"the steering has play: it follows only beyond {p.size('play', '°', DEG)} to either side"
    )


EFFECT = Effect(
    name="steering_play",
    scope=Scope.BOAT,
    angle_rate=angle_rate,
    needs=(Need.STEERING,),
    parameters=(
        Parameter(
            "play", "rad", lower=0.0, upper=0.5, start=0.05, scale=0.01, starts=(0.03, 0.08, 0.16)
        ),
    ),
    looks_like="holds on to a turn as the helm comes back, and does not answer small corrections",
    mistaken_for=("steering_lag", "steering_scale", "command_delay"),
    shown_by=(Shown.COMMANDS,),
    evidence=EvidenceAxis(ForceAxis.YAW, "helm_change"),
    separated=dict.fromkeys(("steering_lag", "steering_scale", "command_delay"), SMALL_AND_LARGE),
    in_words=in_words,
)
