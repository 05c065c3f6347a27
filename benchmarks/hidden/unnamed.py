"""How strong the kinds of `causes.unnamed` are at full strength; as `strengths` has the others."""

from collections.abc import Mapping

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.dice import Recipe, Values, bearing, of, side


def _tide(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"before": -k * of(d, 0.1, 0.25), "after": k * of(d, 0.15, 0.3), "towards": bearing(d),
            "turns": seconds * of(d, 0.35, 0.65), "within": seconds * of(d, 0.15, 0.3)}  # fmt: skip


def _funnel(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"force": k * b.ahead * of(d, 0.2, 0.35), "towards": bearing(d),
            "north": of(d, -8.0, 8.0), "east": of(d, -8.0, 8.0),
            "radius": of(d, 8.0, 14.0)}  # fmt: skip


def _overheating(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.3, 0.45), "after": seconds * of(d, 0.35, 0.65),
            "within": seconds * of(d, 0.1, 0.25)}  # fmt: skip


def _bank(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"suction": k * b.ahead * of(d, 0.15, 0.25), "speed": 0.5 * b.top_speed(),
            "north": of(d, 5.0, 12.0), "width": of(d, 6.0, 12.0)}  # fmt: skip


def _compass_tilt(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"per_g": k * side(d) * of(d, 3.0, 5.0)}


def _bottom_line(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"force": k * b.ahead * of(d, 0.08, 0.16)}


def _thrust_cap(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": 1.0 - k * of(d, 0.55, 0.7)}


def _slip_loss(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.5, 0.7), "speed": b.top_speed() * of(d, 0.06, 0.12)}


def _bow_rise(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": k * of(d, 1.0, 2.0), "speed": b.top_speed() * of(d, 0.2, 0.4)}


def _head_sea(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": k * of(d, 1.0, 1.8), "towards": bearing(d)}


UNNAMED: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _tide, _funnel, _overheating, _bank, _compass_tilt, _bottom_line, _thrust_cap, _slip_loss,
        _bow_rise, _head_sea,
    )
}  # fmt: skip
