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
from sim.effects.circles import Circle, best_apart, radii
from sim.effects.effect import (
    Effect,
    EvidenceAxis,
    ForceAxis,
    Kind,
    Parameter,
    ResidualForce,
    Scope,
    Shown,
    Values,
)
from sim.effects.learned_drag import SOFT, inside
from sim.effects.table_parameters import INNER_KNOTS
from sim.effects.tables import EVENLY, KNOTS, MapField, along, bends, between_nine, knot_shares
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Floats, to_world

VALUES_AT = [f"f{k}" for k in range(KNOTS)]
DEGREE = math.pi / 180.0

# Places that are tried; all chosen, not measured.
ROWS = 1500  # of the track
MIDDLES, SIDE = 60, 7  # along the track, and along either side of what was sailed
WIDEST = 0.5  # radius, of the way across
REACH = 2.5  # radii, of the table
LEAST_SPEED = 0.3  # m/s over ground, for a direction
MOST_CRAB = 0.8  # rad: more is no error of a compass
STARTS = 2
FINE = 25  # places along either side of the picture


@jitable
def table(d: float, p: Any) -> float:
    """Error of the heading [rad] at a distance from the place [m]."""
    return between_nine(
        along(d, 0.0, p.reach),
        p.at1, p.at2, p.at3, p.at4, p.at5, p.at6, p.at7,
        p.f0, p.f1, p.f2, p.f3, p.f4, p.f5, p.f6, p.f7, p.f8,
    )  # fmt: skip


def observe(report: Report, p: Any) -> Report:
    """True motion -> motion as a compass that is turned near the place reports it."""
    n, e = report.north - p.north, report.east - p.east
    d = np.sqrt(n * n + e * e)
    v_north, v_east = to_world(report.u, report.v, report.yaw)
    d_dot = (n * v_north + e * v_east) / np.maximum(d, 1e-6)
    step = 0.01 * p.reach
    y = table(d, p)
    y_dot = (table(d + step, p) - table(d - step, p)) / (2.0 * step) * d_dot
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
    low, high = np.quantile(place, [0.02, 0.98], axis=0)
    grid = np.stack(np.meshgrid(*np.linspace(low, high, SIDE).T), -1).reshape(-1, 2)
    middles = np.concatenate([place[:: max(len(place) // MIDDLES, 1)], grid])
    sizes = radii(place, vessel.hull.length, WIDEST)
    circles = [
        _circle(middle, radius, place, crab) for middle in middles for radius in map(float, sizes)
    ]
    distances = np.linspace(0.0, REACH, KNOTS)
    return [
        _table(
            c.north, c.east, REACH * c.radius,
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
    away = np.linspace(-p["reach"], p["reach"], FINE)
    n, e = (x.ravel() for x in np.meshgrid(away, away, indexing="ij"))
    near = np.hypot(n, e) <= p["reach"]
    n, e = n[near], e[near]
    at, values, interval = _at_knots(p)
    size, half = (np.interp(np.hypot(n, e), at, of) for of in (values, interval))
    return MapField(p["north"] + n, p["east"] + e, size, 0.0 * size, half, "°", directed=False)


def _at_knots(p: FittedValues) -> tuple[Floats, Floats, Floats]:
    """Distances (K,) [m], errors there and half of their intervals (K,) [°]."""
    ends = np.array([p.ci95.get(key, (0.0, 0.0)) for key in VALUES_AT])
    values = np.array([p[key] for key in VALUES_AT]) / DEGREE
    return p["reach"] * knot_shares(p), values, 0.5 * (ends[:, 1] - ends[:, 0]) / DEGREE


def in_words(p: FittedValues) -> str:
    """By how much at the knots that hold its shape: of those that are known."""
    at, values, half = _at_knots(p)
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
        Parameter("north", "m", lower=-1e6, upper=1e6, start=0.0, scale=3.0,
                  description="the place"),
        Parameter("east", "m", lower=-1e6, upper=1e6, start=0.0, scale=3.0,
                  description="the place"),
        Parameter("reach", "m", lower=0.5, upper=1e5, start=30.0, kind=Kind.FIXED,
                  description="distance of the last knot from it"),
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
