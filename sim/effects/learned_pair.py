"""Learned pair: a cause without a law that takes two variables, as a table filled by measurements.

    y(a, b) = bilinear between 4 × 4 knots, `a_low` to `a_high`, `b_low` to `b_high`; else constant
    acts 1 (surge)   X = y F          acts 2 (sway)   Y = y F, N = x_F Y
    acts 3 (yaw)     N = y F L / 2    acts 4 (thrust) F_i → F_i (1 + y)

h00 … h33 are y at the knots, row by row in a and in a row in b; F [N] the scale `full`; x_F [m] the
place `x` where a push acts; L [m] the hull's length. a is the speed ahead through the water, but
sideways for `by` 5; b is, by `by`: 1 the thrust of a motor as a share of its full thrust ahead
(then each motor has a force of its own), 2 the heading, its four knots all around, 3 the speed
sideways, 4 and 5 the yaw rate. Valid for: what was sailed together; knots that were hardly met
stay at nothing. A table explains nothing: a hull whose damping sideways grows with its way, seas
that stop a boat against them, propellers that draw air where they push hard and fast look like
this. Source: Ljung, System Identification, 2nd ed. 1999, §5.4 (basis functions with local support).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.body import Flow, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, Kind, Parameter, Scope, Values
from sim.effects.learned import acts_in_words, astern_share, wrench
from sim.effects.learned import evidence_axis as axis_of_table
from sim.effects.learned_formula import (
    AHEAD,
    HEADING,
    MOTOR,
    NAMES,
    SIDEWAYS,
    SURGE,
    SWAY,
    THRUST,
    TURNING,
    UNITS,
    YAW,
)
from sim.effects.table_parameters import ARM, FULL
from sim.effects.tables import along, between_sixteen, weights_of_four
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Wrench

SIDE = 4
KEYS = [f"h{i}{j}" for i in range(SIDE) for j in range(SIDE)]
WITH_MOTOR, WITH_HEADING, WITH_SWAY, WITH_TURN, SWAY_AND_TURN = 1.0, 2.0, 3.0, 4.0, 5.0
PAIRS = {
    WITH_MOTOR: (AHEAD, MOTOR),
    WITH_HEADING: (AHEAD, HEADING),
    WITH_SWAY: (AHEAD, SIDEWAYS),
    WITH_TURN: (AHEAD, TURNING),
    SWAY_AND_TURN: (SIDEWAYS, TURNING),
}
ACTS = {
    WITH_MOTOR: (SURGE, SWAY, YAW, THRUST),
    WITH_HEADING: (SURGE, SWAY, YAW),
    WITH_SWAY: (SURGE, SWAY, YAW),
    WITH_TURN: (SURGE, SWAY, YAW, THRUST),
    SWAY_AND_TURN: (SURGE, SWAY, YAW),
}


@jitable
def table(a: float, b: float, p: Any) -> float:
    """y(a, b) of the table; a heading has no end: its first knot follows its last."""
    around = p.by == WITH_HEADING
    turns = (b - p.b_low) / np.maximum(p.b_high - p.b_low, 1e-9)
    share = turns - around * np.floor(turns)
    w = weights_of_four(np.minimum(np.maximum(share * (1.0 + around / 3.0), 0.0), 1.0))
    # of the last quarter of a heading's way, from the last knot back to the first
    back = around * np.maximum(4.0 * share - 3.0, 0.0)
    w = (w[0] + back, w[1], w[2], w[3] - back)
    return between_sixteen(
        weights_of_four(along(a, p.a_low, p.a_high)), w,
        p.h00, p.h01, p.h02, p.h03, p.h10, p.h11, p.h12, p.h13,
        p.h20, p.h21, p.h22, p.h23, p.h30, p.h31, p.h32, p.h33,
    )  # fmt: skip


@jitable
def motion(flow: Flow, p: Any) -> tuple[float, float]:
    """Both variables of the hull's motion; zero for the second where it is a motor's thrust."""
    sideways = p.by == SWAY_AND_TURN
    a = (1.0 - sideways) * flow.u + sideways * flow.v
    turning = (p.by == WITH_TURN) + sideways
    return a, (p.by == WITH_HEADING) * flow.yaw + (p.by == WITH_SWAY) * flow.v + turning * flow.r


def force(flow: Flow, p: Any) -> Wrench:
    """Motion -> X, Y, N [N, N, N m]."""
    a, b = motion(flow, p)
    return wrench((p.by != WITH_MOTOR) * table(a, b, p), flow.body.length, p)


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust, motion -> thrust [N]."""
    a, b = motion(flow, p)
    b = b + (p.by == WITH_MOTOR) * F / np.maximum(drive.ahead, 1e-9)
    return F * (1.0 + (p.acts == THRUST) * table(a, b, p))


def reaction(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> Wrench:
    """Thrust of one motor, motion -> what comes with it on the hull [N, N, N m]."""
    share = F / np.maximum(drive.ahead, 1e-9)
    return wrench((p.by == WITH_MOTOR) * table(flow.u, share, p), flow.body.length, p)


def tables(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> Sequence[Values]:
    """All empty tables that could be filled; `extent`: smallest and largest value of u, v, r and,
    where they were recorded, of the motors' commands.
    """
    full = float(sum(t.thrust[1] for t in vessel.thrusters)) or 1.0
    astern = astern_share(vessel, extent)
    ranges = {AHEAD: extent["u"], SIDEWAYS: extent["v"], TURNING: extent["r"],
              HEADING: (0.0, 2.0 * math.pi), MOTOR: (astern, 1.0)}  # fmt: skip
    return [
        {"by": by, "acts": acts, "a_low": ranges[a][0], "a_high": ranges[a][1],
         "b_low": ranges[b][0], "b_high": ranges[b][1], "full": full, "x": 0.0,
         **dict.fromkeys(KEYS, 0.0)}
        for by, (a, b) in PAIRS.items() if vessel.thrusters or b != MOTOR
        for acts in ACTS[by] if vessel.thrusters or acts != THRUST
    ]  # fmt: skip


def evidence_axis(values: Values) -> EvidenceAxis:
    """The missing force of the table's axis over the second of its variables."""
    return axis_of_table({"acts": values["acts"], "by": PAIRS[values["by"]][1]})


def knots(values: FittedValues) -> tuple[list[float], list[float]]:
    """Where the knots are, in each of the variables."""
    around = values["by"] == WITH_HEADING
    a = np.linspace(values["a_low"], values["a_high"], SIDE)
    b = np.linspace(values["b_low"], values["b_high"], SIDE + around)[:SIDE]
    return a.tolist(), b.tolist()


def in_words(values: FittedValues) -> str:
    """Where it is surely strongest, and where it surely differs most from there."""
    y = np.array([values[key] for key in KEYS])
    ends = np.array([values.ci95.get(key, (f, f)) for key, f in zip(KEYS, y, strict=True)])
    half = 0.5 * (ends[:, 1] - ends[:, 0])
    a, b = PAIRS[values["by"]]
    what = f"{acts_in_words(values)} with the {NAMES[a]} and the {NAMES[b]}"
    strongest = int(np.argmax(np.abs(y) - half))
    if abs(y[strongest]) <= half[strongest]:
        best = int(np.argmax(np.abs(y) / np.maximum(half, 1e-12)))
        return f"{what}: {_at(values, y, best)}, though no single knot is sure"
    other = int(np.argmax(np.abs(y - y[strongest]) - half))
    told = [_at(values, y, strongest)]
    if abs(y[other] - y[strongest]) > half[other]:
        told.append(_at(values, y, other))
    return f"{what}: {', '.join(told)}"


def _at(values: FittedValues, y: Any, knot: int) -> str:
    """What a knot says, and where it is."""
    share = values["acts"] == THRUST
    size = f"{100.0 * y[knot]:+.0f} %" if share else f"{y[knot] * values['full']:+.3g} N"
    places = [
        f"{x[i] / UNITS[by][1]:.3g} {UNITS[by][0]}"
        for x, i, by in zip(knots(values), divmod(knot, SIDE), PAIRS[values["by"]], strict=True)
    ]
    return f"{size} at {' and '.join(places)}"


EFFECT = Effect(
    name="learned_pair",
    scope=Scope.BOAT,
    force=force,
    thrust=thrust,
    reaction=reaction,
    parameters=(
        Parameter(
            "by", "1", lower=1.0, upper=5.0, start=1.0, kind=Kind.CHOICE,
            description="speed ahead and 1 a motor's thrust, 2 heading, 3 speed sideways, "
            "4 yaw rate; 5 speed sideways and yaw rate",
        ),
        Parameter(
            "acts", "1", lower=1.0, upper=4.0, start=1.0, kind=Kind.CHOICE,
            description="1 surge, 2 sway, 3 yaw, 4 share of the thrust",
        ),
        *(
            Parameter(
                f"{which}_{end}", "m/s, rad/s, rad or 1", lower=-50.0, upper=50.0, start=start,
                kind=Kind.FIXED, description=f"{name} knot of the {order} variable",
            )
            for which, order in (("a", "first"), ("b", "second"))
            for end, name, start in (("low", "first", -1.0), ("high", "last", 1.0))
        ),
        FULL,
        ARM,
        *(
            Parameter(
                key, "1", lower=-2.0, upper=2.0, start=0.0, scale=0.1, neutral=0.0,
                prior=0.5,  # keeps knots at nothing where nothing was sailed
            )
            for key in KEYS
        ),
    ),
    looks_like="follows two variables together, by no law of the catalogue",
    contains="learned",
    evidence=evidence_axis,
    tables=tables,
    in_words=in_words,
    example={
        "by": 1.0, "acts": 4.0, "a_low": 0.0, "a_high": 2.0, "b_low": -1.0, "b_high": 1.0,
        "full": 100.0, "x": 0.0,
        **{key: -0.05 * (k // SIDE) * (k % SIDE) for k, key in enumerate(KEYS)},
    },
    pattern="hull_lift",
    acts_when={
        "force": {
            "by": (WITH_HEADING, WITH_SWAY, WITH_TURN, SWAY_AND_TURN), "acts": (SURGE, SWAY, YAW),
        },
        "thrust": {"acts": (THRUST,)},
        "reaction": {"by": (WITH_MOTOR,), "acts": (SURGE, SWAY, YAW)},
    },
)  # fmt: skip
