"""What no catalogue holds. A diagnosis should say that something is missing, and where."""

import math
from collections.abc import Callable, Mapping, Sequence

from benchmarks.hidden.hull import damping
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Push, Scene, Stream


def shoal(north: float, east: float, radius: float, gain: float) -> Cause:
    """Shallow water: over the shoal surge drag is up to (1 + gain) times as large."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        away = math.hypot(s.north - north, s.east - east) / radius
        return Push(gain * math.exp(-(away**2)) * damping(s.hull, s.u, s.v, s.r).X, 0.0, 0.0)

    return Cause(push=push)


def tether(north: float, east: float, slack: float, stiffness: float) -> Cause:
    """A line from a fixed point to the stern that pulls once it is taut [N/m]."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        x = -0.5 * s.hull.length
        d_north = s.north + x * math.cos(s.yaw) - north
        d_east = s.east + x * math.sin(s.yaw) - east
        away = math.hypot(d_north, d_east)
        pull = -stiffness * max(away - slack, 0.0) / max(away, 1e-6)
        X, Y = s.in_body(pull * d_north, pull * d_east)
        return Push(X, Y, x * Y)

    return Cause(push=push)


def shear_current(gradient: float, north: float) -> Cause:
    """The water runs east, the faster the further north of `north` [1/s], at most 1 m/s."""
    return Cause(water=lambda time, n, e: Stream(0.0, math.tanh(gradient * (n - north))))


def propeller_walk(share: float) -> Cause:
    """Propellers that all turn the same way walk sideways by a `share` of their thrust's size.

    A share of |F|, so that going astern walks to the same side (catalogued misalignment does not).
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        Y = share * sum(abs(F) for F in thrusts)
        return Push(0.0, Y, -0.45 * s.hull.length * Y)

    return Cause(push=push)


def stuttering_motor(channel: float, period: float, hold: float) -> Cause:
    """The motor on `channel` stops for `hold` [s] once in each `period` [s]: a hot controller."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        stopped = motor.channel == int(channel) and s.time % period < hold
        return 0.0 if stopped else F

    return Cause(thrust=thrust)


def bent_skeg(Y_uu: float, x: float) -> Cause:
    """A skeg at `x` [m] that stands askew: Y = Y_uu u|u| whatever the motors do."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        Y = Y_uu * s.u * abs(s.u)
        return Push(0.0, Y, x * Y)

    return Cause(push=push)


def resistance_hump(height: float, speed: float, width: float) -> Cause:
    """The hull's own wave: drag of `height` [N] around one speed [m/s] only."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        bump = math.exp(-(((abs(s.u) - speed) / width) ** 2))
        return Push(-math.copysign(height * bump, s.u), 0.0, 0.0)

    return Cause(push=push)


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        shoal, tether, shear_current, propeller_walk, stuttering_motor, bent_skeg, resistance_hump,
    )
}  # fmt: skip
