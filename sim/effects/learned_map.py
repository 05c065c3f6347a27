"""Learned map: what differs from place to place, as a table over the map that measurements filled.

    V(N, E) = bilinear between 4 × 4 knots, `south` to `north`, `west` to `east`; else constant
    acts 1 (water)   the water flows at V
    acts 2 (push)    X, Y = F V turned to the heading, N = x_F Y

n00 … n33 and e00 … e33 are the parts of V to the north and to the east at the knots, row by row
from the south and in a row from the west: m/s, or shares of the scale F [N], `full`; x_F [m] the
place `x` where a push acts; N, E [m] the position in the coordinates of the recording. Valid for:
the places where the boat was, on that day; changes over a few hull lengths and more (water that
flows past is not accelerated by them here). A table explains nothing: a jet in a river's mouth, an
eddy, a shoal's tide race, the lee of a mole look like this. Source: Ljung, System Identification,
2nd ed. 1999, §5.4 (basis functions with local support).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import Effect, Kind, Parameter, Scope, Shown, Values
from sim.effects.table_parameters import ARM, FULL, WATER_OR_PUSH, knots
from sim.effects.tables import (
    NAMES,
    PUSH,
    UNITS,
    WATER,
    MapField,
    along,
    between_sixteen,
    extremes_text,
    flowing,
    push_scale,
    pushing,
    vectors_at,
    weights_of_four,
)
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Pose, Water, Wrench

SIDE = 4
TO_NORTH, TO_EAST = ([f"{c}{i}{j}" for i in range(SIDE) for j in range(SIDE)] for c in "ne")


@jitable
def to_north(north: float, east: float, p: Any) -> float:
    """The part of V to the north."""
    return between_sixteen(
        weights_of_four(along(north, p.south, p.north)),
        weights_of_four(along(east, p.west, p.east)),
        p.n00, p.n01, p.n02, p.n03, p.n10, p.n11, p.n12, p.n13,
        p.n20, p.n21, p.n22, p.n23, p.n30, p.n31, p.n32, p.n33,
    )  # fmt: skip


@jitable
def to_east(north: float, east: float, p: Any) -> float:
    """The part of V to the east."""
    return between_sixteen(
        weights_of_four(along(north, p.south, p.north)),
        weights_of_four(along(east, p.west, p.east)),
        p.e00, p.e01, p.e02, p.e03, p.e10, p.e11, p.e12, p.e13,
        p.e20, p.e21, p.e22, p.e23, p.e30, p.e31, p.e32, p.e33,
    )  # fmt: skip


def water(time: float, pose: Pose, p: Any) -> Water:
    """Place -> velocity of the water [m/s]; no acceleration."""
    n, e = pose.north, pose.east
    return flowing(p.acts, to_north(n, e, p), to_east(n, e, p))


def force(flow: Flow, p: Any) -> Wrench:
    """Place and heading -> X, Y, N [N, N, N m]."""
    n, e = flow.north, flow.east
    return pushing(to_north(n, e, p), to_east(n, e, p), flow.yaw, p)


def tables(vessel: Any, extent: Mapping[str, tuple[float, float]]) -> Sequence[Values]:
    """Empty maps of water and of a push over the places that were sailed."""
    full = push_scale(vessel)
    (south, north), (west, east) = extent["north"], extent["east"]
    return [
        {"acts": acts, "south": south, "north": north, "west": west, "east": east, "full": full,
         "x": 0.0, **dict.fromkeys((*TO_NORTH, *TO_EAST), 0.0)}
        for acts in (WATER, PUSH)
    ]  # fmt: skip


def over_map(p: FittedValues) -> MapField:
    """The map at its knots."""
    north, east = np.meshgrid(
        np.linspace(p["south"], p["north"], SIDE), np.linspace(p["west"], p["east"], SIDE),
        indexing="ij",
    )  # fmt: skip
    vectors = vectors_at(p, TO_NORTH, TO_EAST)
    return MapField(north.ravel(), east.ravel(), *vectors, UNITS[p["acts"]])


def in_words(p: FittedValues) -> str:
    """Where it is surely strongest, and where it surely differs most from there."""
    field = over_map(p)
    places = [
        f"around N {north:.0f} m, E {east:.0f} m"
        for north, east in zip(field.north, field.east, strict=True)
    ]
    what = f"{NAMES[p['acts']]} differently from place to place"
    return extremes_text(what, field, places)


EFFECT = Effect(
    name="learned_map",
    scope=Scope.VOYAGE,
    water=water,
    force=force,
    parameters=(
        WATER_OR_PUSH,
        *(
            Parameter(
                key, "m", lower=-1e6, upper=1e6, start=0.0, kind=Kind.FIXED,
                description=f"of the map, its {key}ern edge",
            )
            for key in ("south", "north", "west", "east")
        ),
        FULL,
        ARM,
        *knots((*TO_NORTH, *TO_EAST)),
    ),
    looks_like="differs from place to place, by no law of the catalogue",
    shown_by=(Shown.CHANGE,),
    contains="learned_profile",
    tables=tables,
    over_map=over_map,
    in_words=in_words,
    example={
        "acts": 1.0, "south": -20.0, "north": 40.0, "west": -30.0, "east": 30.0, "full": 100.0,
        "x": 0.0, **{key: 0.1 * (k % SIDE) for k, key in enumerate(TO_NORTH)},
        **{key: 0.05 * (k // SIDE) for k, key in enumerate(TO_EAST)},
    },
    pattern="steady_current",
    acts_when={"water": {"acts": (WATER,)}, "force": {"acts": (PUSH,)}},
)  # fmt: skip
