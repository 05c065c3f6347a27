"""Learned profile: what differs across a straight line, as a table that measurements filled.

    V(s) = linear between nine knots from `low` to `high`, constant beyond them
    s = N cos θ + E sin θ, the way across in the direction θ
    acts 1 (water)    the water flows at V
    acts 2 (push)     X, Y = F V turned to the heading, N = x_F Y

n0 … n8 and e0 … e8 are the parts of V to the north and to the east at the knots: m/s, or shares of
the scale F [N], `full`; θ [rad] `direction`, clockwise from north, one of four; N, E [m] the
position in the coordinates of the recording, x_F [m] the place `x` where a push acts. Valid for:
what is alike along a line, on that day. A table explains nothing: a current that is weaker near a
shore, a jet of water, the lee of a wall, a quay that draws a boat look like this. Source: Ljung,
System Identification, 2nd ed. 1999, §5.4 (basis functions with local support).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import Effect, Kind, Parameter, Scope, Shown, Values
from sim.effects.learned_formula import KNOTS
from sim.effects.tables import (
    NAMES,
    PUSH,
    UNITS,
    WATER,
    MapField,
    along,
    between_nine,
    push_scale,
    vector_text,
)
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Floats, Pose, Water, Wrench, to_body

TO_NORTH, TO_EAST = ([f"{c}{k}" for k in range(KNOTS)] for c in "ne")
DIRECTIONS = {0.0: "north", 0.25: "north-east", 0.5: "east", 0.75: "south-east"}  # of half a turn


@jitable
def share(north: float, east: float, p: Any) -> float:
    """How far a place is from the first knot to the last, 0 … 1."""
    s = north * np.cos(p.direction) + east * np.sin(p.direction)
    return along(s, p.low, p.high)


@jitable
def to_north(north: float, east: float, p: Any) -> float:
    """The part of V to the north."""
    at = share(north, east, p)
    return between_nine(at, p.n0, p.n1, p.n2, p.n3, p.n4, p.n5, p.n6, p.n7, p.n8)


@jitable
def to_east(north: float, east: float, p: Any) -> float:
    """The part of V to the east."""
    at = share(north, east, p)
    return between_nine(at, p.e0, p.e1, p.e2, p.e3, p.e4, p.e5, p.e6, p.e7, p.e8)


def water(time: float, pose: Pose, p: Any) -> Water:
    """Place -> velocity of the water [m/s]; no acceleration."""
    flows = 1.0 * (p.acts == WATER)
    n, e = pose.north, pose.east
    return Water(flows * to_north(n, e, p), flows * to_east(n, e, p), 0.0, 0.0)


def force(flow: Flow, p: Any) -> Wrench:
    """Place and heading -> X, Y, N [N, N, N m]."""
    push = (p.acts == PUSH) * p.full
    n, e = flow.north, flow.east
    X, Y = to_body(push * to_north(n, e, p), push * to_east(n, e, p), flow.yaw)
    return Wrench(X, Y, p.x * Y)


def tables(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> Sequence[Values]:
    """Empty profiles of water and of a push across what was sailed, in four directions."""
    full, out = push_scale(vessel), []
    for part in DIRECTIONS:
        direction = part * math.pi
        ends = [
            n * math.cos(direction) + e * math.sin(direction)
            for n in extent["north"] for e in extent["east"]
        ]  # fmt: skip
        out += [
            {"acts": acts, "direction": direction, "low": min(ends), "high": max(ends),
             "full": full, "x": 0.0, **dict.fromkeys((*TO_NORTH, *TO_EAST), 0.0)}
            for acts in (WATER, PUSH)
        ]  # fmt: skip
    return out


def _at_knots(p: FittedValues) -> tuple[Floats, Floats, Floats]:
    """Parts to north and east at the knots, and half the interval of either (9,) [m/s or N]."""
    scale = 1.0 if p["acts"] == WATER else p["full"]
    half = np.zeros(KNOTS)
    for keys in (TO_NORTH, TO_EAST):
        ends = np.array([p.ci95.get(key, (0.0, 0.0)) for key in keys])
        half = np.maximum(half, 0.5 * scale * (ends[:, 1] - ends[:, 0]))
    north, east = (scale * np.array([p[key] for key in keys]) for keys in (TO_NORTH, TO_EAST))
    return north, east, half


def over_map(p: FittedValues) -> MapField:
    """The profile over a square, its knots in rows."""
    along_it = np.linspace(p["low"], p["high"], KNOTS)
    aside = np.linspace(-0.5, 0.5, KNOTS) * (p["high"] - p["low"])
    s, t = np.meshgrid(along_it, aside, indexing="ij")
    c, d = math.cos(p["direction"]), math.sin(p["direction"])
    north, east, half = (np.repeat(part, KNOTS) for part in _at_knots(p))
    return MapField(
        (s * c - t * d).ravel(), (s * d + t * c).ravel(), north, east, half, UNITS[p["acts"]]
    )


def in_words(p: FittedValues) -> str:
    """Where it is surely strongest, and where it surely differs most from there."""
    north, east, half = _at_knots(p)
    way = np.linspace(p["low"], p["high"], KNOTS)
    strongest = int(np.argmax(np.hypot(north, east) - half))
    away = np.hypot(north - north[strongest], east - east[strongest])
    other = int(np.argmax(away - half))
    towards = DIRECTIONS[round(p["direction"] / math.pi, 2)]
    what = f"{NAMES[p['acts']]} differently on the way {towards}"
    if np.hypot(north, east)[strongest] <= half[strongest]:
        return f"{what}: nowhere surely"
    told = [
        f"{vector_text(float(north[k]), float(east[k]), UNITS[p['acts']])} at {way[k]:.0f} m"
        for k in (strongest, other)
    ]
    return f"{what}: {', '.join(told if away[other] > half[other] else told[:1])}"


EFFECT = Effect(
    name="learned_profile",
    scope=Scope.VOYAGE,
    water=water,
    force=force,
    parameters=(
        Parameter(
            "acts", "1", lower=1.0, upper=2.0, start=1.0, kind=Kind.CHOICE,
            description="1 water, 2 a push",
        ),
        Parameter(
            "direction", "rad", lower=0.0, upper=math.pi, start=0.0, kind=Kind.FIXED,
            description="of the way across, clockwise from north",
        ),
        Parameter(
            "low", "m", lower=-1e6, upper=1e6, start=0.0, kind=Kind.FIXED,
            description="first knot, on that way",
        ),
        Parameter(
            "high", "m", lower=-1e6, upper=1e6, start=0.0, kind=Kind.FIXED,
            description="last knot, on that way",
        ),
        Parameter(
            "full", "N", lower=0.0, upper=1e6, start=100.0, kind=Kind.FIXED,
            description="push of a value of one",
        ),
        Parameter("x", "m", lower=-50.0, upper=50.0, start=0.0, scale=0.5),
        *(
            Parameter(
                key, "m/s or 1", lower=-3.0, upper=3.0, start=0.0, scale=0.1, neutral=0.0,
                prior=0.5,  # keeps knots at nothing where the boat hardly was
            )
            for key in (*TO_NORTH, *TO_EAST)
        ),
    ),
    looks_like="differs on the way across a line, by no law of the catalogue",
    shown_by=(Shown.CHANGE,),
    tables=tables,
    over_map=over_map,
    in_words=in_words,
    example={
        "acts": 1.0, "direction": 0.0, "low": -20.0, "high": 40.0, "full": 100.0, "x": 0.0,
        **dict.fromkeys(TO_NORTH, 0.0), **{key: 0.05 * k for k, key in enumerate(TO_EAST)},
    },
    pattern="steady_current",
)  # fmt: skip
