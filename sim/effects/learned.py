"""Learned curve: a cause without a law, as a table over one variable that measurements filled in.

    y(x) = linear between nine knots x_k = low + a_k (high − low), constant beyond them
    acts 1 (surge)   X = y F          acts 2 (sway)   Y = y F, N = x_F Y
    acts 3 (yaw)     N = y F L / 2    acts 4 (thrust) F_i → F_i (1 + y)
    acts 5 (angle)   δ → δ + y        acts 6 (outward) Y = ±y F_i, N = x_F Y

f0 … f8 are y at the knots; a_0 = 0, a_8 = 1, and between them `at1` … `at7`: k / 8 where nothing is
said, for once a table is filled its knots are moved to where it bends. F [N] is the scale `full`;
x_F [m] the place `x` where a push acts; L [m] the hull's length; F_i [N] the thrust of motor i. The
variable x is, by `by`: 1 speed ahead through the water [m/s], 2 speed sideways [m/s], 3 yaw rate
[rad/s], 4 heading [rad] from `low` all around, 5 the thrust of a motor as a share of its full
thrust ahead (then each motor has a force of its own), 6 the angle δ [rad] commanded of a rudder or
steered motor, 7 the voltage of the battery [V], for thrust alone and where it was measured. What
goes outward is mirrored: + of a motor to starboard, − of one to port, 0 amidships. Valid for: the
range between `low` and `high` that was sailed; a table explains nothing, and holds no further than
its data. Source: Ljung, System Identification, 2nd ed. 1999, §5.4 (basis functions with local
support); Jupp, SIAM J. Numer. Anal. 15, 1978 (knots that are free).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.body import Flow, RudderParameters, ThrusterParameters
from sim.effects.effect import Effect, EvidenceAxis, ForceAxis, Kind, Parameter, Scope, Values
from sim.effects.learned_formula import (
    AHEAD,
    ANGLE,
    BATTERY,
    DRAWN_AGAINST,
    HEADING,
    MOTOR,
    NAMES,
    OUTWARD,
    RUDDER,
    SIDEWAYS,
    SURGE,
    SWAY,
    THRUST,
    TURNING,
    UNITS,
    YAW,
    formula_source,
    formulas,
    knot_places,
)
from sim.effects.table_parameters import ARM, FULL, INNER_KNOTS
from sim.effects.tables import EVENLY, KNOTS, along, between_nine, knots_in_disorder, told_at_bends
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Wrench

OF_TRIM = 0.02  # of full throttle: a neutral that is a little off
LEAST_SAG = 0.05  # of the highest voltage: less tells of no battery; chosen, not measured
LEAST = 1e-3  # of the largest of a curve's values: less is none
LEVEL = 1 / 6  # of the largest value: a table that changes by less is told as one that does not
AFT = 0.4  # hull lengths behind the origin, where skegs and rudders stand


@jitable
def table(x: float, p: Any) -> float:
    """y(x) of the table."""
    span = np.maximum(p.high - p.low, 1e-9)
    around = p.by == HEADING
    turns = np.floor((x - p.low) / span)
    x = x - around * turns * span  # a heading has no end
    share, last = along(x, p.low, p.high), p.f8 + around * (p.f0 - p.f8)
    return between_nine(
        share, p.at1, p.at2, p.at3, p.at4, p.at5, p.at6, p.at7,
        p.f0, p.f1, p.f2, p.f3, p.f4, p.f5, p.f6, p.f7, last,
    )  # fmt: skip


@jitable
def motion(flow: Flow, p: Any) -> float:
    """The variable of hull or battery that the table is over; zero where it is a motor's thrust."""
    return (
        (p.by == AHEAD) * flow.u
        + (p.by == SIDEWAYS) * flow.v
        + (p.by == TURNING) * flow.r
        + (p.by == HEADING) * flow.yaw
        + (p.by == BATTERY) * np.fmax(flow.voltage, 0.0)  # fmax: NaN becomes 0
    )


@jitable
def wrench(y: float, length: float, p: Any) -> Wrench:
    """A share of the scale as a force and moment on the hull."""
    push = y * p.full
    side = (p.acts == SWAY) * push
    turn = (p.acts == YAW) * push * 0.5 * length
    return Wrench((p.acts == SURGE) * push, side, p.x * side + turn)


def force(flow: Flow, p: Any) -> Wrench:
    """Motion -> X, Y, N [N, N, N m]."""
    y = (p.by != MOTOR) * (p.by != BATTERY) * table(motion(flow, p), p)
    return wrench(y, flow.body.length, p)


def thrust(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> float:
    """Thrust, motion, voltage (NaN: not measured) -> thrust [N]."""
    known = 1.0 * np.isfinite(flow.voltage) + 1.0 * (p.by != BATTERY) > 0.0
    share = F / np.maximum(drive.ahead, 1e-9)
    x = motion(flow, p) + (p.by == MOTOR) * share
    return F * (1.0 + known * (p.acts == THRUST) * table(x, p))


def reaction(F: float, drive: ThrusterParameters, flow: Flow, p: Any) -> Wrench:
    """Thrust of one motor -> what comes with it on the hull [N, N, N m]."""
    y = (p.by == MOTOR) * table(F / np.maximum(drive.ahead, 1e-9), p)
    X, Y, N = wrench(y, flow.body.length, p)
    outward = (p.acts == OUTWARD) * np.sign(drive.y) * y * F
    return Wrench(X, Y + outward, N + p.x * outward)


def angle(δ: float, blade: RudderParameters, p: Any) -> float:
    """Angle -> angle [rad]."""
    return δ + (p.acts == ANGLE) * table(δ, p)


def astern_share(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> float:
    """Full thrust astern over that ahead, negative: the lowest knot over a motor's thrust. Zero
    where none ran astern: what a knot says there was never sailed.
    """
    if "motor" in extent and extent["motor"][0] > -OF_TRIM:
        return 0.0
    return min((float(t.thrust[0] / t.thrust[1]) for t in vessel.thrusters), default=-1.0)


def tables(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> Sequence[Values]:
    """All empty tables that could be filled; `extent`: smallest and largest value of u, v, r and,
    where they were recorded, of the voltage and the motors' commands.
    """
    full = float(sum(t.thrust[1] for t in vessel.thrusters)) or 1.0
    low = astern_share(vessel, extent)
    stern = min((t.position[0] for t in vessel.thrusters), default=0.0)
    ranges = {by: extent[name] for by, name in zip((AHEAD, SIDEWAYS, TURNING), "uvr", strict=True)}
    ranges |= {HEADING: (0.0, 2.0 * math.pi)}
    pairs = [(by, acts) for by in ranges for acts in (SURGE, SWAY, YAW)]
    pairs += [(by, THRUST) for by in (AHEAD, SIDEWAYS, TURNING)]
    if vessel.thrusters:
        ranges |= {MOTOR: (low, 1.0)}
        pairs += [(MOTOR, acts) for acts in (SURGE, SWAY, YAW, THRUST)]
        low_volts, high_volts = extent.get("voltage", (0.0, 0.0))
        if high_volts - low_volts > LEAST_SAG * high_volts:
            ranges |= {BATTERY: (low_volts, high_volts)}
            pairs += [(BATTERY, THRUST)]
        if len({math.copysign(1.0, t.position[1]) for t in vessel.thrusters if t.position[1]}) > 1:
            pairs += [(MOTOR, OUTWARD)]
    if vessel.rudders:
        ranges |= {RUDDER: (min(r.angle[0] for r in vessel.rudders),
                            max(r.angle[1] for r in vessel.rudders))}  # fmt: skip
        pairs += [(RUDDER, ANGLE)]
    # an empty table has no slope over the place of its push, and few steps do not find it later
    aft = -AFT * vessel.hull.length
    arms = {SWAY: (0.0, aft), OUTWARD: (stern, aft)}
    return [
        {"by": by, "acts": acts, "low": ranges[by][0], "high": ranges[by][1], "full": full, "x": x,
         **EVENLY, **{f"f{k}": 0.0 for k in range(KNOTS)}}
        for by, acts in pairs
        for x in arms.get(acts, (0.0,))
    ]  # fmt: skip


def mismatch(vessel: Any, values: Values) -> str:
    """Why a table does not act on what its variable is of, or is none; empty where it does."""
    by, acts = values["by"], values["acts"]
    if disorder := knots_in_disorder(values):
        return disorder
    if acts == OUTWARD and by != MOTOR:
        return f"acts = {OUTWARD:g} (outward) goes with by = {MOTOR:g} (a motor's thrust) alone"
    if by == BATTERY and acts != THRUST:
        return f"by = {BATTERY:g} (voltage) goes with acts = {THRUST:g} (thrust) alone"
    if (acts == ANGLE) != (by == RUDDER):
        return (
            f"acts = {ANGLE:g} (angle of the steering) and by = {RUDDER:g} (angle commanded) go "
            "with one another alone"
        )
    return ""


def evidence_axis(values: Values) -> EvidenceAxis:
    """The missing force of the table's axis over the table's variable."""
    axis = {
        SWAY: ForceAxis.SWAY, OUTWARD: ForceAxis.SWAY, YAW: ForceAxis.YAW, ANGLE: ForceAxis.YAW,
    }.get(values["acts"], ForceAxis.SURGE)  # fmt: skip
    return EvidenceAxis(axis, DRAWN_AGAINST[values["by"]])


def acts_in_words(values: FittedValues, level: bool = False) -> str:
    """What a table is of, before what it goes with; `level`: which hardly matters."""
    pushed = values["acts"] in {SWAY, OUTWARD}
    at = f" {values['x']:+.2f} m from the origin" if pushed else ""
    return {
        SURGE: "a force ahead",
        SWAY: f"a force to starboard{at}",
        OUTWARD: f"a share of the thrust as a force outward{at}, to port of a motor on that side,",
        YAW: "a moment to starboard, as a force at half the hull's length,",
        THRUST: "a share of the thrust" + ("" if level else " that changes"),
        ANGLE: "an angle of the steering" + ("" if level else " that differs"),
    }[values["acts"]]


def in_words(values: FittedValues) -> str:
    """Force, share or angle at the knots that hold its shape."""
    by, acts = values["by"], values["acts"]
    unit, size = UNITS[by]
    places = knot_places(values)
    shares = [values[f"f{k}"] for k in range(KNOTS)]
    if by == HEADING:  # all around: the last knot is the first
        shares[-1] = shares[0]
    if acts in {THRUST, OUTWARD}:
        told = [f"{100.0 * y:+.0f} %" for y in shares]
    elif acts == ANGLE:
        told = [f"{math.degrees(y):+.1f}°" for y in shares]
    else:
        least = LEAST * np.abs(shares).max()  # of what is next to nothing no digit counts
        told = [f"{y * values['full'] if abs(y) > least else 0.0:+.3g} N" for y in shares]
    points = told_at_bends(told, places / size, np.array(shares), unit)
    level = bool(np.ptp(shares) < LEVEL * np.abs(shares).max())
    goes = f"nearly the same whatever the {NAMES[by]}" if level else f"with the {NAMES[by]}"
    return f"{acts_in_words(values, level)}{',' if level else ''} {goes}: {points}"


EFFECT = Effect(
    name="learned",
    scope=Scope.BOAT,
    force=force,
    thrust=thrust,
    reaction=reaction,
    angle=angle,
    parameters=(
        Parameter(
            "by", "1", lower=1.0, upper=7.0, start=1.0, kind=Kind.CHOICE,
            description="1 speed ahead, 2 sideways, 3 yaw rate, 4 heading, 5 a motor's thrust, "
            "6 the angle commanded, 7 the battery's voltage",
        ),
        Parameter(
            "acts", "1", lower=1.0, upper=6.0, start=1.0, kind=Kind.CHOICE,
            description="1 surge, 2 sway, 3 yaw, 4 share of the thrust, 5 angle of the steering, "
            "6 outward",
        ),
        Parameter(
            "low", "m/s, rad/s, rad, 1 or V", lower=-1000.0, upper=1000.0, start=-1.0,
            kind=Kind.FIXED, description="first knot",
        ),
        Parameter(
            "high", "m/s, rad/s, rad, 1 or V", lower=-1000.0, upper=1000.0, start=1.0,
            kind=Kind.FIXED, description="last knot",
        ),
        FULL,
        ARM,
        *INNER_KNOTS,
        *(
            Parameter(f"f{k}", "1", lower=-2.0, upper=2.0, start=0.0, scale=0.1, neutral=0.0)
            for k in range(KNOTS)
        ),
    ),
    looks_like="follows one variable, by no law of the catalogue",
    evidence=evidence_axis,
    tables=tables,
    knot_places=tuple(EVENLY),
    mismatch=mismatch,
    in_words=in_words,
    formulas=formulas,
    formula_source=formula_source,
    example={
        "by": 1.0, "acts": 1.0, "low": 0.0, "high": 2.0, "full": 100.0, "x": 0.0, **EVENLY,
        "f0": 0.0, "f1": 0.0, "f2": -0.1, "f3": -0.2, "f4": -0.3, "f5": -0.2, "f6": -0.1,
        "f7": 0.0, "f8": 0.0,
    },
    pattern="cubic_drag",
    acts_when={
        "force": {"by": (AHEAD, SIDEWAYS, TURNING, HEADING), "acts": (SURGE, SWAY, YAW)},
        "thrust": {"acts": (THRUST,)},
        "reaction": {"by": (MOTOR,), "acts": (SURGE, SWAY, YAW, OUTWARD)},
        "angle": {"acts": (ANGLE,)},
    },
)  # fmt: skip
