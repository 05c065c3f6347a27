"""Learned reading: a sensor's error without a law, as a table over how the boat moves.

    y(x) = linear between nine knots x_k = low + a_k (high − low), constant beyond them
    acts 1 (heading)    reported ψ = ψ + y
    acts 2 (speed)      reported u, v = (1 + y) u, (1 + y) v
    acts 3 (yaw rate)   reported r = r + y

f0 … f8 are y at the knots [rad, 1 or rad/s]; a_0 = 0, a_8 = 1, and between them `at1` … `at7`:
k / 8 where nothing is said. The variable x is, by `by`: 1 speed ahead over ground [m/s], 2 yaw rate
[rad/s], 3 centripetal acceleration u r [m/s²], 4 heading [rad] from `low` all around. A heading
that is off by y turns the velocity that is reported on board by −y. So a compass that lags by τ is
y = −τ r, one that swings out in turns y over u r, and iron that a law of sines does not follow y
over ψ. Valid for: the range between `low` and `high` that was sailed. Source: Bowditch, American
Practical Navigator, 2019, chapters on compasses; Groves, Principles of GNSS, Inertial and
Multisensor Integrated Navigation Systems, 2nd ed. 2013, ch. 4 and 6 (scale factors, lags and
magnetometers).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.body import Report, with_heading_off
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Kind, Parameter, Scope, Values
from sim.effects.learned import table
from sim.effects.learned_formula import HEADING, knot_places
from sim.effects.table_parameters import INNER_KNOTS
from sim.effects.tables import EVENLY, KNOTS, knots_in_disorder, told_at_bends
from sim.effects.words import FittedValues

OF_HEADING, OF_SPEED, OF_YAW_RATE = 1.0, 2.0, 3.0
AHEAD, TURNING, SWINGING = 1.0, 2.0, 3.0  # HEADING as a table of `learned` has it
PAIRS = (  # of what it acts on and what it is over
    (OF_HEADING, TURNING), (OF_HEADING, SWINGING), (OF_HEADING, AHEAD), (OF_HEADING, HEADING),
    (OF_SPEED, AHEAD), (OF_YAW_RATE, TURNING),
)  # fmt: skip
NAMES = {AHEAD: "speed ahead", TURNING: "yaw rate", SWINGING: "centripetal acceleration",
         HEADING: "heading"}  # fmt: skip
DEGREE = math.pi / 180.0
UNITS = {AHEAD: ("m/s", 1.0), TURNING: ("°/s", DEGREE), SWINGING: ("m/s²", 1.0),
         HEADING: ("°", DEGREE)}  # fmt: skip
SLOPE_OVER = 0.01  # of the range, on either side


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a sensor that errs reports it."""
    ahead, turning = p.by == AHEAD, p.by == TURNING
    swinging, heading = p.by == SWINGING, p.by == HEADING
    x = ahead * report.u + turning * report.r + swinging * report.u * report.r
    x = x + heading * report.yaw
    x_dot = ahead * report.u_dot + turning * report.r_dot + heading * report.r
    x_dot = x_dot + swinging * (report.u_dot * report.r + report.u * report.r_dot)
    step = SLOPE_OVER * np.maximum(p.high - p.low, 1e-9)
    y = table(x, p)
    y_dot = (table(x + step, p) - table(x - step, p)) / (2.0 * step) * x_dot
    of_heading, of_speed = p.acts == OF_HEADING, p.acts == OF_SPEED
    k, k_dot = 1.0 + of_speed * y, of_speed * y_dot
    seen = with_heading_off(report, of_heading * y, of_heading * y_dot)
    return Report(
        seen.north,
        seen.east,
        seen.yaw,
        k * seen.u,
        k * seen.v,
        seen.r + (p.acts == OF_YAW_RATE) * y,
        k * seen.u_dot + k_dot * seen.u,
        k * seen.v_dot + k_dot * seen.v,
        seen.r_dot + (p.acts == OF_YAW_RATE) * y_dot,
    )


def tables(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> Sequence[Values]:
    """All empty tables that could be filled; `extent`: smallest and largest u, r and u r."""
    ranges = {AHEAD: extent["u"], TURNING: extent["r"], SWINGING: extent["swing"],
              HEADING: (0.0, 2.0 * math.pi)}  # fmt: skip
    return [
        {"by": by, "acts": acts, "low": ranges[by][0], "high": ranges[by][1],
         **EVENLY, **{f"f{k}": 0.0 for k in range(KNOTS)}}
        for acts, by in PAIRS
    ]  # fmt: skip


def mismatch(vessel: Any, values: Values) -> str:
    """Why a table is none; empty where it is one."""
    return knots_in_disorder(values)


def evidence_axis(values: Values) -> EvidenceAxis:
    """The missing force that such an error looks like, over the table's variable."""
    axis = {OF_SPEED: ForceAxis.SURGE, OF_YAW_RATE: ForceAxis.YAW}.get(
        values["acts"], ForceAxis.SWAY
    )
    drawn = {AHEAD: "surge", HEADING: "heading"}
    return EvidenceAxis(axis, drawn.get(values["by"], "turn_rate"))


def in_words(values: FittedValues) -> str:
    """The error at the knots that hold its shape."""
    by, acts = values["by"], values["acts"]
    unit, size = UNITS[by]
    places = knot_places(values)
    errors = [values[f"f{k}"] for k in range(KNOTS)]
    if by == HEADING:  # all around: the last knot is the first
        errors[-1] = errors[0]
    if acts == OF_SPEED:
        what, told = "the speed", [f"{100.0 * y:+.0f} %" for y in errors]
    elif acts == OF_YAW_RATE:
        what, told = "the yaw rate", [f"{y / DEGREE:+.2g} °/s" for y in errors]
    else:
        what, told = "the heading", [f"{y / DEGREE:+.1f}°" for y in errors]
    points = told_at_bends(told, places / size, np.array(errors), unit)
    return f"{what} that is reported is off with the {NAMES[by]}: {points}"


EFFECT = Effect(
    name="learned_reading",
    scope=Scope.BOAT,
    observe=observe,
    parameters=(
        Parameter(
            "by", "1", lower=1.0, upper=4.0, start=1.0, kind=Kind.CHOICE,
            description="1 speed ahead, 2 yaw rate, 3 centripetal acceleration, 4 heading",
        ),
        Parameter(
            "acts", "1", lower=1.0, upper=3.0, start=1.0, kind=Kind.CHOICE,
            description="1 heading, 2 speed, 3 yaw rate",
        ),
        Parameter(
            "low", "m/s, rad/s, m/s² or rad", lower=-50.0, upper=50.0, start=-1.0,
            kind=Kind.FIXED, description="first knot",
        ),
        Parameter(
            "high", "m/s, rad/s, m/s² or rad", lower=-50.0, upper=50.0, start=1.0,
            kind=Kind.FIXED, description="last knot",
        ),
        *INNER_KNOTS,
        *(
            Parameter(
                f"f{k}", "rad, 1 or rad/s", lower=-0.8, upper=0.8, start=0.0, scale=0.02,
                neutral=0.0,
            )
            for k in range(KNOTS)
        ),
    ),
    looks_like="follows how the boat moves as a sensor that errs would",
    evidence=evidence_axis,
    tables=tables,
    knot_places=tuple(EVENLY),
    mismatch=mismatch,
    in_words=in_words,
    example={
        "by": 2.0, "acts": 1.0, "low": -0.6, "high": 0.6, **EVENLY,
        "f0": 0.24, "f1": 0.18, "f2": 0.12, "f3": 0.06, "f4": 0.0, "f5": -0.06, "f6": -0.12,
        "f7": -0.18, "f8": -0.24,
    },
    pattern="compass_deviation",
)  # fmt: skip
