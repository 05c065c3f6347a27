"""Tables in the place of laws: interpolation between knots, and what a table can be shown as.

A law works on floats and compiles: each knot is a number of its own, and there are no loops.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sim.effects.words import FittedValues, towards
from sim.jit import jitable
from sim.state import Floats, Water, Wrench, to_body

# what a table over the map or the time acts on: its code, its unit, and how it is told
WATER, PUSH = 1.0, 2.0
UNITS = {WATER: "m/s", PUSH: "N"}
NAMES = {WATER: "water that flows", PUSH: "a push over the ground that acts"}
KNOTS = 9
EVENLY = {f"at{k}": k / (KNOTS - 1) for k in range(1, KNOTS - 1)}  # inner knots, until moved
SHARE_OF_THRUST = 0.4  # of all motors' thrust ahead: the scale of a push


def push_scale(vessel: Any) -> float:
    """Force [N] of a value of one."""
    return SHARE_OF_THRUST * float(sum(t.thrust[1] for t in vessel.thrusters)) or 1.0


def knot_shares(values: Mapping[str, float] | FittedValues) -> Floats:
    """How far each of nine knots is from the first to the last: (K,), 0 … 1."""
    return np.array([0.0, *(values[key] for key in EVENLY), 1.0])


def vector_text(north: float, east: float, unit: str) -> str:
    """Size and direction of what has these parts: "0.4 m/s towards 90° (east)"."""
    return f"{math.hypot(north, east):.2g} {unit} towards {towards(math.atan2(east, north))}"


def vectors_at(
    p: FittedValues, to_north: Sequence[str], to_east: Sequence[str]
) -> tuple[Floats, Floats, Floats]:
    """Parts to north and east at knots of these names, and half the interval of either (n,): m/s
    of water, or N of a push.
    """
    scale = 1.0 if p["acts"] == WATER else p["full"]
    half = np.zeros(len(to_north))
    for keys in (to_north, to_east):
        ends = np.array([p.ci95.get(key, (0.0, 0.0)) for key in keys])
        half = np.maximum(half, 0.5 * scale * (ends[:, 1] - ends[:, 0]))
    north, east = (scale * np.array([p[key] for key in keys]) for keys in (to_north, to_east))
    return north, east, half


def extremes_text(what: str, field: "MapField", places: Sequence[str]) -> str:
    """Where a field is surely strongest, and where it surely differs most from there; `places`:
    each as people say it.
    """
    strongest = int(np.argmax(field.least))
    if field.least[strongest] <= 0.0:
        return f"{what}: nowhere surely"
    away = np.hypot(field.to_north - field.to_north[strongest],
                    field.to_east - field.to_east[strongest])  # fmt: skip
    other = int(np.argmax(away - field.half))
    told = [
        f"{vector_text(float(field.to_north[k]), float(field.to_east[k]), field.unit)} {places[k]}"
        for k in (strongest, other)
    ]
    return f"{what}: {', '.join(told if away[other] > field.half[other] else told[:1])}"


def bends(places: Floats, values: Floats, count: int) -> list[int]:
    """Numbers of so many of a table's knots, the two ends among them, that hold its shape: those
    between whose neighbours a straight line would do have gone, one by one. Places (K,), values
    (K,) or of several columns (columns, K).

    Of knots that would do alike those at odd numbers go first.
    """
    left, columns = list(range(len(places))), np.atleast_2d(values)
    while len(left) > count:
        off = [
            max(abs(y[k] - np.interp(places[k], places[[a, b]], y[[a, b]])) for y in columns)
            for a, k, b in zip(left, left[1:], left[2:], strict=False)
        ]
        alike = np.flatnonzero(np.array(off) <= min(off) + 1e-9)
        gone = next((i for i in alike if left[i + 1] % 2), alike[0])
        del left[gone + 1]
    return left


def told_at_bends(told: Sequence[str], places: Floats, values: Floats, unit: str) -> str:
    """What is told of each knot (K,), and where it is, of those that hold the table's shape."""
    kept = bends(places, values, KNOTS // 2 + 1)
    return ", ".join(f"{told[k]} at {places[k]:.3g} {unit}" for k in kept)


def knots_in_disorder(values: Mapping[str, float]) -> str:
    """Why its inner knots are none of a table; empty where they are."""
    if not np.all(np.diff(knot_shares(values)) > 0.0):
        return "at1 … at7 must rise, between 0 and 1"
    return ""


class Formula(NamedTuple):
    """A short law that may stand for a table.

    form     its name among those that `sim.effects.learned_formula` holds
    text     the equation with its numbers
    numbers  by name, SI
    values   the table as the formula has it
    """

    form: str
    text: str
    numbers: Mapping[str, float]
    values: Mapping[str, float]


class MapField(NamedTuple):
    """What an effect supplies over the map: places (n,) [m], parts to north and east (n,), unit.

    half       half the length of the 95 % interval of either part (n,); 0 where none is known
    directed   else a number at each place, `to_north`
    """

    north: Floats
    east: Floats
    to_north: Floats
    to_east: Floats
    half: Floats
    unit: str
    directed: bool = True

    @property
    def size(self) -> Floats:
        """Of the whole (n,)."""
        return np.hypot(self.to_north, self.to_east)

    @property
    def least(self) -> Floats:
        """The size that is sure (n,): a corner where the boat hardly was has none."""
        return np.maximum(self.size - self.half, 0.0)


Weights = tuple[float, float, float, float]


@jitable
def flowing(acts: float, north: float, east: float) -> Water:
    """Velocity of the water [m/s] where a table acts on it; no acceleration."""
    flows = 1.0 * (acts == WATER)
    return Water(flows * north, flows * east, 0.0, 0.0)


@jitable
def pushing(north: float, east: float, yaw: float, p: Any) -> Wrench:
    """Shares of the scale to north and east -> X, Y, N [N, N, N m] where a table is a push."""
    push = (p.acts == PUSH) * p.full
    X, Y = to_body(push * north, push * east, yaw)
    return Wrench(X, Y, p.x * Y)


@jitable
def along(x: float, low: float, high: float) -> float:
    """How far x is from `low` to `high`: 0 … 1, no further beyond the two."""
    return np.minimum(np.maximum((x - low) / np.maximum(high - low, 1e-9), 0.0), 1.0)


@jitable
def between_nine(
    share: float, a1: float, a2: float, a3: float, a4: float, a5: float, a6: float, a7: float,
    f0: float, f1: float, f2: float, f3: float, f4: float, f5: float, f6: float, f7: float,
    f8: float,
) -> float:  # fmt: skip
    """The value at a share (0 … 1) of the way from the first of nine knots to the last, the inner
    ones at shares a1 … a7.
    """
    return (
        f0
        + (f1 - f0) * along(share, 0.0, a1)
        + (f2 - f1) * along(share, a1, a2)
        + (f3 - f2) * along(share, a2, a3)
        + (f4 - f3) * along(share, a3, a4)
        + (f5 - f4) * along(share, a4, a5)
        + (f6 - f5) * along(share, a5, a6)
        + (f7 - f6) * along(share, a6, a7)
        + (f8 - f7) * along(share, a7, 1.0)
    )


@jitable
def weights_of_four(share: float) -> Weights:
    """How much each of four knots counts at a share (0 … 1) of the way."""
    s = share * 3.0
    return (
        np.maximum(1.0 - s, 0.0),
        np.maximum(1.0 - np.abs(s - 1.0), 0.0),
        np.maximum(1.0 - np.abs(s - 2.0), 0.0),
        np.maximum(s - 2.0, 0.0),
    )


@jitable
def weighted(w: Weights, a: float, b: float, c: float, d: float) -> float:
    """The value between four knots."""
    return w[0] * a + w[1] * b + w[2] * c + w[3] * d


@jitable
def between_sixteen(
    a: Weights, b: Weights, h00: float, h01: float, h02: float, h03: float, h10: float, h11: float,
    h12: float, h13: float, h20: float, h21: float, h22: float, h23: float, h30: float, h31: float,
    h32: float, h33: float,
) -> float:  # fmt: skip
    """The value between 4 × 4 knots, by how much each row (a) and each in a row (b) counts."""
    return weighted(
        a,
        weighted(b, h00, h01, h02, h03),
        weighted(b, h10, h11, h12, h13),
        weighted(b, h20, h21, h22, h23),
        weighted(b, h30, h31, h32, h33),
    )
