"""Water and air in motion: currents, wind, waves, a force from nowhere."""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.hidden.nature import Cause
from benchmarks.hidden.scene import Push, Scene, Stream

GRAVITY, AIR = 9.81, 1.22  # m/s², kg/m³
COMPONENTS = 24  # of a sea
TURN_S = 12.0  # that a current or a wind takes to become another one


def steady_current(speed: float, direction: float) -> Cause:
    """The water moves towards `direction` [rad] at `speed` [m/s]."""
    north, east = speed * math.cos(direction), speed * math.sin(direction)
    return Cause(water=lambda time, n, e: Stream(north, east))


def _turned(time: float, at: float) -> float:
    """0 before, 1 after, half at the moment itself: smooth, over about `TURN_S`."""
    return 0.5 + 0.5 * math.tanh(2.0 * (time - at) / TURN_S)


def _towards(speed: float, direction: float) -> tuple[float, float]:
    return speed * math.cos(direction), speed * math.sin(direction)


def current_change(
    speed: float, direction: float, later_speed: float, later_direction: float, time: float
) -> Cause:
    """A current that becomes another one around `time`, over a few seconds."""
    first, later = _towards(speed, direction), _towards(later_speed, later_direction)

    def water(now: float, north: float, east: float) -> Stream:
        w = _turned(now, time)
        rate = 4.0 * w * (1.0 - w) / TURN_S
        n, e = (a + w * (b - a) for a, b in zip(first, later, strict=True))
        change = [rate * (b - a) for a, b in zip(first, later, strict=True)]
        return Stream(n, e, change[0], change[1])

    return Cause(water=water)


def varying_current(speed: float, direction: float, period: float, phase: float) -> Cause:
    """A tide: `speed` sin(2π t/`period` + `phase`), a little skewed by its overtide."""
    omega = 2.0 * math.pi / period

    def water(time: float, north: float, east: float) -> Stream:
        a = omega * time + phase
        flow = speed * (math.sin(a) + 0.08 * math.sin(2.0 * a))
        change = speed * omega * (math.cos(a) + 0.16 * math.cos(2.0 * a))
        c, s = math.cos(direction), math.sin(direction)
        return Stream(flow * c, flow * s, change * c, change * s)

    return Cause(water=water)


def steady_wind(speed: float, direction: float, centre: float = 0.0) -> Cause:
    """Wind from `direction` at `speed`; it presses so many lengths ahead of midships."""
    air = _towards(-speed, direction)
    return Cause(push=lambda s, thrusts: _blown(s, *air, centre))


def wind_change(
    speed: float, direction: float, later_speed: float, later_direction: float, time: float
) -> Cause:
    """A wind that becomes another one around `time`, over a few seconds."""
    first, later = _towards(-speed, direction), _towards(-later_speed, later_direction)

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        w = _turned(s.time, time)
        return _blown(s, *(a + w * (b - a) for a, b in zip(first, later, strict=True)))

    return Cause(push=push)


def _blown(s: Scene, north: float, east: float, centre: float = 0.0) -> Push:
    """Of air that moves to north and east: Blendermann's coefficients (Trondheim 1994)."""
    resistance, cross, shape = 0.6, 0.85, 0.5  # ahead, abeam, cross-force parameter

    ahead, right = s.in_body(north, east)
    ahead, right = ahead - s.over_u, right - s.over_v
    q = 0.5 * AIR * (ahead**2 + right**2)
    off_bow = math.atan2(-right, -ahead)  # where it comes from, clockwise from the bow
    thin = resistance * s.hull.frontal / s.hull.lateral / cross
    full = 1.0 - 0.5 * shape * (1.0 - thin) * math.sin(2.0 * off_bow) ** 2
    X = -q * s.hull.frontal * resistance * math.cos(off_bow) / full
    Y = -q * s.hull.lateral * cross * math.sin(off_bow) / full
    lever = centre + 0.18 * (math.pi / 2.0 - abs(off_bow))
    return Push(X, Y, lever * s.hull.length * Y)


def inertial_force(force: float, direction: float) -> Cause:
    """A force [N] towards `direction`, the same whatever the boat does."""
    north, east = force * math.cos(direction), force * math.sin(direction)
    return Cause(push=lambda s, thrusts: Push(*s.in_body(north, east), 0.0))


def wave_motion(force: float, omega: float, direction: float, phase: float) -> Cause:
    """A group of three waves around `omega` [rad/s] that runs towards `direction`."""
    group = ((0.95, 0.4, 1.3), (1.0, 0.85, 0.0), (1.05, 0.4, -0.7))  # frequency, height, phase

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        along = s.north * math.cos(direction) + s.east * math.sin(direction)
        total = 0.0
        for share, height, shift in group:
            w = share * omega
            angle = w * s.time - w * w / GRAVITY * along + phase + shift
            total += force * height * math.sin(angle)
        return Push(*s.in_body(total * math.cos(direction), total * math.sin(direction)), 0.0)

    return Cause(push=push)


def crossing_waves(force: float, omega: float, direction: float, phase: float) -> Cause:
    """A second group of waves, from elsewhere."""
    return wave_motion(force, omega, direction, phase)


def sea(height: float, period: float, direction: float, spread: float, seed: float) -> Cause:
    """A wind sea: `height` [m] significant, peak `period` [s], running towards `direction`.

    `COMPONENTS` long-crested waves of a Pierson–Moskowitz spectrum, of equal energy each, their
    directions scattered by `spread` [rad]. Each pushes by its slope (Froude and Krylov), averaged
    over the hull's length, and turns a hull that lies across.
    """
    dice = np.random.default_rng([int(seed), 0x5EA])
    energy = (np.arange(COMPONENTS) + dice.uniform(0.2, 0.8, COMPONENTS)) / COMPONENTS
    peak = 2.0 * math.pi / period
    omega = peak * (1.25 / -np.log(energy)) ** 0.25  # the spectrum's own distribution, inverted
    omega = np.minimum(omega, 3.0 * peak)  # what is shorter hardly moves a hull
    towards = direction + spread * dice.standard_normal(COMPONENTS)
    phase = dice.uniform(0.0, 2.0 * math.pi, COMPONENTS)
    amplitude = 0.25 * height * math.sqrt(2.0 / COMPONENTS)
    number = omega**2 / GRAVITY
    north, east = number * np.cos(towards), number * np.sin(towards)

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        off = towards - s.yaw
        ahead = np.sinc(number * s.hull.length * np.cos(off) / (2.0 * math.pi))
        across = np.sinc(number * s.hull.beam * np.sin(off) / (2.0 * math.pi))
        slope = (
            amplitude * number * np.sin(omega * s.time - north * s.north - east * s.east + phase)
        )
        each = s.hull.mass * GRAVITY * slope * ahead * across
        arm = 0.1 * s.hull.length * np.sin(2.0 * off)
        return Push(*(float(each @ part) for part in (np.cos(off), np.sin(off), arm)))

    return Cause(push=push)


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        steady_current, varying_current, current_change, steady_wind, wind_change,
        inertial_force, wave_motion, crossing_waves,
    )
}  # fmt: skip
SEAS: Mapping[str, Callable[..., Cause]] = {"sea": sea}  # partly waves of the catalogue, else noise
