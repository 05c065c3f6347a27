"""Port and starboard, from a recording alone: do the two throttles turn the boat as they are named?

Which output is which side is said by SERVOn_FUNCTION (73 left, 74 right) or by the names of a
table's columns (left, port; right, starboard). Which way a motor turns ahead is taken from the
parameters, or else found: of the four ways, those that drive the boat as fast as it went. All of
them must agree that it turned the other way.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from gateway.ingest.log import Log
from gateway.ingest.parameters import Actuator, OutputFunction
from gateway.ingest.sources import Choice
from gateway.samples import Quantity, Samples
from sim.identification.wiring import MIN_MOTION_STD, CommandResponse, command_response
from sim.state import Floats, Nu

GRID_S = 0.2
PORT = re.compile(r"left|port|lft|babord|backbord", re.IGNORECASE)
STARBOARD = re.compile(r"right|starboard|stbd|stb|rgt|tribord|steuerbord", re.IGNORECASE)
HALF_US = 400.0  # from neutral to full, where nobody says more

NEAR = 0.2  # of a correlation: then either way may be
Ways = tuple[int, int]
BOTH: tuple[Ways, ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))
Side = tuple[int, float, int]  # channel, neutral pulse [µs], +1 or −1 ahead, 0 not known


def sides_of(log: Log, found: Sequence[Actuator]) -> tuple[Side, Side] | None:
    """The throttle to port and the one to starboard, as they are called; None: not one of each."""
    left = [a for a in found if a.kind is OutputFunction.THROTTLE_LEFT]
    right = [a for a in found if a.kind is OutputFunction.THROTTLE_RIGHT]
    if len(left) == len(right) == 1:
        a, b = left[0], right[0]
        return (a.channel, a.pwm[1], _way(a)), (b.channel, b.pwm[1], _way(b))
    named = log.channel_names()
    left_of = [n for n, column in named.items() if PORT.search(column)]
    right_of = [n for n, column in named.items() if STARBOARD.search(column)]
    if len(left_of) == len(right_of) == 1 and left_of != right_of:
        return (left_of[0], np.nan, 0), (right_of[0], np.nan, 0)
    return None


def swapped(choices: Mapping[str, Choice], sides: tuple[Side, Side]) -> CommandResponse | None:
    """How the boat turned by the difference of its throttles; None: it was not told."""
    if "commands" not in choices or "yaw" not in choices:
        return None
    time = _grid(choices)
    if len(time) < 10:
        return None
    commands = [_throttle(choices["commands"].samples, side, time) for side in sides]
    heading = choices["yaw"].samples
    r = _turn_rate(choices, heading, time)
    speed = _speed(choices, time)
    ways = _ways(commands, [side[2] for side in sides], speed)
    if not ways:
        return None
    told = [_turned(commands, way, r) for way in ways]
    return None if None in told else min((a for a in told if a), key=lambda a: abs(a.correlation))


def _turned(commands: Sequence[Floats], ways: Ways, r: Floats) -> CommandResponse | None:
    """Turn rate (T,) against port minus starboard."""
    difference = 0.5 * (ways[0] * commands[0] - ways[1] * commands[1])
    rows = np.isfinite(difference) & np.isfinite(r)
    return command_response(
        np.nan_to_num(difference), np.nan_to_num(r), rows, GRID_S, MIN_MOTION_STD[Nu.R]
    )


def says(found: CommandResponse | None, sides: tuple[Side, Side]) -> tuple[str, ...]:
    """One sentence where the boat turns the other way."""
    if found is None or found.sign >= 0:
        return ()
    return (
        f"port and starboard commands look swapped (channels {sides[0][0]} and {sides[1][0]}): the "
        "boat turns away from the side that it is steered to, correlation of turn rate with port "
        f"minus starboard {found.correlation:.2f}; exchange their channels in the vessel file",
    )


def _way(a: Actuator) -> int:
    return -1 if a.reversed else 1


def _seconds(samples: Samples) -> Floats:
    return np.asarray(samples.vehicle_time_ns * 1e-9, np.float64)


def _grid(choices: Mapping[str, Choice]) -> Floats:
    """Moments [s] with heading and commands."""
    spans = [_seconds(choices[name].samples) for name in ("yaw", "commands")]
    start, end = max(s.min() for s in spans), min(s.max() for s in spans)
    return np.arange(start, end, GRID_S, dtype=np.float64)


def _at(samples: Samples, values: Floats, time: Floats) -> Floats:
    """Values (K,) at moments (T,)."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    return np.interp(time, _seconds(samples)[order], values[order])


def _throttle(samples: Samples, side: Side, time: Floats) -> Floats:
    """One side's pulses as commands (T,) in about −1 … 1; NaN without a pulse."""
    channel, neutral, _ = side
    pulse = samples.values[:, channel - 1]
    alive = np.isfinite(pulse) & (pulse > 0) & (pulse < 65535)
    if not alive.any():
        return np.full(len(time), np.nan)
    middle = neutral if np.isfinite(neutral) else _middle(pulse[alive])
    held = np.searchsorted(_seconds(samples), time, side="right") - 1
    command = np.where(alive, (pulse - middle) / HALF_US, np.nan)
    return np.asarray(np.clip(command[np.maximum(held, 0)], -1.0, 1.0))


def _middle(pulse: Floats) -> float:
    """Neutral of a channel that nobody speaks of: its most usual pulse near the middle."""
    near = pulse[np.abs(pulse - 1500.0) < 50.0]
    return float(np.median(near)) if len(near) else 1500.0


def _turn_rate(choices: Mapping[str, Choice], heading: Samples, time: Floats) -> Floats:
    """Turn rate (T,) [rad/s]: reported, or from the heading."""
    if "yaw rate" in choices:
        rate = choices["yaw rate"].samples
        return _at(rate, rate.values[:, 0], time)
    order = np.argsort(heading.vehicle_time_ns, kind="stable")
    turned = np.unwrap(heading.values[order, 0])
    return np.gradient(np.interp(time, _seconds(heading)[order], turned), GRID_S)


def _speed(choices: Mapping[str, Choice], time: Floats) -> Floats | None:
    """Speed ahead (T,) [m/s]."""
    if "velocity" not in choices:
        return None
    samples = choices["velocity"].samples
    if samples.quantity is Quantity.BODY_VELOCITY:
        return _at(samples, samples.values[:, 0], time)
    yaw = choices["yaw"].samples
    c, s = (_at(yaw, f(yaw.values[:, 0]), time) for f in (np.cos, np.sin))
    north, east = (_at(samples, samples.values[:, i], time) for i in (0, 1))
    return c * north + s * east


def _ways(commands: Sequence[Floats], known: Sequence[int], speed: Floats | None) -> list[Ways]:
    """+1 or −1 of either throttle ahead, as said or as the boat went: all that may be."""
    if 0 not in known:
        return [(known[0], known[1])]
    tried: list[tuple[float, Ways]] = []
    if speed is None:
        return []
    for ways in BOTH:
        both = 0.5 * (ways[0] * commands[0] + ways[1] * commands[1])
        rows = np.isfinite(both) & np.isfinite(speed)
        found = command_response(
            np.nan_to_num(both), np.nan_to_num(speed), rows, GRID_S, MIN_MOTION_STD[Nu.U]
        )
        if found is not None and found.sign > 0:
            tried.append((found.correlation, ways))
    best = max((correlation for correlation, _ in tried), default=0.0)
    return [ways for correlation, ways in tried if correlation > best - NEAR]
