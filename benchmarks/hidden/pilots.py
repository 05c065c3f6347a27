"""Who steers: generators that yield a stick and are sent what the sensors say, tick by tick."""

import math
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import NamedTuple

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.scene import Report

TICK = 0.02  # s between two looks at the sensors


class Stick(NamedTuple):
    """Throttle ahead and steering to starboard, both in [−1, 1]."""

    throttle: float
    steer: float


Pilot = Generator[Stick, Report, None]
REST = Stick(0.0, 0.0)


def pulses_of(boat: Boat, stick: Stick) -> list[int]:
    """Skid steering: the motors to port take throttle + steer, those to starboard −.

    With rudders all motors take the throttle, and the rudders steer.
    """
    steer = boat.helm * stick.steer
    if boat.rudders:
        straight = [m.pulse(stick.throttle) for m in boat.motors]
        return straight + [r.pulse(steer) for r in boat.rudders]
    return [m.pulse(stick.throttle - math.copysign(1.0, m.y) * steer) for m in boat.motors]


def ticks(seconds: float) -> Iterator[float]:
    """The times within a segment [s]."""
    return (k * TICK for k in range(round(seconds / TICK)))


def hold(stick: Stick, seconds: float) -> Pilot:
    """One stick for some seconds."""
    for _ in ticks(seconds):
        yield stick


def steps(levels: Iterable[float], seconds: float) -> Pilot:
    """Throttle steps, straight."""
    for level in levels:
        yield from hold(Stick(level, 0.0), seconds)


def turns(sticks: Iterable[tuple[float, float]], seconds: float) -> Pilot:
    """Steady turns."""
    for throttle, steer in sticks:
        yield from hold(Stick(throttle, steer), seconds)


def zigzag(throttle: float, steer: float, angle: float, seconds: float) -> Pilot:
    """Steer over when the heading has left its start by `angle` [rad], to and fro."""
    seen = yield Stick(throttle, steer)
    start, side = seen.yaw, 1.0
    for _ in ticks(seconds - TICK):
        if side * (seen.yaw - start) > angle:
            side = -side
        seen = yield Stick(throttle, side * steer)


def chirp(mean: Stick, swing: Stick, low: float, high: float, seconds: float) -> Pilot:
    """A sine around `mean` whose frequency rises from `low` to `high` [Hz]."""
    for t in ticks(seconds):
        wave = math.sin(2.0 * math.pi * (low + 0.5 * (high - low) * t / seconds) * t)
        yield Stick(mean.throttle + swing.throttle * wave, mean.steer + swing.steer * wave)


def random_steps(dice: Dice, throttle: tuple[float, float], steer: float, seconds: float) -> Pilot:
    """New sticks every one to five seconds."""
    left = seconds
    while left > 0.0:
        length = min(left, float(dice.uniform(1.0, 5.0)))
        yield from hold(Stick(dice.uniform(*throttle), dice.uniform(-steer, steer)), length)
        left -= max(length, TICK)


def excitation(boat: Boat, dice: Dice) -> Pilot:
    """Everything that tells the parameters of a boat apart, again and again in another order."""
    while True:
        for maneuver in dice.permutation(len(MANEUVERS)):
            yield from MANEUVERS[maneuver](dice, float(dice.uniform(0.85, 1.15)))


def drills(boat: Boat, dice: Dice) -> Pilot:
    """The same with emergency stops from speed and weaving astern among it."""
    each = (*MANEUVERS, *BRAKING)
    while True:
        for maneuver in dice.permutation(len(each)):
            yield from each[maneuver](dice, float(dice.uniform(0.85, 1.15)))


def gentle(boat: Boat, dice: Dice) -> Pilot:
    """The same at a quarter to half the power: a careful owner's first voyage."""
    full = excitation(boat, dice)
    stick = next(full)
    while True:
        stick = full.send((yield Stick(0.5 * stick.throttle, 0.7 * stick.steer)))


def circles(boat: Boat, dice: Dice) -> Pilot:
    """Full circles at two speeds, both ways round, then adrift with motors off."""
    while True:
        for throttle in dice.permutation([0.25, 0.6]):
            yield from turns([(throttle, 0.2), (throttle, -0.2)], 40.0)
        yield from hold(REST, 25.0)


Maneuver = Callable[[Dice, float], Pilot]
MANEUVERS: tuple[Maneuver, ...] = (
    lambda d, k: steps([0.3 * k, 0.6 * k, 0.9 * k, 0.45 * k, 0.15 * k], 7.0),
    lambda d, k: zigzag(0.4 * k, 0.25, 0.5, 30.0),
    lambda d, k: zigzag(0.75 * k, 0.35, 0.9, 30.0),
    lambda d, k: turns([(0.5 * k, 0.12), (0.5 * k, -0.12), (0.25 * k, 0.3)], 12.0),
    lambda d, k: chirp(Stick(0.45 * k, 0.0), Stick(0.0, 0.3), 0.05, 0.5, 30.0),
    lambda d, k: chirp(Stick(0.5 * k, 0.1), Stick(0.35, 0.0), 0.05, 0.5, 30.0),
    lambda d, k: random_steps(d, (0.0, 0.95), 0.3, 40.0),
    lambda d, k: turns([(0.0, 0.4 * k), (0.0, -0.4 * k)], 8.0),
    lambda d, k: turns([(-0.4 * k, 0.05), (-0.7 * k, -0.1), (0.0, 0.0)], 8.0),
    lambda d, k: turns([(0.8 * k, 0.0), (0.0, 0.0)], 9.0),
)
BRAKING: tuple[Maneuver, ...] = (
    lambda d, k: turns([(0.85 * k, 0.0), (-0.6 * k, 0.0)] * 3, 5.0),
    lambda d, k: turns([(0.6 * k, 0.0), (-0.35 * k, 0.08), (0.6 * k, 0.0), (-0.8 * k, -0.05)], 5.0),
    lambda d, k: zigzag(-0.5 * k, 0.25, 0.5, 25.0),
)
