"""Varying current: a tide or a seiche that swings to and fro along one line.

    V_c = speed sin(2π t / period + phase) (cos direction, sin direction)

speed [m/s] at its strongest, t [s after the first sample], period [s], phase [rad], direction
[rad from north]. Valid for: water that moves as one; one harmonic. Over much less than a period it
cannot be told from a steady current. Source: Fossen, Handbook of Marine Craft Hydrodynamics,
2nd ed. 2021, §10.3; Pugh and Woodworth, Sea-Level Science, 2014, ch. 4 (harmonics of the tide).
"""

from typing import Any

import numpy as np

from sim.effects.effect import (
    THIRDS,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    Role,
    Scope,
    Shown,
    circular_parameter,
)
from sim.effects.words import FittedValues
from sim.state import Pose, Water


def water(time: float, pose: Pose, p: Any) -> Water:
    """Time [s] -> velocity [m/s] and acceleration [m/s²] of the water."""
    omega = 2.0 * np.pi / p.period
    flow = p.speed * np.sin(omega * time + p.phase)
    change = p.speed * omega * np.cos(omega * time + p.phase)
    c, s = np.cos(p.direction), np.sin(p.direction)
    return Water(flow * c, flow * s, change * c, change * s)


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return (f"a current of up to {p.size('speed', 'm/s')} swings to and fro along "
            f"{p.towards('direction')} every {p['period']:.0f} s")  # fmt: skip


EFFECT = Effect(
    name="varying_current",
    scope=Scope.VOYAGE,
    water=water,
    parameters=(
        Parameter(
            "speed",
            "m/s",
            lower=0.0,
            upper=3.0,
            start=0.2,
            scale=0.05,
            neutral=0.0,
            direction="direction",
            description="at its strongest",
        ),
        circular_parameter("direction", "towards, clockwise from north", sided=True),
        Parameter(
            "period", "s", lower=20.0, upper=90000.0, start=300.0, scale=30.0, role=Role.PERIOD
        ),
        circular_parameter("phase", "at the first sample", scale=0.2, starts=THIRDS),
    ),
    looks_like="a velocity offset along one line in the world that swings from one side to the "
    "other as time goes by",
    mistaken_for=("steady_current", "current_change", "wind_change"),
    shown_by=(Shown.CHANGE,),
    general_of="steady_current",
    evidence=EvidenceAxis(ForceAxis.ALONG, "time"),
    in_words=in_words,
    pattern_for=("time",),
)
