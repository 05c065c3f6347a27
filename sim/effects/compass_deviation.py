"""Compass deviation: iron and currents on board turn the compass, by heading.

    reported ψ = ψ + d,   d = b sin ψ + c cos ψ        b, c [rad]

Velocities over ground come from the GNSS, so reported u and v are the true ones turned by −d; as d
changes in a turn, so do they: u̇ gets + ḋ v, v̇ gets − ḋ u, with ḋ = (b cos ψ − c sin ψ) r. Valid
for: permanent magnetism, small angles. Source: Bowditch, American Practical Navigator, 2019,
chapters on compasses (semicircular deviation, coefficients B and C).
"""

from math import degrees, hypot
from typing import Any

import numpy as np

from sim.body import Report, with_heading_off
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Parameter, Scope, Separation, Shown
from sim.effects.words import FittedValues


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a compass that deviates reports it."""
    sine, cosine = np.sin(report.yaw), np.cos(report.yaw)
    d = p.b * sine + p.c * cosine
    d_dot = (p.b * cosine - p.c * sine) * report.r
    return with_heading_off(report, d, d_dot)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    most = degrees(hypot(p["b"], p["c"]))
    return f"the compass is turned by iron on board, by up to {most:.1f}° on some headings"


EFFECT = Effect(
    name="compass_deviation",
    scope=Scope.BOAT,
    observe=observe,
    parameters=(
        Parameter("b", "rad", lower=-0.6, upper=0.6, start=0.0, scale=0.02, neutral=0.0),
        Parameter(
            "c", "rad", lower=-0.6, upper=0.6, start=0.0, scale=0.02, neutral=0.0, sided=True
        ),
    ),
    looks_like="seems to crab to one side on some headings and to the other on the opposite ones; "
    "the crab angle is the same at any speed and astern",
    mistaken_for=("steady_current", "steady_wind", "heading_offset"),
    shown_by=(Shown.CIRCLES,),
    evidence=EvidenceAxis(ForceAxis.SWAY, "heading"),
    separated={
        "heading_offset": Separation(
            "full circles: a deviation changes with the heading, an offset does not", "circles"
        )
    },
    in_words=in_words,
)
