"""Thrust against command as a table: knots of (command, share of full thrust), lines between them.

    F = ahead · s(c) for c > 0,   F = −astern · s(c) for c < 0
    s rises from s(−1) = −1 through s(0) = 0 to s(1) = 1:   s(c) = Σ_k (s_k − s_{k−1}) ramp_k(c)

Free but monotone: no form is assumed, only that more command never means less thrust. Several
thrusters may share one table: the others name the thruster that has it. Knots count by their
command in per cent (`left.curve_25`): the numbers that identification may free.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sim.vessel import Thruster, Vessel

Point = tuple[float, float]
Points = tuple[Point, ...]
CURVES = {"linear": 1.0, "quadratic": 2.0}  # name -> exponent of thrust against command
FREED = (0.1, 0.25, 0.5, 0.75)  # knots, ahead and astern, of a curve that is to be identified
KEY = "curve_"
ENDS = ((-1.0, -1.0), (0.0, 0.0), (1.0, 1.0))


def mistake_in(points: Sequence[Point]) -> str | None:
    """What is wrong with a table, or None."""
    commands, shares = [c for c, _ in points], [s for _, s in points]
    if not set(ENDS) <= set(points) or points[0] != ENDS[0] or points[-1] != ENDS[-1]:
        return "must run from [-1, -1] through [0, 0] to [1, 1]"
    if any(b <= a for a, b in pairwise(commands)):
        return "must have ascending commands"
    if any(b < a for a, b in pairwise(shares)):
        return "must not fall: more command, more thrust"
    if any(abs(100.0 * c - round(100.0 * c)) > 1e-9 for c in commands):
        return "must have commands in whole per cent (-0.25, 0.1)"
    return None if len(points) > len(ENDS) else "must have a knot between its ends"


def knots(points: Points) -> tuple[float, ...]:
    """The commands whose shares are numbers of the model: all but −1, 0 and 1."""
    return tuple(c for c, _ in points if c not in (-1.0, 0.0, 1.0))


def key_of(command: float) -> str:
    """0.25 -> "curve_25"."""
    return f"{KEY}{round(100.0 * command)}"


def shares(points: Points) -> dict[str, float]:
    """Key -> share of full thrust, knot by knot."""
    return {key_of(c): s for c, s in points if c in knots(points)}


def outward(key: str, keys: Iterable[str]) -> str | None:
    """The next knot away from zero on the same side; None: full thrust."""
    own = int(key.removeprefix(KEY))
    beyond = [c for c in (int(k.removeprefix(KEY)) for k in keys) if c / own > 1.0]
    return key_of(min(beyond, key=abs) / 100.0) if beyond else None


def table_of(thrusters: Sequence["Thruster"], thruster: "Thruster") -> int:
    """Which thruster has the table that this one follows; −1: its curve is a power."""
    for i, other in enumerate(thrusters):
        if not isinstance(other.curve, str) and other.name in (thruster.name, thruster.curve):
            return i
    return -1


def exponent_of(thruster: "Thruster") -> float:
    """Of a curve that is a power; 1 for one that is a table."""
    return CURVES.get(thruster.curve, 1.0) if isinstance(thruster.curve, str) else 1.0


def tabled(curve: str | Points) -> Points:
    """A curve as a table that may be freed: one by name at the usual knots."""
    if not isinstance(curve, str):
        return curve
    sides = [-c for c in reversed(FREED)], FREED
    inner = [(c, float(np.sign(c) * abs(c) ** CURVES[curve])) for c in (*sides[0], 0.0, *sides[1])]
    return (ENDS[0], *inner, ENDS[-1])


def freed(vessel: "Vessel", names: Iterable[str]) -> "Vessel":
    """The same vessel with tables where a free curve is asked for.

    "left.curve" is that of one thruster, "curve" one table for all of them.
    """
    asked = set(names)
    if "curve" in asked and not any(not isinstance(t.curve, str) for t in vessel.thrusters):
        first, *others = vessel.thrusters
        shared = [replace(t, curve=first.name) for t in others]
        return replace(vessel, thrusters=(replace(first, curve=tabled(first.curve)), *shared))
    return replace(
        vessel,
        thrusters=tuple(
            replace(t, curve=tabled(t.curve))
            if f"{t.name}.curve" in asked and t.curve in CURVES
            else t
            for t in vessel.thrusters
        ),
    )
