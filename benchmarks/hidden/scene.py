"""The generator's vocabulary. Body axes forward and starboard, world north and east, SI units."""

import math
from typing import Any, NamedTuple

from benchmarks.hidden.boats import Hull

Number = Any  # a float, or an array of them: sensor causes take both


class Push(NamedTuple):
    """Force forward, to starboard [N], and moment that turns the bow to starboard [N m]."""

    X: float
    Y: float
    N: float


class Stream(NamedTuple):
    """Velocity of the water [m/s] and acceleration of the water itself [m/s²]."""

    north: float
    east: float
    north_dot: float = 0.0
    east_dot: float = 0.0


class Scene(NamedTuple):
    """One moment: what a cause may depend on. Time in seconds after arming."""

    time: float
    north: float
    east: float
    yaw: float
    u: float  # through the water
    v: float
    r: float
    over_u: float  # over ground
    over_v: float
    voltage: float
    hull: Hull

    def in_body(self, north: float, east: float) -> tuple[float, float]:
        """A world vector -> forward, starboard."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return c * north + s * east, c * east - s * north


class Report(NamedTuple):
    """What sensors report: position [m], yaw [rad], velocity over ground [m/s], rate [rad/s]."""

    north: Number
    east: Number
    yaw: Number
    v_north: Number
    v_east: Number
    r: Number
