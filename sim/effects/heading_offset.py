"""Heading offset: the compass reads a constant angle too much (a rotated sensor, declination).

    reported ψ = ψ + angle            angle [rad]

Velocities over ground come from the GNSS, so reported u and v are the true ones turned by −angle:
the boat seems to crab. Valid for: any heading. Source: Groves, Principles of GNSS, Inertial and
Multisensor Integrated Navigation Systems, 2nd ed. 2013, §6.1.
"""

from typing import Any

import numpy as np

from sim.body import Report, with_heading_off
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Shown
from sim.effects.words import DEG, FittedValues

# The mean heading of a voyage is hardly known better, however well the compass is calibrated.
ACCURACY = float(np.radians(1.0))


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a turned compass reports it."""
    return with_heading_off(report, p.angle, 0.0)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return "the compass reads " + p.size(
        "angle", "°", DEG, after=" too far to " + p.side("angle", "starboard", "port")
    )


EFFECT = Effect(
    name="heading_offset",
    scope=Scope.BOAT,
    observe=observe,
    parameters=(
        Parameter(
            "angle",
            "rad",
            lower=-0.8,
            upper=0.8,
            start=0.0,
            scale=0.02,
            neutral=0.0,
            sided=True,
            least=ACCURACY,
        ),
    ),
    looks_like="sideways speed in proportion to forward speed, on every heading, other sign astern",
    mistaken_for=("steady_current", "compass_deviation", "cg_offset"),
    shown_by=(Shown.OPPOSITE,),
    evidence=EvidenceAxis(ForceAxis.SWAY, "surge"),
    in_words=in_words,
)
