"""An autopilot that follows waypoints: heading and speed are controlled, sticks follow."""

import math
from collections.abc import Callable, Generator, Mapping
from typing import NamedTuple

from numpy.random import Generator as Dice

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.pilots import TICK, Pilot, Stick, circles, drills, excitation, gentle
from benchmarks.hidden.scene import Report

ARRIVED = 3.0  # m
PATIENCE = 90.0  # s, before the next waypoint is taken

Point = tuple[float, float]


class Gains(NamedTuple):
    """Steering for each radian of heading, and against each rad/s of turning."""

    heading: float
    rate: float


CALM = Gains(0.9, 0.5)
SHARP = Gains(4.0, -1.5)  # boats of the fleet swing every three to five seconds
Leg = Generator[Stick, Report, Report]  # gives back what was seen last


def survey(boat: Boat, dice: Dice) -> Pilot:
    """Mowing the lawn: long legs and short ones across, now and then at another speed."""
    seen = yield Stick(0.0, 0.0)
    legs, spacing = float(dice.uniform(25.0, 45.0)), float(dice.uniform(6.0, 12.0))
    heading = float(dice.uniform(-math.pi, math.pi))
    north, east, side = seen.north, seen.east, 1.0
    while True:
        for length, turn in ((legs, 0.5 * math.pi * side), (spacing, 0.5 * math.pi * side)):
            speed = boat.top_speed() * float(dice.uniform(0.35, 0.8))
            start = (north, east)
            north += length * math.cos(heading)
            east += length * math.sin(heading)
            seen = yield from go(boat, seen, start, (north, east), speed)
            heading += turn
        side = -side


def wander(boat: Boat, dice: Dice) -> Pilot:
    """From point to point within a harbour."""
    return _between_points(boat, dice, CALM)


def hunting(boat: Boat, dice: Dice) -> Pilot:
    """The same by an autopilot whose steering is set too sharp: it swings to and fro."""
    return _between_points(boat, dice, SHARP)


def _between_points(boat: Boat, dice: Dice, gains: Gains) -> Pilot:
    seen = yield Stick(0.0, 0.0)
    here = (seen.north, seen.east)
    while True:
        there = (float(dice.uniform(-40.0, 40.0)), float(dice.uniform(-40.0, 40.0)))
        speed = boat.top_speed() * float(dice.uniform(0.3, 0.85))
        seen = yield from go(boat, seen, here, there, speed, gains)
        here = there


def straight(boat: Boat, dice: Dice) -> Pilot:
    """One long leg: heading and speed held, as far as the sea allows."""
    seen = yield Stick(0.0, 0.0)
    heading, speed = float(dice.uniform(-math.pi, math.pi)), 0.55 * boat.top_speed()
    start = (seen.north, seen.east)
    goal = (start[0] + 1e5 * math.cos(heading), start[1] + 1e5 * math.sin(heading))
    while True:
        seen = yield from go(boat, seen, start, goal, speed)


def go(
    boat: Boat, seen: Report, start: Point, goal: Point, speed: float, gains: Gains = CALM
) -> Leg:
    """Along the line from start to goal at a speed [m/s]."""
    track = math.atan2(goal[1] - start[1], goal[0] - start[0])
    length = math.hypot(goal[0] - start[0], goal[1] - start[1])
    gathered = 0.0
    for _ in range(round(PATIENCE / TICK)):
        done, aside = _on_track(seen, start, track)
        if done > length - ARRIVED:
            break
        course = track - math.atan2(aside, 4.0 * boat.hull.length)
        slow = max(0.25, math.cos(_wrapped(course - seen.yaw)))
        error = slow * speed - _ahead(seen)
        gathered = min(max(gathered + 0.15 * error * TICK, -0.3), 0.3)
        throttle = _feed_forward(boat, slow * speed) + 0.4 * error + gathered
        steer = gains.heading * _wrapped(course - seen.yaw) - gains.rate * seen.r
        seen = yield Stick(min(max(throttle, -0.5), 1.0), min(max(steer, -0.5), 0.5))
    return seen


def _on_track(seen: Report, start: Point, track: float) -> Point:
    """Distance made good along the track and to starboard of it [m]."""
    n, e, c, s = seen.north - start[0], seen.east - start[1], math.cos(track), math.sin(track)
    return c * n + s * e, c * e - s * n


def _ahead(seen: Report) -> float:
    return float(seen.v_north * math.cos(seen.yaw) + seen.v_east * math.sin(seen.yaw))


def _feed_forward(boat: Boat, speed: float) -> float:
    return -(boat.hull.X_u + boat.hull.X_uu * abs(speed)) * speed / boat.ahead


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


PILOTS: Mapping[str, Callable[[Boat, Dice], Pilot]] = {
    pilot.__name__: pilot
    for pilot in (excitation, drills, gentle, circles, survey, wander, hunting, straight)
}
