"""Wind change: a steady wind that becomes another one at one moment.

Forces and coefficients as of `steady_wind`, with speed [m/s] and direction [rad, from, from north]
before the moment time [s after the first sample], later_speed and later_direction from then on.
Where the boat measured the wind, that wind acts and the parameters do not count. Valid for: a
front that passes, a wind that rises within a minute or so. Source: as of `steady_wind`; the moment
as in Basseville and Nikiforov, Detection of Abrupt Changes, 1993, ch. 2.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim.body import Flow
from sim.effects.effect import (
    QUARTERS,
    TIME_OF_CHANGE,
    Assumption,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Intervals,
    Need,
    Parameter,
    ResidualForce,
    Scope,
    Separation,
    Shown,
    Values,
    circular_parameter,
)
from sim.effects.pushes import push_changes
from sim.effects.steady_wind import CIRCLES, COEFFICIENTS, LIGHT, STRONG, UNSTEADY
from sim.effects.steady_wind import assumption as steady_assumption
from sim.effects.words import FittedValues, until_and_after
from sim.state import Wrench
from sim.wind import AIR_DENSITY, C_X, C_Y, wind_load

MOMENTS = 4  # at which the search lets the wind change; it is then looked for all along


def force(flow: Flow, p: Any) -> Wrench:
    """Velocity over ground, time -> X, Y, N [N, N, N m]."""
    later = 1.0 * (flow.time >= p.time)
    speed, later_speed = (1.0 - later) * p.speed, later * p.later_speed
    north = speed * np.cos(p.direction) + later_speed * np.cos(p.later_direction)
    east = speed * np.sin(p.direction) + later_speed * np.sin(p.later_direction)
    assumed = flow.wind_known - 1.0  # it blows from there: hence the sign
    return wind_load(
        flow,
        flow.wind_known * flow.wind_north + assumed * north,
        flow.wind_known * flow.wind_east + assumed * east,
        p.c_x,
        p.c_n,
        p.centre,
    )


def assumption(vessel: Any, values: Values, ci95: Intervals) -> Assumption | None:
    """What the winds before and after are worth of which only the force is known."""
    parts = []
    for before in ("", "later_"):
        names = (f"{before}speed", f"{before}direction")
        own = {n: values[key] for n, key in zip(("speed", "direction"), names, strict=True)}
        own["c_x"] = values["c_x"]
        sure = {"speed": ci95[names[0]]} if names[0] in ci95 else {}
        parts.append(steady_assumption(vessel, own, sure))
    first, later = parts
    if first is None or later is None:
        return None
    return Assumption(
        f"until {values['time']:.0f} s {first.description}; from then on {later.description}",
        {"speed": first.ci95["speed"], "later_speed": later.ci95["speed"]},
        {**first.numbers, **{f"later_{key}": value for key, value in later.numbers.items()}},
    )


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """One wind from each quarter all along, with the change at moments along the recording; and
    winds that would push as the missing force does, before and after the best moments.
    """
    found = residual()
    starts: list[Values] = [
        {"speed": 5.0, "direction": d, "later_speed": 5.0, "later_direction": d, "time": t}
        for d in QUARTERS
        for t in np.linspace(0.0, float(found.time[-1]), MOMENTS + 2)[1:-1]
    ]
    # of V² towards where the wind blows: the speed of the boat itself is left out
    front, side = vessel.hull.areas
    ahead, abeam = -0.5 * AIR_DENSITY * np.array([C_X * front, C_Y * side])
    rows = np.ones(len(found.time))
    for push in push_changes(found, ahead * rows, abeam * rows):
        starts.append({
            "speed": np.sqrt(push.size), "direction": push.direction, "time": push.time,
            "later_speed": np.sqrt(push.later_size), "later_direction": push.later_direction,
        })  # fmt: skip
    return starts


def more_starts(length: float) -> Sequence[Values]:
    """A light wind before or after a strong one from the same quarter."""
    return [
        {"speed": before, "direction": d, "later_speed": after, "later_direction": d, "time": t}
        for before, after in ((LIGHT, STRONG), (STRONG, LIGHT), (STRONG, STRONG))
        for d in QUARTERS
        for t in np.linspace(0.0, length, MOMENTS + 2)[1:-1]
    ]


AGAIN = Separation("stay out longer: the same circles before and after", "circles")


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return until_and_after(p, "wind", "blows from", "from")


EFFECT = Effect(
    name="wind_change",
    scope=Scope.VOYAGE,
    force=force,
    needs=(Need.WIND_AREA,),
    parameters=(
        Parameter(
            "speed", "m/s", lower=0.0, upper=40.0, start=5.0, scale=0.5, direction="direction",
            description="before the change",
        ),
        circular_parameter("direction", "from, clockwise from north, before", sided=True),
        Parameter(
            "later_speed", "m/s", lower=0.0, upper=40.0, start=5.0, scale=0.5,
            direction="later_direction", description="after the change",
        ),
        circular_parameter("later_direction", "from, clockwise from north, after", sided=True),
        TIME_OF_CHANGE,
        *COEFFICIENTS,
    ),
    looks_like="pushed away from one side of the world, and from one moment on harder, less or "
    "from another side",
    mistaken_for=("current_change", "steady_wind", "varying_current"),
    shown_by=(Shown.CHANGE, Shown.OPPOSITE),
    general_of="steady_wind",
    contains="steady_wind",
    unsteady=UNSTEADY,
    evidence=EvidenceAxis(ForceAxis.SURGE, "time"),
    separated={"steady_wind": AGAIN, "varying_current": CIRCLES},
    search=search,
    more_starts=more_starts,
    in_words=in_words,
    assumption=assumption,
    pattern_for=("time",),
)  # fmt: skip
