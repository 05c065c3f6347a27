"""Ten more causes that no catalogue holds, for figures.

Nothing was tuned on any before they were first reported on; since then `MAX_SHARE_LEFT`, on two.
"""

import math
from collections.abc import Callable, Mapping, Sequence

from benchmarks.hidden.hull import damping
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Push, Scene, Stream


def _above(x: float, edge: float, width: float) -> float:
    """0 far below the edge, 1 far above it."""
    return 0.5 * (1.0 + math.tanh((x - edge) / width))


def ventilation(speed: float, share: float) -> Cause:
    """Propellers draw air above a speed [m/s]: a `share` of their thrust is gone there."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * (1.0 - share * _above(s.u, speed, 0.08 * speed)) if F > 0.0 else F

    return Cause(thrust=thrust)


def turning_loss(share: float, rate: float) -> Cause:
    """In the oblique flow of a turn propellers lose up to a `share`, half at a rate [rad/s]."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * (1.0 - share * s.r**2 / (s.r**2 + rate**2))

    return Cause(thrust=thrust)


def wake_of_the_other(share: float) -> Cause:
    """Propellers drink from one stream: of the thrust that all have ahead a `share` is gone."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        return Push(-share * len(thrusts) * max(min(thrusts), 0.0), 0.0, 0.0)

    return Cause(push=push)


def river_mouth(north: float, east: float, towards: float, width: float, speed: float) -> Cause:
    """A jet of water [m/s] through a point, `towards` [rad], fading sideways over `width` [m]."""

    def water(time: float, n: float, e: float) -> Stream:
        off = (e - east) * math.cos(towards) - (n - north) * math.sin(towards)
        now = speed * math.exp(-((off / width) ** 2))
        return Stream(now * math.cos(towards), now * math.sin(towards))

    return Cause(water=water)


def wind_shadow(force: float, towards: float, east: float, width: float) -> Cause:
    """A wind's force [N] amidships, `towards` [rad], but none in the lee west of `east` [m]."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        now = force * _above(s.east, east, width)
        X, Y = s.in_body(now * math.cos(towards), now * math.sin(towards))
        return Push(X, Y, 0.0)

    return Cause(push=push)


def planing(speed: float, share: float) -> Cause:
    """The hull climbs out of the water: above a speed [m/s] a `share` of its resistance is gone."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        gone = share * _above(abs(s.u), speed, 0.1 * speed)
        return Push(-gone * damping(s.hull, s.u, s.v, s.r).X, 0.0, 0.0)

    return Cause(push=push)


def lopsided_turning(gain: float) -> Cause:
    """Something hangs at one bilge: turning to starboard is damped (1 + gain) times as much."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        return Push(0.0, 0.0, gain * damping(s.hull, 0.0, 0.0, max(s.r, 0.0)).N)

    return Cause(push=push)


def stiff_turning(moment: float) -> Cause:
    """A moment [N m] against any turn, however slow: a line that drags around the hull."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        return Push(0.0, 0.0, -moment * math.tanh(s.r / 0.02))

    return Cause(push=push)


def weed(gain: float, period: float, holds: float) -> Cause:
    """Weed is caught in each `period` [s] for `holds` [s]: surge drag is (1 + gain) times."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        caught = s.time % period < holds
        return Push(gain * damping(s.hull, s.u, s.v, s.r).X if caught else 0.0, 0.0, 0.0)

    return Cause(push=push)


def compass_lag(lag: float) -> Cause:
    """A damped compass: the heading comes `lag` [s] after the boat's, all else in time."""
    return Cause(report=lambda m: m._replace(yaw=m.yaw - lag * m.r))


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        ventilation, turning_loss, wake_of_the_other, river_mouth, wind_shadow, planing,
        lopsided_turning, stiff_turning, weed, compass_lag,
    )
}  # fmt: skip
