"""Learned anomaly: a compass that is turned near a place, as a table that measurements filled.

    reported ψ = ψ + y(d),   y(d) = linear between nine knots d_k = a_k reach, constant beyond them
    d² = n² + e²,   n = N − N₀,   e = E − E₀

f0 … f8 are y at the knots [rad]; a_0 = 0, a_8 = 1, and between them `at1` … `at7`, k / 8 where
nothing is said; N₀, E₀ [m] the place, `north` and `east`, in the coordinates of the recording. The
velocity that is reported on board turns by −y, and as y changes u̇ gets + ẏ v, v̇ gets − ẏ u. Valid
for: one such place, on that day, small angles: a pier of steel, a wreck, a moored ship. Source:
Bowditch, American Practical Navigator, 2019, chapters on compasses (local attraction).

Where to look is told by the velocity sideways that is reported, but for what goes with turns: a
boat that goes ahead where its heading is off by y seems to crab by −y.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim.body import Report, with_heading_off
from sim.effects.around import VALUES_AT, around, at_distance, at_knots
from sim.effects.circles import Circle, best_apart, middles, radii
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    ResidualForce,
    Scope,
    Shown,
    Values,
)
from sim.effects.learned_drag import SOFT, inside
from sim.effects.table_parameters import INNER_KNOTS, PLACE, REACH
from sim.effects.tables import EVENLY, KNOTS, MapField, bends
from sim.effects.words import FittedValues
from sim.state import Floats, to_world

DEGREE = math.pi / 180.0

# Places that are tried; all chosen, not measured.
ROWS = 1500  # of the track
WIDEST = 0.5  # radius, of the way across
FAR = 2.5  # radii, of the table
LEAST_SPEED = 0.3  # m/s over ground, for a direction
MOST_CRAB = 0.8  # rad: more is no error of a compass
STARTS = 2


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a compass that is turned near the place reports it."""
    n, e = report.north - p.north, report.east - p.east
    d = np.sqrt(n * n + e * e)
    v_north, v_east = to_world(report.u, report.v, report.yaw)
    d_dot = (n * v_north + e * v_east) / np.maximum(d, 1e-6)
    step = 0.01 * p.reach
    y = at_distance(d, p)
    y_dot = (at_distance(d + step, p) - at_distance(d - step, p)) / (2.0 * step) * d_dot
    return with_heading_off(report, y, y_dot)


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """Tables about the places near which the boat seems to crab."""
    found = residual()
    thin = slice(None, None, max(len(found.time) // ROWS, 1))
    place, (u, v, r) = found.place[thin], found.nu[thin].T
    crab = np.arctan2(-v, np.abs(u)) * np.sign(u)
    use = (np.hypot(u, v) > LEAST_SPEED) & (np.abs(crab) < MOST_CRAB)
    if use.sum() < KNOTS:
        return [_table(0.0, 0.0, 10.0, np.zeros(KNOTS))]
    place, crab, turn = place[use], crab[use], r[use] / np.maximum(np.abs(u[use]), LEAST_SPEED)
    usual = np.stack([np.ones_like(crab), turn, turn * np.abs(turn)], axis=1)
    crab = crab - usual @ np.linalg.lstsq(usual, crab, rcond=None)[0]
    sizes = radii(place, vessel.hull.length, WIDEST)
    circles = [
        _circle(middle, radius, place, crab)
        for middle in middles(place)
        for radius in map(float, sizes)
    ]
    distances = np.linspace(0.0, FAR, KNOTS)
    return [
        _table(
            c.north, c.east, FAR * c.radius,
            np.clip(c.factor * np.asarray(inside(distances, 0.0, 1.0, SOFT)), -0.6, 0.6),
        )
        for c in best_apart(circles, STARTS)
    ]  # fmt: skip


def _circle(middle: Floats, radius: float, place: Floats, crab: Floats) -> Circle:
    """The error that takes most of the crabbing within it; places (T, 2) [m], crab (T,) [rad]."""
    size = np.asarray(inside(np.hypot(*(place - middle).T), 0.0, radius, SOFT))
    size = size - size.mean()
    whole = max(float(size @ size), 1e-9)
    factor = float(size @ crab) / whole
    return Circle(factor**2 * whole, float(middle[0]), float(middle[1]), radius, factor)


def _table(north: float, east: float, reach: float, at: Floats) -> Values:
    return {
        "north": north, "east": east, "reach": reach, **EVENLY,
        **dict(zip(VALUES_AT, map(float, at), strict=True)),
    }  # fmt: skip


def over_map(p: FittedValues) -> MapField:
    """The error of the heading around its place [°]."""
    n, e, size, half = around(p, 1.0 / DEGREE)
    return MapField(p["north"] + n, p["east"] + e, size, 0.0 * size, half, "°", directed=False)


def in_words(p: FittedValues) -> str:
    """By how much at the knots that hold its shape: of those that are known."""
    at, values, half = at_knots(p, 1.0 / DEGREE)
    known = half < np.abs(values).max()
    what = f"the compass is turned near N {p['north']:.0f} m, E {p['east']:.0f} m"
    if not np.abs(values[known]).max(initial=0.0) > 0.0:
        return f"{what}: nowhere surely"
    at, values = at[known], values[known]
    told = ", ".join(
        f"{values[k]:+.1f}° {at[k]:.0f} m away" for k in bends(at, values, KNOTS // 2 + 1)
    )
    return f"{what}: {told}"


EFFECT = Effect(
    name="learned_anomaly",
    scope=Scope.VOYAGE,
    observe=observe,
    parameters=(
        *PLACE,
        REACH,
        *INNER_KNOTS,
        *(
            Parameter(key, "rad", lower=-0.8, upper=0.8, start=0.0, scale=0.02, neutral=0.0,
                      prior=0.2)
            for key in VALUES_AT
        ),
    ),
    looks_like="turns the compass near one place",
    shown_by=(Shown.CHANGE,),
    evidence=EvidenceAxis(ForceAxis.SWAY, "surge"),
    search=search,
    knot_places=tuple(EVENLY),
    over_map=over_map,
    in_words=in_words,
    example={
        "north": 10.0, "east": 5.0, "reach": 24.0, **EVENLY,
        **{key: max(0.3 - 0.1 * k, 0.0) for k, key in enumerate(VALUES_AT)},
    },
    pattern="compass_deviation",
)  # fmt: skip
