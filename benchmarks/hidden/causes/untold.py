"""Ten kinds for the fourth time that no catalogue holds: what people who run boats meet.

Written without a look at what a diagnosis can learn or had found before; nothing was tuned on any
before they were first reported on.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.hidden.boats import Hull
from benchmarks.hidden.hull import damping
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Push, Report, Scene, Stream


def leaking(more: float, seconds: float) -> Cause:
    """Water comes in until pumps hold it: everything weighs up to (1 + more) times as much, most of
    it within `seconds`; the hull sits deeper, and all damping grows with its weight's two thirds.
    """

    def filled(h: Hull, time: float) -> Hull:
        f = 1.0 + more * (1.0 - math.exp(-max(time, 0.0) / seconds))
        d = f ** (2.0 / 3.0)
        return h._replace(
            mass=h.mass * f, m11=h.m11 * f, m22=h.m22 * f, m33=h.m33 * f, X_u=h.X_u * d,
            X_uu=h.X_uu * d, Y_v=h.Y_v * d, Y_vv=h.Y_vv * d, N_r=h.N_r * d, N_rr=h.N_rr * d,
        )  # fmt: skip

    return Cause(hull=filled)


def listing(y: float) -> Cause:
    """The battery slid to one side, where the hull sits deeper: it is dragged at `y` [m]."""

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        return Push(0.0, 0.0, -y * damping(s.hull, s.u, 0.0, 0.0).X)

    return Cause(push=push)


def winch_cast(drag: float, x: float, period: float, lasts: float) -> Cause:
    """A winch at `x` [m] lowers a sonde and heaves it again, each `period` for `lasts` [s]: fully
    out it is dragged by −drag |V| V with V of that point [N s²/m²].
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        since = s.time % period
        out = math.sin(math.pi * since / lasts) if since < lasts else 0.0
        u, v = s.u, s.v + x * s.r
        pull = -drag * out * math.hypot(u, v)
        return Push(pull * u, pull * v, x * pull * v)

    return Cause(push=push)


def undervoltage(share: float, volts: float) -> Cause:
    """A controller spares its battery: below a voltage under load a `share` of thrust is gone."""

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        return F * (1.0 - share * (0.5 + 0.5 * math.tanh((volts - s.voltage) / 0.05)))

    return Cause(thrust=thrust)


def air_at_rest(share: float, speed: float) -> Cause:
    """Propellers that work hard in water that stands draw air: up to a `share` of their thrust, the
    more the harder they work, is gone; half of that at an inflow [m/s].
    """

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        inflow = max(s.u - motor.y * s.r, 0.0)
        load = min(max(F / motor.ahead, 0.0), 1.0)
        return F * (1.0 - share * load / (1.0 + (inflow / speed) ** 2))

    return Cause(thrust=thrust)


def winding_weed(channel: float, share: float, period: float) -> Cause:
    """Weed winds up on the propeller on `channel` until it tears off, once in each `period` [s]:
    what is lost grows from nothing to a `share`.
    """

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        if motor.channel != int(channel):
            return F
        return F * (1.0 - share * (s.time % period) / period)

    return Cause(thrust=thrust)


def ferry_wake(
    force: float, towards: float, speed: float, omega: float, rises: float, period: float,
    lasts: float,
) -> Cause:  # fmt: skip
    """Each `period` [s] a ferry's wake runs through, `towards` [rad], at a speed [m/s], and
    `lasts` [s]: long waves of `omega` [rad/s] come first, the last are by `rises` [rad/s] quicker.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        along = s.north * math.cos(towards) + s.east * math.sin(towards)
        since = (s.time - along / speed) % period
        if since >= lasts:
            return Push(0.0, 0.0, 0.0)
        high = force * math.sin(math.pi * since / lasts) ** 2
        now = high * math.sin((omega + 0.5 * rises * since / lasts) * since)
        return Push(*s.in_body(now * math.cos(towards), now * math.sin(towards)), 0.0)

    return Cause(push=push)


def loose_tarp(force: float, towards: float, x: float) -> Cause:
    """A tarp at `x` [m] that wind from port fills and wind from starboard lays flat: a force [N] to
    starboard, with the square of the sine at which wind `towards` [rad] crosses the boat.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        Y = force * max(math.sin(towards - s.yaw), 0.0) ** 2
        return Push(0.0, Y, x * Y)

    return Cause(push=push)


def steel_pier(angle: float, north: float, east: float, radius: float) -> Cause:
    """Steel in the water swings the compass: the heading is off by up to an angle [rad] around a
    place, fading over `radius` [m].
    """

    def report(m: Report) -> Report:
        away = ((m.north - north) ** 2 + (m.east - east) ** 2) / radius**2
        return m._replace(yaw=m.yaw + angle * np.exp(-0.5 * away))

    return Cause(report=report)


def aerator(north: float, east: float, radius: float, speed: float) -> Cause:
    """Bubbles rise at a place and the water spreads from it: `speed` [m/s] outward at `radius` [m],
    less further out and in.
    """

    def water(time: float, n: float, e: float) -> Stream:
        x, y = (n - north) / radius, (e - east) / radius
        size = speed * math.exp(0.5 - 0.5 * (x * x + y * y))
        return Stream(size * x, size * y)

    return Cause(water=water)


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        leaking, listing, winch_cast, undervoltage, air_at_rest, winding_weed, ferry_wake,
        loose_tarp, steel_pier, aerator,
    )
}  # fmt: skip
