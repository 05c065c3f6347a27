"""The boat moves as modelled but is not where, or not as, it says."""

from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.hidden.nature import Cause
from benchmarks.hidden.scene import Report


def heading_offset(angle: float) -> Cause:
    """Reported − true heading = `angle` [rad]."""
    return Cause(report=lambda m: m._replace(yaw=m.yaw + angle))


def compass_deviation(b: float, c: float) -> Cause:
    """Reported − true heading = b sin ψ + c cos ψ [rad]: iron on board."""
    return Cause(report=lambda m: m._replace(yaw=m.yaw + b * np.sin(m.yaw) + c * np.cos(m.yaw)))


def antenna_offset(x: float, y: float) -> Cause:
    """Position and velocity are those of an antenna at (x, y) [m]."""

    def report(m: Report) -> Report:
        cos, sin = np.cos(m.yaw), np.sin(m.yaw)
        to_north, to_east = x * cos - y * sin, x * sin + y * cos
        return m._replace(
            north=m.north + to_north,
            east=m.east + to_east,
            v_north=m.v_north - m.r * to_east,
            v_east=m.v_east + m.r * to_north,
        )

    return Cause(report=report)


def velocity_latency(delay: float) -> Cause:
    """Reported position and velocity are `delay` [s] old."""
    return Cause(latency=delay)


def yaw_rate_bias(bias: float) -> Cause:
    """The gyro reads `bias` [rad/s] too much."""
    return Cause(report=lambda m: m._replace(r=m.r + bias))


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (heading_offset, compass_deviation, antenna_offset, velocity_latency, yaw_rate_bias)
}
