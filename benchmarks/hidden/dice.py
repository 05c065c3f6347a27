"""Thrown values: what every recipe of a cause's strength is made of."""

import math
from collections.abc import Callable

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat

Values = dict[str, float]
Recipe = Callable[[Boat, Dice, float, float], Values]


def of(dice: Dice, low: float, high: float) -> float:
    return float(dice.uniform(low, high))


def side(dice: Dice) -> float:
    return float(dice.choice([-1.0, 1.0]))


def bearing(dice: Dice) -> float:
    return of(dice, -math.pi, math.pi)
