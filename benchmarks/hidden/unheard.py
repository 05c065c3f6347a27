"""How strong the kinds of `causes.unheard` are at full strength; as `strengths` has the others."""

from collections.abc import Mapping

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.dice import Recipe, Values, bearing, of, side


def _thrust_gap(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    low = of(d, 0.1, 0.2)
    return {"low": low, "high": low + k * of(d, 0.35, 0.5)}


def _keel_stall(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"speed": b.top_speed() * of(d, 0.04, 0.08), "share": k * of(d, 0.6, 0.8)}


def _turning_drag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"X_rr": k * b.ahead * of(d, 0.8, 1.6)}


def _leeway_drag(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"X_vv": k * b.ahead * of(d, 10.0, 20.0) / b.top_speed() ** 2}


def _warming_up(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * of(d, 0.35, 0.5), "seconds": seconds * of(d, 0.15, 0.3)}


def _eddy(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"north": of(d, -8.0, 8.0), "east": of(d, -8.0, 8.0), "radius": of(d, 10.0, 18.0),
            "speed": k * side(d) * of(d, 0.3, 0.5)}  # fmt: skip


def _squalls(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    period = of(d, 60.0, 120.0)
    return {"force": k * b.ahead * of(d, 0.12, 0.22), "towards": bearing(d),
            "period": period, "lasts": period * of(d, 0.2, 0.35)}  # fmt: skip


def _crossed_wash(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"share": k * side(d) * of(d, 0.15, 0.3), "x": -0.4 * b.hull.length}


def _gyro_gain(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": k * side(d) * of(d, 0.1, 0.2)}


def _log_gain(b: Boat, d: Dice, k: float, seconds: float) -> Values:
    return {"gain": k * side(d) * of(d, 0.1, 0.2)}


UNHEARD: Mapping[str, Recipe] = {
    recipe.__name__[1:]: recipe
    for recipe in (
        _thrust_gap, _keel_stall, _turning_drag, _leeway_drag, _warming_up, _eddy, _squalls,
        _crossed_wash, _gyro_gain, _log_gain,
    )
}  # fmt: skip
