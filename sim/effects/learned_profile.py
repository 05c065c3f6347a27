"""Learned profile: what differs across a straight line, as a table that measurements filled.

    V(s) = linear between nine knots s_k = low + a_k (high − low), constant beyond them
    s = N cos θ + E sin θ, the way across in the direction θ
    acts 1 (water)    the water flows at V
    acts 2 (push)     X, Y = F V turned to the heading, N = x_F Y

n0 … n8 and e0 … e8 are the parts of V to the north and to the east at the knots: m/s, or shares of
the scale F [N], `full`; a_0 = 0, a_8 = 1, and between them `at1` … `at7`, k / 8 where nothing is
said; θ [rad] `direction`, clockwise from north; N, E [m] the position in the coordinates of the
recording, x_F [m] the place `x` where a push acts. Valid for: what is alike along a line, on that
day. A table explains nothing: a current that is weaker near a shore, a jet of water, the lee of a
wall, a quay that draws a boat look like this. Source: Ljung, System Identification, 2nd ed. 1999,
§5.4 (basis functions with local support).

It is looked for in the directions in which one takes most of the missing force along the track.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    Effect,
    Kind,
    Parameter,
    ResidualForce,
    Scope,
    Shown,
    Values,
)
from sim.effects.table_parameters import ARM, FULL, INNER_KNOTS, WATER_OR_PUSH, knots
from sim.effects.tables import (
    EVENLY,
    KNOTS,
    NAMES,
    PUSH,
    UNITS,
    WATER,
    MapField,
    along,
    between_nine,
    extremes_text,
    flowing,
    knot_shares,
    push_scale,
    pushing,
    vectors_at,
)
from sim.effects.words import FittedValues, towards
from sim.jit import jitable
from sim.state import Floats, Pose, Water, Wrench

TO_NORTH, TO_EAST = ([f"{c}{k}" for k in range(KNOTS)] for c in "ne")
DIRECTIONS = {0.0: "north", 0.25: "north-east", 0.5: "east", 0.75: "south-east"}  # of half a turn
LOOKED = 12  # directions, of half a turn, that a search looks at
STARTS = 4  # and begins from: what drives a hull is not what is missing along its track alone
ROWS = 1500  # of the track, for it


@jitable
def share(north: float, east: float, p: Any) -> float:
    """How far a place is from the first knot to the last, 0 … 1."""
    s = north * np.cos(p.direction) + east * np.sin(p.direction)
    return along(s, p.low, p.high)


@jitable
def to_north(north: float, east: float, p: Any) -> float:
    """The part of V to the north."""
    return between_nine(
        share(north, east, p), p.at1, p.at2, p.at3, p.at4, p.at5, p.at6, p.at7,
        p.n0, p.n1, p.n2, p.n3, p.n4, p.n5, p.n6, p.n7, p.n8,
    )  # fmt: skip


@jitable
def to_east(north: float, east: float, p: Any) -> float:
    """The part of V to the east."""
    return between_nine(
        share(north, east, p), p.at1, p.at2, p.at3, p.at4, p.at5, p.at6, p.at7,
        p.e0, p.e1, p.e2, p.e3, p.e4, p.e5, p.e6, p.e7, p.e8,
    )  # fmt: skip


def water(time: float, pose: Pose, p: Any) -> Water:
    """Place -> velocity of the water [m/s]; no acceleration."""
    n, e = pose.north, pose.east
    return flowing(p.acts, to_north(n, e, p), to_east(n, e, p))


def force(flow: Flow, p: Any) -> Wrench:
    """Place and heading -> X, Y, N [N, N, N m]."""
    n, e = flow.north, flow.east
    return pushing(to_north(n, e, p), to_east(n, e, p), flow.yaw, p)


def _empty(vessel: Any, acts: float, direction: float, low: float, high: float) -> Values:
    return {
        "acts": acts, "direction": direction, "low": low, "high": high,
        "full": push_scale(vessel), "x": 0.0, **EVENLY,
        **dict.fromkeys((*TO_NORTH, *TO_EAST), 0.0),
    }  # fmt: skip


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """Empty profiles in the directions in which one takes most of the missing force."""
    found = residual()
    thin = slice(None, None, max(len(found.time) // ROWS, 1))
    place, missing = found.place[thin], found.force[thin]

    def across(direction: float) -> Floats:
        return np.asarray(place @ [math.cos(direction), math.sin(direction)])

    def taken(direction: float) -> float:
        s = across(direction)
        at = np.interp(s, [s.min(), max(s.max(), s.min() + 1e-6)], [0.0, KNOTS - 1.0])
        basis = np.maximum(1.0 - np.abs(at[:, None] - np.arange(KNOTS)), 0.0)
        values = np.linalg.lstsq(basis, missing, rcond=None)[0]
        return float(np.sum((basis @ values) ** 2))

    step = math.pi / LOOKED
    chosen: list[float] = []
    for x in sorted((step * k for k in range(LOOKED)), key=taken, reverse=True):
        apart = (abs(math.remainder(x - other, math.pi)) > 1.5 * step for other in chosen)
        if len(chosen) < STARTS and all(apart):
            chosen.append(x)
    finer = [max((x + step * k for k in np.linspace(-0.5, 0.5, 9)), key=taken) for x in chosen]
    return [
        _empty(vessel, acts, float(x), float(across(x).min()), float(across(x).max()))
        for x in finer
        for acts in (WATER, PUSH)
    ]


def over_map(p: FittedValues) -> MapField:
    """The profile over a square, its knots in rows."""
    along_it = _places(p)
    aside = np.linspace(-0.5, 0.5, KNOTS) * (p["high"] - p["low"])
    s, t = np.meshgrid(along_it, aside, indexing="ij")
    c, d = math.cos(p["direction"]), math.sin(p["direction"])
    north, east, half = (np.repeat(part, KNOTS) for part in vectors_at(p, TO_NORTH, TO_EAST))
    return MapField(
        (s * c - t * d).ravel(), (s * d + t * c).ravel(), north, east, half, UNITS[p["acts"]]
    )


def _places(p: FittedValues) -> Floats:
    """Where the knots are (K,), on the way across [m]."""
    return np.asarray(p["low"] + (p["high"] - p["low"]) * knot_shares(p))


def in_words(p: FittedValues) -> str:
    """Where it is surely strongest, and where it surely differs most from there."""
    way = _places(p)
    direction = p["direction"]  # another than these four where it was turned
    across = DIRECTIONS.get(round(direction / math.pi, 2), f"towards {towards(direction)}")
    field = MapField(way, np.zeros(KNOTS), *vectors_at(p, TO_NORTH, TO_EAST), UNITS[p["acts"]])
    what = f"{NAMES[p['acts']]} differently on the way {across}"
    return extremes_text(what, field, [f"at {s:.0f} m" for s in way])


EFFECT = Effect(
    name="learned_profile",
    scope=Scope.VOYAGE,
    water=water,
    force=force,
    parameters=(
        WATER_OR_PUSH,
        Parameter(
            "direction", "rad", lower=-7.0, upper=7.0, start=0.0, scale=0.05, kind=Kind.FIXED,
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
        FULL,
        ARM,
        *INNER_KNOTS,
        *knots((*TO_NORTH, *TO_EAST)),
    ),
    looks_like="differs on the way across a line, by no law of the catalogue",
    shown_by=(Shown.CHANGE,),
    search=search,
    knot_places=tuple(EVENLY),
    turned={"direction": math.pi / 8.0},
    over_map=over_map,
    in_words=in_words,
    example={
        "acts": 1.0, "direction": 0.0, "low": -20.0, "high": 40.0, "full": 100.0, "x": 0.0,
        **EVENLY, **dict.fromkeys(TO_NORTH, 0.0),
        **{key: 0.05 * k for k, key in enumerate(TO_EAST)},
    },
    pattern="steady_current",
    acts_when={"water": {"acts": (WATER,)}, "force": {"acts": (PUSH,)}},
)  # fmt: skip
