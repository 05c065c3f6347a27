"""Current change: a steady current that becomes another one at one moment.

    V_c = speed (cos direction, sin direction)                     for t < time
    V_c = later_speed (cos later_direction, sin later_direction)   for t >= time

speeds [m/s], towards the directions [rad from north], time [s after the first sample]. Valid for:
water that moves as one and turns within a minute or so: the mouth of a river, the lee of a mole, a
lock that opens. A current that turns over a large part of the voyage is `varying_current`. Source:
Fossen, Handbook of Marine Craft Hydrodynamics, 2nd ed. 2021, §10.3; the moment of a change as in
Basseville and Nikiforov, Detection of Abrupt Changes, 1993, ch. 2.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sim.effects.effect import (
    TIME_OF_CHANGE,
    Effect,
    EvidenceAxis,
    ForceAxis,
    Parameter,
    ResidualForce,
    Scope,
    Separation,
    Shown,
    Values,
    circular_parameter,
)
from sim.effects.pushes import push_changes
from sim.effects.steady_current import DRIFT
from sim.effects.words import FittedValues, until_and_after
from sim.state import Pose, Water

MOMENTS = 12  # at which the search lets the current change


def water(time: float, pose: Pose, p: Any) -> Water:
    """Time [s] -> velocity [m/s] and acceleration [m/s²] of the water."""
    later = 1.0 * (time >= p.time)
    before = 1.0 - later
    return Water(
        before * p.speed * np.cos(p.direction) + later * p.later_speed * np.cos(p.later_direction),
        before * p.speed * np.sin(p.direction) + later * p.later_speed * np.sin(p.later_direction),
        0.0,
        0.0,
    )


def search(vessel: Any, residual: Callable[[], ResidualForce]) -> Sequence[Values]:
    """A current of one direction all along, with the change at moments along the recording; and
    currents whose drag would be the missing force, before and after the best moments.
    """
    found = residual()
    starts: list[Values] = [
        {"speed": 0.2, "direction": 0.0, "later_speed": 0.2, "later_direction": 0.0, "time": t}
        for t in np.linspace(0.0, float(found.time[-1]), MOMENTS + 2)[1:-1]
    ]
    base, (u, v) = vessel.dynamics, np.abs(found.nu[:, :2]).T
    ahead = -base.X_u - 2.0 * base.X_uu * u  # slope of the drag [N s/m]
    abeam = -base.Y_v - 2.0 * base.Y_vv * v
    for push in push_changes(found, ahead, abeam):
        starts.append({
            "speed": push.size, "direction": push.direction, "time": push.time,
            "later_speed": push.later_size, "later_direction": push.later_direction,
        })  # fmt: skip
    return starts


AGAIN = Separation("stay out longer: the same circles before and after", "circles")


def in_words(p: FittedValues) -> str:
    """What was found, in a sentence."""
    return until_and_after(p, "current", "sets towards", "towards")


EFFECT = Effect(
    name="current_change",
    scope=Scope.VOYAGE,
    water=water,
    parameters=(
        Parameter(
            "speed", "m/s", lower=0.0, upper=3.0, start=0.2, scale=0.05, neutral=0.0,
            direction="direction", description="before the change",
        ),
        circular_parameter("direction", "towards, clockwise from north, before", sided=True),
        Parameter(
            "later_speed", "m/s", lower=0.0, upper=3.0, start=0.2, scale=0.05, neutral=0.0,
            direction="later_direction", description="after the change",
        ),
        circular_parameter("later_direction", "towards, clockwise from north, after", sided=True),
        TIME_OF_CHANGE,
    ),
    looks_like="a velocity offset that stays fixed in the world, until it becomes another one at "
    "one moment",
    mistaken_for=("varying_current", "steady_current", "wind_change"),
    shown_by=(Shown.CHANGE, Shown.OPPOSITE),
    general_of="steady_current",
    contains="steady_current",
    evidence=EvidenceAxis(ForceAxis.SURGE, "time"),
    separated={"varying_current": AGAIN, "steady_current": AGAIN, "wind_change": DRIFT},
    search=search,
    in_words=in_words,
    pattern_for=("time",),
)  # fmt: skip
