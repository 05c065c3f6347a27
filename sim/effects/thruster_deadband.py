"""Thruster dead-band: a small command does not turn the propeller.

    c → sign(c) (jump |c| + (1 − jump) (|c| − width) / (1 − width))   where |c| > width, else 0

width [-] of the command in [−1, 1]. jump [-]: 0, what lies beyond the dead-band is rescaled, so
that thrust begins at zero; 1, the propeller starts at once with all that is commanded, as a motor
does that needs a least voltage to start. Full command gives full thrust either way. A jump is
spread over a tenth of the width, so that a search can follow it. Valid for: speed controllers with
a dead zone around neutral, motors that stick. Source: Tao and Kokotović, Adaptive Control of
Systems with Actuator and Sensor Nonlinearities, 1996 (dead-zones).
"""

from typing import Any

import numpy as np

from sim.body import ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Separation
from sim.effects.words import FittedValues

SPREAD = 0.1  # of the width, over which a jump comes: chosen, not measured
NONE = 1e-9  # of the command: keeps a width of zero from dividing by it


def command(c: float, drive: ThrusterParameters, p: Any) -> float:
    """Command -> command that turns the propeller [−1 … 1]."""
    beyond = np.maximum(np.abs(c) - p.width, 0.0)
    started = np.minimum(beyond / (SPREAD * p.width + NONE), 1.0)
    rescaled = beyond / (1.0 - p.width)
    return np.sign(c) * (p.jump * started * np.abs(c) + (1.0 - p.jump) * rescaled)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    size = p.size("width", "%", 100.0)
    return f"the motors do not answer the first {size} of throttle{_beyond(p)}"


def _beyond(p: FittedValues) -> str:
    """How thrust begins behind the dead-band, where the data tell it."""
    low, high = p.ci95.get("jump", (p["jump"], p["jump"]))
    if low > 0.5:
        return ", and beyond that give at once what is commanded"
    return ", and beyond that begin gently" if high < 0.5 else ""


EFFECT = Effect(
    name="thruster_deadband",
    scope=Scope.BOAT,
    command=command,
    parameters=(
        Parameter(
            "width",
            "-",
            lower=0.0,
            upper=0.6,
            start=0.05,
            scale=0.01,
            neutral=0.0,
            starts=(0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4),
        ),
        Parameter(
            "jump",
            "-",
            lower=0.0,
            upper=1.0,
            start=0.0,
            scale=0.2,
            starts=(0.0, 1.0),
            default=0.0,
        ),
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
