"""Ten kinds for the third time that no catalogue holds; four depend on the place or the time.

Written after maps and time histories could be learned; nothing was tuned on any before they were
first reported on.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.hidden.hull import damping
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Push, Report, Scene, Stream


def tide(before: float, after: float, towards: float, turns: float, within: float) -> Cause:
    """A current along a line that goes from one speed to another [m/s] `within` [s] of `turns`."""

    def water(time: float, n: float, e: float) -> Stream:
        x = (time - turns) / within
        mean, half = 0.5 * (before + after), 0.5 * (after - before)
        now, rate = mean + half * math.tanh(x), half / within / math.cosh(min(abs(x), 50.0)) ** 2
        c, s = math.cos(towards), math.sin(towards)
        return Stream(now * c, now * s, rate * c, rate * s)

    return Cause(water=water)


def funnel(force: float, towards: float, north: float, east: float, radius: float) -> Cause:
    """Wind between two buildings: a force [N] amidships around a place, fading over `radius`."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        away = ((s.north - north) ** 2 + (s.east - east) ** 2) / radius**2
        now = force * math.exp(-0.5 * away)
        X, Y = s.in_body(now * math.cos(towards), now * math.sin(towards))
        return Push(X, Y, 0.0)

    return Cause(push=push)


def overheating(share: float, after: float, within: float) -> Cause:
    """A controller takes a `share` of all thrust back, half of it `after` [s], `within` [s]."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * (1.0 - share * (0.5 + 0.5 * math.tanh((s.time - after) / within)))

    return Cause(thrust=thrust)


def bank(suction: float, speed: float, north: float, width: float) -> Cause:
    """A quay wall at `north` [m] draws a boat that passes, up to `suction` [N], half of it at a
    speed [m/s], fading to the south.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        moves = s.u**2 / (s.u**2 + speed**2)
        pull = suction * moves * math.exp(min(s.north - north, 0.0) / width)
        X, Y = s.in_body(pull, 0.0)
        return Push(X, Y, 0.0)

    return Cause(push=push)


def compass_tilt(per_g: float) -> Cause:
    """A compass that swings outward in turns: the heading is off by `per_g` times u r / g [rad]."""

    def report(m: Report) -> Report:
        ahead = m.v_north * np.cos(m.yaw) + m.v_east * np.sin(m.yaw)
        return m._replace(yaw=m.yaw + per_g * ahead * m.r / 9.81)

    return Cause(report=report)


def bottom_line(force: float) -> Cause:
    """A lead drags over the bottom: a constant force [N] against the motion over the ground."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        speed = math.hypot(s.over_u, s.over_v)
        now = force * math.tanh(speed / 0.05) / max(speed, 1e-6)
        return Push(-now * s.over_u, -now * s.over_v, 0.0)

    return Cause(push=push)


def thrust_cap(share: float) -> Cause:
    """A fuse in the controller: no motor ever gives more than a `share` of its thrust ahead."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return min(F, share * motor.ahead)

    return Cause(thrust=thrust)


def slip_loss(share: float, speed: float) -> Cause:
    """Propellers in oblique water: up to a `share` is lost, half at a speed sideways [m/s]."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * (1.0 - share * s.v**2 / (s.v**2 + speed**2))

    return Cause(thrust=thrust)


def bow_rise(gain: float, speed: float) -> Cause:
    """The bow rises with speed and grips less: damping of turns is (1 + gain) at rest, half gone
    at a speed [m/s].
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        now = gain / (1.0 + (s.u / speed) ** 2)
        return Push(0.0, 0.0, now * damping(s.hull, 0.0, 0.0, s.r).N)

    return Cause(push=push)


def head_sea(gain: float, towards: float) -> Cause:
    """Chop from one side: surge drag is up to (1 + gain) times against it, as modelled with it."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        against = 0.5 - 0.5 * math.cos(s.yaw - towards)
        return Push(gain * against * damping(s.hull, s.u, 0.0, 0.0).X, 0.0, 0.0)

    return Cause(push=push)


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        tide, funnel, overheating, bank, compass_tilt, bottom_line, thrust_cap, slip_loss,
        bow_rise, head_sea,
    )
}  # fmt: skip
