"""Port and starboard, from a recording alone: do the two throttles turn the boat as they are named?

Which output is which side follows from SERVOn_FUNCTION (73 left, 74 right) or from the names of a
table's columns (left, port; right, starboard). The direction of a motor is taken from the
parameters, or else found: of the four combinations, those that drive the boat as fast as it went.
All of them must agree that it turned the other way.
"""

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gateway.ingest.log import Log
from gateway.ingest.parameters import Actuator, OutputFunction
from gateway.ingest.source_quality import uniform_grid
from gateway.ingest.sources import Choice
from gateway.samples import Quantity, Samples
from sim.identification.wiring import CommandResponse, command_response
from sim.state import Floats, Nu

PORT = re.compile(r"left|port|lft|babord|backbord", re.IGNORECASE)
STARBOARD = re.compile(r"right|starboard|stbd|stb|rgt|tribord|steuerbord", re.IGNORECASE)
GRID_S = 0.2  # s, of the comparison
HALF_US = 400.0  # µs from neutral to full, without parameters
NEUTRAL_US, NEAR_NEUTRAL_US = 1500.0, 50.0  # where the neutral pulse is looked for
NEAR = 0.2  # of a correlation: closer than that, either direction may be true

Directions = tuple[int, int]  # +1: a higher pulse drives ahead, −1: astern
COMBINATIONS: tuple[Directions, ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))


class Throttle(NamedTuple):
    """The output channel of one side, its neutral pulse [µs] or NaN, its direction or 0."""

    channel: int
    neutral_us: float = np.nan
    direction: int = 0


def swap_notices(
    log: Log, choices: Mapping[str, Choice], actuators: Sequence[Actuator]
) -> tuple[str, ...]:
    """One sentence where the boat turns away from the side that it is steered to."""
    pair = throttle_pair(log, actuators)
    response = None if pair is None else steering_response(choices, pair)
    if pair is None or response is None or response.sign >= 0:
        return ()
    return (
        f"port and starboard commands look swapped (channels {pair[0].channel} and "
        f"{pair[1].channel}): the boat turns away from the side that it is steered to, correlation "
        f"of turn rate with port minus starboard {response.correlation:.2f}; exchange their "
        "channels in the vessel file",
    )


def throttle_pair(log: Log, actuators: Sequence[Actuator]) -> tuple[Throttle, Throttle] | None:
    """The throttle named port and the one named starboard; None: not exactly one of each."""
    left = [a for a in actuators if a.kind is OutputFunction.THROTTLE_LEFT]
    right = [a for a in actuators if a.kind is OutputFunction.THROTTLE_RIGHT]
    if len(left) == len(right) == 1:
        port, starboard = (
            Throttle(a.channel, a.pwm[1], -1 if a.reversed else 1) for a in (left[0], right[0])
        )
        return port, starboard
    names = log.channel_names()
    port_channels = [n for n, name in names.items() if PORT.search(name)]
    starboard_channels = [n for n, name in names.items() if STARBOARD.search(name)]
    if len(port_channels) == len(starboard_channels) == 1 and port_channels != starboard_channels:
        return Throttle(port_channels[0]), Throttle(starboard_channels[0])
    return None


def steering_response(
    choices: Mapping[str, Choice], pair: tuple[Throttle, Throttle]
) -> CommandResponse | None:
    """How the boat turned by the difference of its throttles; None: too little is known."""
    if "commands" not in choices or "yaw" not in choices:
        return None
    time = _grid(choices)
    if len(time) < 10:
        return None
    commands = [_command(choices["commands"].samples, throttle, time) for throttle in pair]
    r = _turn_rate(choices, time)
    speed = _speed(choices, time)
    possible = _possible_directions(commands, [throttle.direction for throttle in pair], speed)
    responses = [_turn_response(commands, directions, r) for directions in possible]
    clear = [response for response in responses if response is not None]
    if not clear or len(clear) < len(responses):
        return None
    return min(clear, key=lambda response: abs(response.correlation))


def _turn_response(
    commands: Sequence[Floats], directions: Directions, r: Floats
) -> CommandResponse | None:
    """Turn rate (T,) against port minus starboard."""
    difference = 0.5 * (directions[0] * commands[0] - directions[1] * commands[1])
    rows = np.isfinite(difference) & np.isfinite(r)
    return command_response(np.nan_to_num(difference), np.nan_to_num(r), rows, GRID_S, Nu.R)


def _grid(choices: Mapping[str, Choice]) -> Floats:
    """Moments [s] with heading and commands."""
    spans = [choices[name].samples.seconds() for name in ("yaw", "commands")]
    start, end = max(s.min() for s in spans), min(s.max() for s in spans)
    return uniform_grid(start, end, GRID_S)


def _at(samples: Samples, values: Floats, time: Floats) -> Floats:
    """Values (K,) at moments (T,)."""
    order = np.argsort(samples.vehicle_time_ns, kind="stable")
    return np.interp(time, samples.seconds()[order], values[order])


def _command(samples: Samples, throttle: Throttle, time: Floats) -> Floats:
    """One side's pulses as commands (T,) in about −1 … 1; NaN without a pulse."""
    pulse = samples.values[:, throttle.channel - 1]
    alive = np.isfinite(pulse) & (pulse > 0) & (pulse < 65535)
    if not alive.any():
        return np.full(len(time), np.nan)
    known = np.isfinite(throttle.neutral_us)
    neutral = throttle.neutral_us if known else _usual_neutral(pulse[alive])
    held = np.searchsorted(samples.seconds(), time, side="right") - 1
    command = np.where(alive, (pulse - neutral) / HALF_US, np.nan)
    return np.asarray(np.clip(command[np.maximum(held, 0)], -1.0, 1.0))


def _usual_neutral(pulse: Floats) -> float:
    """Neutral of a channel without parameters: its median pulse near the middle [µs]."""
    near = pulse[np.abs(pulse - NEUTRAL_US) < NEAR_NEUTRAL_US]
    return float(np.median(near)) if len(near) else NEUTRAL_US


def _turn_rate(choices: Mapping[str, Choice], time: Floats) -> Floats:
    """Turn rate (T,) [rad/s]: reported, or from the heading."""
    if "yaw rate" in choices:
        rate = choices["yaw rate"].samples
        return _at(rate, rate.values[:, 0], time)
    heading = choices["yaw"].samples
    order = np.argsort(heading.vehicle_time_ns, kind="stable")
    turned = np.unwrap(heading.values[order, 0])
    return np.gradient(np.interp(time, heading.seconds()[order], turned), GRID_S)


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


def _possible_directions(
    commands: Sequence[Floats], known: Sequence[int], speed: Floats | None
) -> list[Directions]:
    """The directions of both throttles, by the parameters or by how the boat went."""
    if 0 not in known:
        return [(known[0], known[1])]
    if speed is None:
        return []
    tried: list[tuple[float, Directions]] = []
    for directions in COMBINATIONS:
        both = 0.5 * (directions[0] * commands[0] + directions[1] * commands[1])
        rows = np.isfinite(both) & np.isfinite(speed)
        response = command_response(np.nan_to_num(both), np.nan_to_num(speed), rows, GRID_S, Nu.U)
        if response is not None and response.sign > 0:
            tried.append((response.correlation, directions))
    best = max((correlation for correlation, _ in tried), default=0.0)
    return [directions for correlation, directions in tried if correlation > best - NEAR]
