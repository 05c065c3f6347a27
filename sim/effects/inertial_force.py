"""Inertial force: a force from nowhere, fixed in the world, the same whatever the boat does.

    (X, Y) = Rᵀ(ψ) force (cos direction, sin direction),   N = 0

force [N] towards direction [rad from north], attacking at the origin of the body. Valid for: what
pulls or pushes evenly, such as wind on a slow boat. Source: Saldarriaga-Mesa et al., Robotics
2025, 14(9), 124, Table 8 (disturbances of current and wind).
"""

from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Scope,
    Shown,
    circular_parameter,
)
from sim.effects.words import FittedValues
from sim.state import Wrench, to_body


def force(flow: Flow, p: Any) -> Wrench:
    """Heading -> X, Y, N [N, N, N m]."""
    X, Y = to_body(p.force * np.cos(p.direction), p.force * np.sin(p.direction), flow.yaw)
    return Wrench(X, Y, 0.0)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return f"a steady force of {p.size('force', 'N')} pushes towards {p.towards('direction')}"


EFFECT = Effect(
    name="inertial_force",
    scope=Scope.VOYAGE,
    force=force,
    parameters=(
        Parameter(
            "force",
            "N",
            lower=0.0,
            upper=1000.0,
            start=5.0,
            scale=1.0,
            neutral=0.0,
            direction="direction",
        ),
        circular_parameter("direction", "towards, clockwise from north", sided=True),
    ),
    looks_like="a missing force of one size and one direction in the world, at any speed and on "
    "any heading",
    mistaken_for=("steady_current", "steady_wind"),
    shown_by=(Shown.OPPOSITE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "heading"),
    in_words=in_words,
)
