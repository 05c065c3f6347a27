"""Ten kinds for the fifth time that no catalogue holds: hulls and motors that remember among them.

Written without a look at what a diagnosis can learn or had found before; nothing was tuned on any
before they were first reported on.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.hidden.hull import damping
from benchmarks.hidden.nature import Cause
from benchmarks.hidden.outputs import Motor
from benchmarks.hidden.scene import Push, Scene, Stream

EARLIER = 1.0  # s: who goes back by more begins another voyage


class Late:
    """A value that follows another one as a first-order lag [s], from zero on.

    It goes on with the time that it is told; a moment that it knows already changes nothing, and
    a time long before that begins anew.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds, self._time, self._now = seconds, math.inf, 0.0

    def follow(self, time: float, value: float) -> float:
        """What is followed has this value now [s] -> where the follower is."""
        if time < self._time - EARLIER:
            self._time, self._now = time, 0.0
        if time > self._time:
            stays = math.exp((self._time - time) / self._seconds)
            self._time, self._now = time, value + stays * (self._now - value)
        return self._now


def own_wake(drag: float, seconds: float) -> Cause:
    """The wave that a hull draws behind it comes `seconds` late: who slows down is overtaken and
    pushed by it, who speeds up has to make it first. drag (w|w| − u|u|), w the late u [N s²/m²].
    """
    wave = Late(seconds)

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        w = wave.follow(s.time, s.u)
        return Push(drag * (w * abs(w) - s.u * abs(s.u)), 0.0, 0.0)

    return Cause(push=push)


def one_way_board(gain: float, x: float) -> Cause:
    """A board at `x` [m] on a hinge: it folds when water comes from port, and holds when the boat
    slips to starboard there, with `gain` times the hull's own sideways damping.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        Y = gain * damping(s.hull, 0.0, max(s.v + x * s.r, 0.0), 0.0).Y
        return Push(0.0, Y, x * Y)

    return Cause(push=push)


def snaking_tow(pull: float, x: float, period: float) -> Cause:
    """A towed body that snakes: it pulls the point `x` [m] to either side in turn, once in each
    `period` [s], by up to pull u² while the boat runs ahead [N s²/m²].
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        Y = pull * max(s.u, 0.0) ** 2 * math.sin(2.0 * math.pi * s.time / period)
        return Push(0.0, Y, x * Y)

    return Cause(push=push)


def power_budget(share: float) -> Cause:
    """The supply bears a `share` of full power: where motors ask for more all are cut back alike,
    so that what one takes the others lack.
    """

    def command(asked: list[float]) -> list[float]:
        load = sum(abs(c) for c in asked) / len(asked)
        return [c * share / max(load, share) for c in asked]

    return Cause(command=command)


def hot_motors(share: float, load: float, seconds: float) -> Cause:
    """Each motor is cut back by its own heat: a `share` of its thrust goes where what was asked of
    it over the last `seconds` was more than a `load`, half of that at the load itself.
    """
    heats: dict[int, Late] = {}

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        heat = heats.setdefault(motor.channel, Late(seconds)).follow(s.time, abs(F) / motor.ahead)
        return F * (1.0 - share * (0.5 + 0.5 * math.tanh((heat - load) / 0.08)))

    return Cause(thrust=thrust)


def notches(step: float) -> Cause:
    """A trolling motor's switch: every command becomes the nearest of a few, `step` apart."""

    def command(asked: list[float]) -> list[float]:
        near = (step * math.floor(c / step + 0.5) for c in asked)
        return [min(max(c, -1.0), 1.0) for c in near]

    return Cause(command=command)


def lily_field(north: float, east: float, radius: float, share: float) -> Cause:
    """Leaves and stalks stop propellers: up to a `share` of all thrust is gone around a place,
    fading over `radius` [m].
    """

    def thrust(F: float, motor: Motor, s: Scene) -> float:
        away = ((s.north - north) ** 2 + (s.east - east) ** 2) / radius**2
        return F * (1.0 - share * math.exp(-0.5 * away))

    return Cause(thrust=thrust)


def lying_across(moment: float, towards: float) -> Cause:
    """Short waves that run `towards` [rad] turn a hull until it lies across them: a moment [N m]
    with the sine of twice the angle between.
    """

    def push(s: Scene, thrusts: Sequence[float]) -> Push:
        return Push(0.0, 0.0, moment * math.sin(2.0 * (s.yaw - towards)))

    return Cause(push=push)


def seiche(
    speed: float, towards: float, period: float, length: float, north: float, east: float
) -> Cause:
    """A harbour's water swings to and fro along a line: not at all at a node, and on either side
    of it against the other, `speed` [m/s] at a quarter of the wave's `length` [m].
    """
    omega, c, s = 2.0 * math.pi / period, math.cos(towards), math.sin(towards)

    def water(time: float, n: float, e: float) -> Stream:
        along = (n - north) * c + (e - east) * s
        high = speed * math.sin(2.0 * math.pi * along / length)
        now, rate = high * math.sin(omega * time), high * omega * math.cos(omega * time)
        return Stream(now * c, now * s, rate * c, rate * s)

    return Cause(water=water)


def soft_iron(angle: float, at: float) -> Cause:
    """Steel near the compass that earth's own field magnetises: the heading is off by up to an
    angle [rad], twice to either side in a full turn; at `at` [rad] and each quarter on it is true.
    """
    return Cause(report=lambda m: m._replace(yaw=m.yaw + angle * np.sin(2.0 * (m.yaw - at))))


CAUSES: Mapping[str, Callable[..., Cause]] = {
    law.__name__: law
    for law in (
        own_wake, one_way_board, snaking_tow, power_budget, hot_motors, notches, lily_field,
        lying_across, seiche, soft_iron,
    )
}  # fmt: skip
