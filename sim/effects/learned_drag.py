"""Learned drag: a hull that is dragged more in one place than elsewhere.

    X = k w (X_u + X_uu |u|) u,     w = 1 / (1 + (d / R)²ᵉ),     d² = (N − N₀)² + (E − E₀)²

N₀, E₀ [m] the middle of the place, `north` and `east`, in the coordinates of the recording, R [m]
its `radius`, where half is left, e `edge`: 2 fades over half a radius, 20 ends within a tenth; k
`more`: 1 drags twice as much there as elsewhere. X_u, X_uu of the vessel, u through the water
[m/s]. Valid for: one such place; what it does to sway and yaw is left out. It explains nothing: a
shoal, a bed of weed, ice look like this. Source: Lewis (ed.), Principles of Naval Architecture, 2nd
ed. 1988, vol. II, ch. V (resistance in shallow water: Schlichting 1934).

Where to look is told by what a model leaves along the track: the part of the missing force against
the motion, as much of the hull's own drag inside a circle as fits it best, among circles about
places where the boat was.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.circles import Circle, best_apart, radii
from sim.effects.effect import (
    Effect,
    Parameter,
    ResidualForce,
    Scope,
    Shown,
    Values,
)
from sim.effects.tables import MapField
from sim.effects.words import FittedValues
from sim.jit import jitable
from sim.state import Floats, Wrench

# Circles that are tried; all chosen, not measured.
MIDDLES = 120  # places of the track
WIDEST = 1.0 / 3.0  # radius, of the way across what was sailed
SOFT = 2.0  # edge
STARTS = 4  # the best circles, each clear of those before it
REACH, FINE = 3.0, 61  # radii, and places along them, of the picture
FASTEST = 20.0  # m/s: a place that jumps faster is no motion


@jitable
def inside(north: Any, east: Any, radius: float, edge: float) -> Any:
    """w at a way north and east of the middle [m]: 1 there and 0 far away."""
    return 1.0 / (1.0 + ((north**2 + east**2) / radius**2) ** edge)


def force(flow: Flow, p: Any) -> Wrench:
    """Place and velocity through the water -> X, Y, N [N, N, N m]."""
    damping = (flow.body.X_u + flow.body.X_uu * np.abs(flow.u)) * flow.u
    w = inside(flow.north - p.north, flow.east - p.east, p.radius, p.edge)
    return Wrench(p.more * w * damping, 0.0, 0.0)


def _circle(north: float, east: float, radius: float, more: float) -> Values:
    return {"north": north, "east": east, "radius": radius, "edge": SOFT, "more": more}


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """The circles in which more of the hull's drag takes most of the missing force."""
    found = residual()
    place, against, drag = _against_motion(vessel, found)
    if len(place) < MIDDLES:
        north, east = found.place.mean(axis=0)
        return [_circle(float(north), float(east), 2.0 * vessel.hull.length, 0.5)]
    sizes = radii(place, vessel.hull.length, WIDEST)
    tried: list[Circle] = []
    for middle in place[:: len(place) // MIDDLES]:
        north, east = (place - middle).T
        for radius in map(float, sizes):
            taken, more = _taken(drag * inside(north, east, radius, SOFT), drag, against)
            tried.append(Circle(taken, float(middle[0]), float(middle[1]), radius, more))
    return [
        _circle(c.north, c.east, c.radius, float(np.clip(c.factor, 0.2, 5.0)))
        for c in best_apart(tried, STARTS)
    ]


def _against_motion(vessel: Any, found: ResidualForce) -> tuple[Floats, Floats, Floats]:
    """Places (n, 2) [m], missing force along the motion (n,), the hull's drag there (n,) [N]."""
    step = np.diff(found.time)
    velocity = np.diff(found.place, axis=0) / step[:, None]
    speed = np.linalg.norm(velocity, axis=1)
    sailed = (speed > 0.0) & (speed < FASTEST)
    velocity, speed = velocity[sailed], speed[sailed]
    place, force = found.place[:-1][sailed], found.force[:-1][sailed]
    own = vessel.dynamics
    drag = (own.X_u + own.X_uu * speed) * speed
    return place, np.sum(force * velocity, axis=1) / speed, drag


def _taken(w: Floats, drag: Floats, against: Floats) -> tuple[float, float]:
    """What w and the hull's own drag together take of a force beyond the drag alone, in squares,
    and the factor of w.
    """
    whole = max(float(drag @ drag), 1e-12)
    aside = w - drag * (float(w @ drag) / whole)
    size = float(aside @ aside)
    if size < 1e-9 * whole:
        return 0.0, 0.0
    factor = float(aside @ against) / size
    return factor**2 * size, factor


def over_map(p: FittedValues) -> MapField:
    """The drag that is added around the place, in per cent of the hull's own."""
    away = np.linspace(-REACH, REACH, FINE) * p["radius"]
    north, east = (x.ravel() for x in np.meshgrid(away, away, indexing="ij"))
    value = 100.0 * p["more"] * inside(north, east, p["radius"], p["edge"])
    none = np.zeros_like(value)
    place = p["north"] + north, p["east"] + east
    return MapField(*place, value, none, none, "%", directed=False)


def in_words(p: FittedValues) -> str:
    """Where, and by how much."""
    place = f"N {p['north']:.0f} m, E {p['east']:.0f} m"
    return (
        f"drag that differs from place to place: {p.size('more', '%', 100.0)} more within "
        f"{p['radius']:.0f} m of {place}"
    )


EFFECT = Effect(
    name="learned_drag",
    scope=Scope.VOYAGE,
    force=force,
    parameters=(
        Parameter("north", "m", lower=-1e6, upper=1e6, start=0.0, scale=3.0,
                  description="middle of the place"),
        Parameter("east", "m", lower=-1e6, upper=1e6, start=0.0, scale=3.0,
                  description="middle of the place"),
        Parameter("radius", "m", lower=0.5, upper=1e4, start=10.0, scale=3.0),
        Parameter("edge", "1", lower=1.0, upper=20.0, start=SOFT, scale=1.0,
                  description="how sharply it ends: 2 over half a radius, 20 within a tenth"),
        Parameter("more", "1", lower=0.0, upper=20.0, start=0.5, scale=0.3, neutral=0.0,
                  description="of the hull's drag, in the middle"),
    ),
    looks_like="is slowed down in one place, whichever way it goes",
    shown_by=(Shown.CHANGE,),
    search=search,
    over_map=over_map,
    in_words=in_words,
    example={"north": 10.0, "east": 5.0, "radius": 8.0, "edge": 2.0, "more": 1.5},
    pattern="cubic_drag",
)  # fmt: skip
