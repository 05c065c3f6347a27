"""Learned time history: what changes as time goes by, as a table that measurements filled.

    y(t), z(t) = linear between nine knots t_k = k T / 8, constant beyond them
    acts 1 (water)    the water flows at y to the north and z to the east
    acts 2 (push)     X, Y = F (y, z) turned to the heading, N = x_F Y
    acts 3 (thrust)   F_i → F_i (1 + y)

f0 … f8 are y at the knots, g0 … g8 z: m/s, or shares of the scale F [N], `full`, or of the thrust
F_i of each motor; T [s] `until`, the length of the recording; x_F [m] the place `x` where a push
acts. Valid for: that recording, and changes slower than T / 8. A table explains nothing: batteries
that warm up, a wind that rises and falls, a tide look like this. Source: Ljung, System
Identification, 2nd ed. 1999, §5.4 (basis functions with local support).

Its knots stay where they are: moved to where it bends they would follow a boat from one place to
the next, and tell as time what is of the place.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Kind,
    Parameter,
    Scope,
    Shown,
    Values,
)
from sim.effects.table_parameters import ARM, FULL, knots
from sim.effects.tables import (
    KNOTS,
    NAMES,
    PUSH,
    UNITS,
    WATER,
    along,
    bends,
    between_nine,
    flowing,
    push_scale,
    pushing,
    vector_text,
)
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Pose, Water, Wrench

THRUST = 3.0
FIRST, SECOND = ([f"{c}{k}" for k in range(KNOTS)] for c in "fg")


@jitable
def first(time: float, p: Any) -> float:
    """y(t)."""
    return between_nine(
        along(time, 0.0, p.until), 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875,
        p.f0, p.f1, p.f2, p.f3, p.f4, p.f5, p.f6, p.f7, p.f8,
    )  # fmt: skip


@jitable
def second(time: float, p: Any) -> float:
    """z(t)."""
    return between_nine(
        along(time, 0.0, p.until), 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875,
        p.g0, p.g1, p.g2, p.g3, p.g4, p.g5, p.g6, p.g7, p.g8,
    )  # fmt: skip


def water(time: float, pose: Pose, p: Any) -> Water:
    """Time -> velocity of the water [m/s]; no acceleration: it changes within minutes."""
    return flowing(p.acts, first(time, p), second(time, p))


def force(flow: Flow, p: Any) -> Wrench:
    """Time and heading -> X, Y, N [N, N, N m]."""
    return pushing(first(flow.time, p), second(flow.time, p), flow.yaw, p)


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust, time -> thrust [N]."""
    return F * (1.0 + (p.acts == THRUST) * first(flow.time, p))


def tables(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> Sequence[Values]:
    """Empty histories of water, of a push and of the thrust over the time that was sailed."""
    full = push_scale(vessel)
    acts = (WATER, PUSH, THRUST) if vessel.thrusters else (WATER, PUSH)
    return [
        {"acts": a, "until": extent["time"][1], "full": full, "x": 0.0,
         **dict.fromkeys((*FIRST, *SECOND), 0.0)}
        for a in acts
    ]  # fmt: skip


def in_words(p: FittedValues) -> str:
    """What the knots say that hold its shape."""
    times = np.linspace(0.0, p["until"], KNOTS)
    if p["acts"] == THRUST:
        what = "a share of the thrust that changes with the time"
        told = [f"{100.0 * p[key]:+.0f} %" for key in FIRST]
    else:
        scale = 1.0 if p["acts"] == WATER else p["full"]
        what = f"{NAMES[p['acts']]} differently as time goes by"
        told = [
            vector_text(scale * p[n], scale * p[e], UNITS[p["acts"]])
            for n, e in zip(FIRST, SECOND, strict=True)
        ]
    shown = (FIRST,) if p["acts"] == THRUST else (FIRST, SECOND)
    kept = bends(times, np.array([[p[key] for key in keys] for keys in shown]), KNOTS // 2 + 1)
    return f"{what}: {', '.join(f'{told[k]} at {times[k]:.0f} s' for k in kept)}"


EFFECT = Effect(
    name="learned_history",
    scope=Scope.VOYAGE,
    water=water,
    force=force,
    thrust=thrust,
    parameters=(
        Parameter(
            "acts", "1", lower=1.0, upper=3.0, start=1.0, kind=Kind.CHOICE,
            description="1 water, 2 a push, 3 share of the thrust",
        ),
        Parameter(
            "until", "s", lower=0.0, upper=1e6, start=0.0, kind=Kind.FIXED,
            description="last knot, after the first sample",
        ),
        FULL,
        ARM,
        *knots((*FIRST, *SECOND)),
    ),
    looks_like="changes as time goes by, by no law of the catalogue",
    shown_by=(Shown.CHANGE,),
    evidence=EvidenceAxis(ForceAxis.SURGE, "time"),
    tables=tables,
    in_words=in_words,
    example={
        "acts": 3.0, "until": 120.0, "full": 100.0, "x": 0.0,
        **{key: -0.05 * (KNOTS - k) for k, key in enumerate(FIRST)},
        **dict.fromkeys(SECOND, 0.0),
    },
    pattern="current_change",
    acts_when={
        "water": {"acts": (WATER,)}, "force": {"acts": (PUSH,)}, "thrust": {"acts": (THRUST,)},
    },
)  # fmt: skip
