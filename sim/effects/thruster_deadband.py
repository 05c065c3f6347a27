"""Thruster dead-band: a small command does not turn the propeller.

    c → sign(c) max(|c| − width, 0) / (1 − width)

width [-] of the command in [−1, 1]. Full command still gives full thrust. Valid for: speed
controllers with a dead zone around neutral. Source: Tao and Kokotović, Adaptive Control of Systems
with Actuator and Sensor Nonlinearities, 1996 (dead-zones).
"""

from typing import Any

import numpy as np

from sim.body import ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Separation
from sim.effects.words import FittedValues


def command(c: float, drive: ThrusterParameters, p: Any) -> float:
    """Command -> command that turns the propeller [−1 … 1]."""
    return np.sign(c) * np.maximum(np.abs(c) - p.width, 0.0) / (1.0 - p.width)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"the motors do not answer the first {p.size('width', '%', 100.0)} of throttle"


EFFECT = Effect(
    name="thruster_deadband",
    scope=Scope.BOAT,
    command=command,
    parameters=(
        Parameter("width", "-", lower=0.0, upper=0.6, start=0.05, scale=0.01, neutral=0.0),
    ),
    looks_like="does not answer small commands; nearly right at full throttle",
    mistaken_for=("thrust_curve",),
    evidence=EvidenceAxis(ForceAxis.SURGE, "throttle"),
    separated={
        "thrust_curve": Separation(
            "a slow ramp of the throttle through neutral and up to full", "ramp"
        )
    },
    in_words=in_words,
)
