"""Learned spot: what differs with the distance from a place, as a table that measurements filled.

    V(d) = linear between nine knots d_k = a_k reach, constant beyond them
    d² = n² + e²,     n = N − N₀,  e = E − E₀
    acts 1 (stream)  the water flows at V towards θ
    acts 2 (eddy)    the water flows at V clockwise around the place, (−e, n) / d
    acts 3 (push)    X, Y = F V towards θ, turned to the heading, N = x_F Y
    acts 4 (pull)    the same towards the place, (−n, −e) / d
    acts 5 (spring)  the water flows at V away from the place, (n, e) / d

f0 … f8 are V at the knots: m/s, or shares of the scale F [N], `full`; a_0 = 0, a_8 = 1, and
between them `at1` … `at7`, k / 8 where nothing is said; N₀, E₀ [m] the place, `north` and `east`,
in the coordinates of the recording; θ [rad] `direction`, clockwise from north; x_F [m] the place
`x` where a force acts. Valid for: one such place, on that day, and what is alike all around it. A
table explains nothing: a stream from a pipe, an eddy behind a pier, water that wells up, a gust
between two buildings, a line to an anchor look like this. Source: Ljung, System Identification, 2nd
ed. 1999, §5.4 (basis functions with local support).

Where to look is told by what a model leaves along the track: the place about which a table of a
given width takes most of the missing force.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.around import VALUES_AT, around, at_distance, at_knots
from sim.effects.circles import Circle, best_apart, middles, radii
from sim.effects.effect import (
    Effect,
    Kind,
    Parameter,
    ResidualForce,
    Scope,
    Shown,
    Values,
    circular_parameter,
)
from sim.effects.learned_drag import SOFT, inside
from sim.effects.table_parameters import ARM, FULL, INNER_KNOTS, PLACE, REACH, knots
from sim.effects.tables import (
    EVENLY,
    KNOTS,
    MapField,
    bends,
    push_scale,
)
from sim.effects.words import FittedValues, towards
from sim.jit import jitable
from sim.state import Floats, Pose, Water, Wrench, to_body

STREAM, EDDY, PUSH, PULL, SPRING = 1.0, 2.0, 3.0, 4.0, 5.0
WATERS, PUSHES = (STREAM, EDDY, SPRING), (PUSH, PULL)

# Places that are tried; all chosen, not measured.
ROWS = 1500  # of the track
WIDEST = 0.5  # radius, of the way across
FAR = 3.0  # radii, of the table of what fades
STARTS = 2  # of each kind, clear of one another


@jitable
def vector(north: Any, east: Any, kind: float, direction: float) -> Any:
    """Unit vector, to the north and to the east, in which V acts at a way from the place [m]."""
    d = np.maximum(np.sqrt(north**2 + east**2), 1e-6)
    fixed = 1.0 * (kind == STREAM) + 1.0 * (kind == PUSH)
    around, to_it = 1.0 * (kind == EDDY), 1.0 * (kind == PULL) - 1.0 * (kind == SPRING)
    return (
        fixed * np.cos(direction) - around * east / d - to_it * north / d,
        fixed * np.sin(direction) + around * north / d - to_it * east / d,
    )


def water(time: float, pose: Pose, p: Any) -> Water:
    """Place -> velocity of the water [m/s]; no acceleration."""
    n, e = pose.north - p.north, pose.east - p.east
    flows = 1.0 * (p.acts < PUSH) + 1.0 * (p.acts == SPRING)
    flows = flows * at_distance(np.sqrt(n**2 + e**2), p)
    to_north, to_east = vector(n, e, p.acts, p.direction)
    return Water(flows * to_north, flows * to_east, 0.0, 0.0)


def force(flow: Flow, p: Any) -> Wrench:
    """Place and heading -> X, Y, N [N, N, N m]."""
    n, e = flow.north - p.north, flow.east - p.east
    push = (1.0 * (p.acts == PUSH) + 1.0 * (p.acts == PULL)) * p.full
    push = push * at_distance(np.sqrt(n**2 + e**2), p)
    to_north, to_east = vector(n, e, p.acts, p.direction)
    X, Y = to_body(push * to_north, push * to_east, flow.yaw)
    return Wrench(X, Y, p.x * Y)


def _table(
    acts: float, north: float, east: float, reach: float, angle: float, full: float, at: Floats
) -> Values:
    return {
        "acts": acts, "north": north, "east": east, "reach": reach, "direction": angle,
        "full": full, "x": 0.0, **EVENLY, **dict(zip(VALUES_AT, map(float, at), strict=True)),
    }  # fmt: skip


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """Tables about the places for which one of some width takes most of the missing force."""
    found = residual()
    thin = slice(None, None, max(len(found.time) // ROWS, 1))
    place, missing = found.place[thin], found.force[thin]
    sizes = radii(place, vessel.hull.length, WIDEST)
    tried: dict[float, list[Circle]] = {PUSH: [], EDDY: [], PULL: [], SPRING: []}
    for middle in middles(place):
        for radius in map(float, sizes):
            for acts, circles in tried.items():
                circles.append(_circle(acts, middle, radius, place, missing))
    best = (circle for circles in tried.values() for circle in best_apart(circles, STARTS))
    return [start for circle in best for start in _starts_at(vessel, circle, place)]


def _shape(acts: float, d: Floats, radius: float) -> Floats:
    """V over the distance: what fades, what turns and fades, a line that is taut from there on."""
    if acts == PULL:
        return np.maximum(d - radius, 0.0) / radius
    near = np.asarray(inside(d, 0.0, radius, SOFT))
    return d / radius * near if acts in {EDDY, SPRING} else near


def _circle(acts: float, middle: Floats, radius: float, place: Floats, missing: Floats) -> Circle:
    """The best factor [N] and direction; places and missing force (T, 2) [m, N]."""
    way = (place - middle).T
    size = _shape(acts, np.hypot(*way), radius)
    if acts == PUSH:
        size = size - size.mean()
        whole = max(float(size @ size), 1e-9)
        north, east = size @ missing / whole
        factor, angle = math.hypot(north, east), math.atan2(east, north)
    else:
        shape = size * np.array(vector(way[0], way[1], acts, 0.0))
        shape = (shape.T - shape.mean(axis=1)).ravel()
        whole = max(float(shape @ shape), 1e-9)
        factor, angle = float(shape @ missing.ravel()) / whole, 0.0
    at = float(middle[0]), float(middle[1])
    return Circle(factor**2 * whole, *at, radius, factor, acts, angle)


def _starts_at(vessel: Any, c: Circle, place: Floats) -> list[Values]:
    """Filled tables of that shape: a force, and water that would give such a force."""
    full, own = push_scale(vessel), vessel.dynamics
    # knots where the boat hardly was would say that nothing is there
    farthest = float(np.quantile(np.hypot(*(place - [c.north, c.east]).T), 0.95))
    reach = min(FAR * c.radius, farthest) if c.law != PULL else farthest
    shape = _shape(c.law, np.linspace(0.0, reach, KNOTS), c.radius)
    per_speed = max(-own.X_u - own.X_uu, 1e-6)  # N of a flow of 1 m/s
    forces = np.clip(c.factor / full * shape, -2.0, 2.0)
    flows = np.clip(c.factor / per_speed * shape, -0.5, 0.5)
    half = 0.5 * vessel.hull.length
    ends = (0.0, half, -half)  # a line is made fast amidships, to the bow or to the stern
    filled = {
        PUSH: ((STREAM, flows, 0.0), (PUSH, forces, 0.0)),
        EDDY: ((EDDY, flows, 0.0),),
        SPRING: ((SPRING, flows, 0.0),),
        PULL: tuple((PULL, forces, x) for x in ends),
    }[c.law]
    begin = c.north, c.east, max(reach, 1.0), c.direction, full
    return [{**_table(acts, *begin, at), "x": x} for acts, at, x in filled]


def over_map(p: FittedValues) -> MapField:
    """The table around its place."""
    n, e, size, half = around(p, _scale(p))
    to_north, to_east = vector(n, e, p["acts"], p["direction"])
    place = p["north"] + n, p["east"] + e
    return MapField(*place, size * to_north, size * to_east, half, _unit(p))


def _scale(p: FittedValues) -> float:
    return p["full"] if p["acts"] in PUSHES else 1.0


def _unit(p: FittedValues) -> str:
    return "N" if p["acts"] in PUSHES else "m/s"


def in_words(p: FittedValues) -> str:
    """What, about which place, and how much at the knots that hold its shape: of those that are
    known, for where the boat hardly was a table says nothing.
    """
    at, values, half = at_knots(p, _scale(p))
    known = half < np.abs(values).max()
    strongest = max(values[known], key=abs, default=0.0)
    back = strongest < 0.0  # told the way in which it is strongest
    what = _what(p, back)
    if strongest == 0.0:
        return f"{what}: nowhere surely"
    at, values = at[known], (-values if back else values)[known]
    told = ", ".join(
        f"{values[k]:+.2g} {_unit(p)} {at[k]:.0f} m away" for k in bends(at, values, KNOTS // 2 + 1)
    )
    return f"{what}: {told}"


def _what(p: FittedValues, back: bool) -> str:
    """What it is, and where; `back`: the other way."""
    place = f"N {p['north']:.0f} m, E {p['east']:.0f} m"
    way = towards(p["direction"] + (math.pi if back else 0.0))
    return {
        STREAM: f"water that flows towards {way} near {place}",
        EDDY: f"water that turns {'anticlockwise' if back else 'clockwise'} around {place}",
        PUSH: f"a push over the ground towards {way} near {place}",
        SPRING: f"water that flows {'towards' if back else 'away from'} {place}",
        PULL: f"a push away from {place}" if back else f"a pull towards {place}",
    }[p["acts"]]


EFFECT = Effect(
    name="learned_spot",
    scope=Scope.VOYAGE,
    water=water,
    force=force,
    parameters=(
        Parameter(
            "acts", "1", lower=1.0, upper=5.0, start=1.0, kind=Kind.CHOICE,
            description="1 a stream, 2 an eddy, 3 a push, 4 a pull towards the place, 5 a spring",
        ),
        *PLACE,
        REACH,
        circular_parameter("direction", "of a stream or a push, clockwise from north", sided=True),
        FULL,
        ARM,
        *INNER_KNOTS,
        *knots(VALUES_AT),
    ),
    looks_like="differs near one place, by no law of the catalogue",
    shown_by=(Shown.CHANGE,),
    search=search,
    knot_places=tuple(EVENLY),
    over_map=over_map,
    in_words=in_words,
    example={
        "acts": 1.0, "north": 10.0, "east": 5.0, "reach": 24.0, "direction": 1.0, "full": 100.0,
        "x": 0.0, **EVENLY, **{key: max(0.4 - 0.1 * k, 0.0) for k, key in enumerate(VALUES_AT)},
    },
    pattern="steady_current",
    acts_when={"water": {"acts": WATERS}, "force": {"acts": PUSHES}},
)  # fmt: skip
