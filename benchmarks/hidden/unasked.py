"""How strong the kinds of `causes.unasked` are at full strength; as `strengths` has the others."""

from collections.abc import Mapping

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.dice import Recipe, Values, bearing, of, side


def _own_wake(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"drag": k * of(d, 0.8, 1.2) * b.ahead / b.top_speed() ** 2, "seconds": of(d, 4.0, 8.0)}


def _one_way_board(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": k * of(d, 2.0, 4.0), "x": side(d) * of(d, 0.1, 0.25) * b.hull.length}


def _snaking_tow(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"pull": k * of(d, 0.3, 0.5) * b.ahead / b.top_speed() ** 2,
            "x": -of(d, 0.45, 0.6) * b.hull.length, "period": of(d, 5.0, 10.0)}  # fmt: skip


def _power_budget(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": 1.0 - k * of(d, 0.6, 0.7)}


def _hot_motors(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.45, 0.65), "load": of(d, 0.25, 0.35), "seconds": of(d, 20.0, 45.0)}


def _notches(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"step": k * of(d, 0.28, 0.4)}


def _lily_field(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"north": of(d, -8.0, 8.0), "east": of(d, -8.0, 8.0), "radius": of(d, 14.0, 22.0),
            "share": k * of(d, 0.6, 0.8)}  # fmt: skip


def _lying_across(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"moment": -k * of(d, 0.08, 0.14) * b.hull.N_r, "towards": bearing(d)}


def _seiche(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"speed": k * of(d, 0.35, 0.55), "towards": bearing(d), "period": of(d, 20.0, 32.0),
            "length": of(d, 60.0, 90.0), "north": of(d, -8.0, 8.0),
            "east": of(d, -8.0, 8.0)}  # fmt: skip


def _soft_iron(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"angle": k * of(d, 0.16, 0.28), "at": bearing(d)}


UNASKED: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _own_wake, _one_way_board, _snaking_tow, _power_budget, _hot_motors, _notches,
        _lily_field, _lying_across, _seiche, _soft_iron,
    )
}  # fmt: skip
