"""How strong the kinds of `causes.untold` are at full strength; as `strengths` has the others."""

from collections.abc import Mapping

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.dice import Recipe, Values, bearing, of, side


def _leaking(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"more": k * of(d, 0.5, 0.9), "seconds": seconds * of(d, 0.25, 0.45)}


def _listing(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"y": k * side(d) * of(d, 0.08, 0.16) * b.hull.beam}


def _winch_cast(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    drag, period = k * of(d, 0.9, 1.6) * b.ahead / b.top_speed() ** 2, of(d, 60.0, 120.0)
    return {"drag": drag, "x": -of(d, 0.3, 0.5) * b.hull.length, "period": period,
            "lasts": period * of(d, 0.4, 0.6)}  # fmt: skip


def _undervoltage(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.35, 0.55), "volts": of(d, 16.05, 16.2)}


def _air_at_rest(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.5, 0.7), "speed": b.top_speed() * of(d, 0.35, 0.55)}


def _winding_weed(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    channel = float(d.choice([m.channel for m in b.motors]))
    return {"channel": channel, "share": k * of(d, 0.6, 0.85), "period": of(d, 50.0, 100.0)}


def _ferry_wake(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    period = of(d, 60.0, 110.0)
    return {"force": k * b.ahead * of(d, 0.4, 0.7), "towards": bearing(d),
            "speed": of(d, 3.0, 5.0), "omega": of(d, 0.9, 1.3), "rises": of(d, 0.8, 1.4),
            "period": period, "lasts": period * of(d, 0.3, 0.45)}  # fmt: skip


def _loose_tarp(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"force": k * b.ahead * of(d, 0.16, 0.26), "towards": bearing(d),
            "x": side(d) * of(d, 0.1, 0.25) * b.hull.length}  # fmt: skip


def _steel_pier(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"angle": k * side(d) * of(d, 0.25, 0.45), "north": of(d, -8.0, 8.0),
            "east": of(d, -8.0, 8.0), "radius": of(d, 9.0, 15.0)}  # fmt: skip


def _aerator(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"north": of(d, -8.0, 8.0), "east": of(d, -8.0, 8.0), "radius": of(d, 8.0, 14.0),
            "speed": k * of(d, 0.3, 0.5)}  # fmt: skip


UNTOLD: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _leaking, _listing, _winch_cast, _undervoltage, _air_at_rest, _winding_weed, _ferry_wake,
        _loose_tarp, _steel_pier, _aerator,
    )
}  # fmt: skip
