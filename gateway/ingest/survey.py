"""What is in a recording, and what cannot be found from it: all that `shadow info` shows.

Port and starboard are checked from the recording alone: do the two throttles turn the boat as they
are named? Which output is which side follows from SERVOn_FUNCTION (73 left, 74 right) or from the
names of a table's columns (left, port; right, starboard). The direction of a motor is taken from
the parameters, or else found: of the four combinations, those that drive the boat as fast as it
went. All of them must agree that it turned the other way.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from gateway.ingest.agreement import reconciled
from gateway.ingest.clock import SLEEP, ClockReport
from gateway.ingest.log import Boat, BoatSamples, Log, Statistics, boats_of, choose_boat, not_a_boat
from gateway.ingest.mapping import Actuator, OutputFunction, actuators
from gateway.ingest.parameter_changes import outputs_notice
from gateway.ingest.px4_outputs import named_outputs
from gateway.ingest.repeated import repeated_notice, repeated_spans
from gateway.ingest.sources import PRIORITY, Choice, choose, uniform_grid
from gateway.ingest.table_repair import repair_table
from gateway.samples import Quantity, Samples
from sim.diagnosis.thresholds import MIN_RATE_HZ, RATE_TOLERANCE
from sim.identification.wiring import CommandResponse, command_response
from sim.state import Floats, Nu

PORT = re.compile(r"left|port|lft|babord|backbord", re.IGNORECASE)
STARBOARD = re.compile(r"right|starboard|stbd|stb|rgt|tribord|steuerbord", re.IGNORECASE)
GRID_S = 0.2  # s, of the comparison
HALF_US = 400.0  # µs from neutral to full, as usual: a correlation asks for no more
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
    """One side's pulses as commands (T,), −1 … 1 of the usual travel; NaN without a pulse."""
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


# Slower commands or motion hide effects that act within a fraction of a second, as in a diagnosis.
FAST_HZ = (1.0 - RATE_TOLERANCE) * MIN_RATE_HZ


@dataclass(frozen=True)
class MessageSurvey:
    """How often one message came, by its receipt; where that leaps by a day it is the clock's."""

    count: int
    rate_hz: float
    longest_gap_s: float


@dataclass(frozen=True)
class SourceSurvey:
    """Where one quantity comes from, and why from there."""

    source: str
    rate_hz: float
    longest_gap_s: float
    why: str
    preference: tuple[str, ...]  # the whole order


@dataclass(frozen=True)
class BoatSurvey:
    """One boat of the recording."""

    boat: Boat
    firmware: str
    seconds: float
    sessions_s: tuple[float, ...]  # length of each boot, without leaps of a day or more
    clock: ClockReport
    unix_ahead_s: float | None  # the boat's own Unix time minus vehicle time, if it has one
    sources: Mapping[str, SourceSurvey]
    actuators: tuple[Actuator, ...]
    parameters: int
    good_for: tuple[str, ...]
    notices: tuple[str, ...]  # what looks wrong with it
    named_outputs: tuple[str, ...] = ()  # of PX4: which drives what, but not where that is


@dataclass(frozen=True)
class Survey:
    """One recording."""

    path: str
    kind: str
    seconds: float  # by receipt, gaps and backward steps of the clock left out
    statistics: Statistics
    messages: Mapping[str, MessageSurvey]
    boats: tuple[BoatSurvey, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain dicts, lists, strings and numbers: what `--json` prints."""
        return asdict(self)


def survey(log: Log, system: int | None = None) -> Survey:
    """Looks at a whole recording, and at one boat of it or at all."""
    chosen = boats_of(log) if system is None else (choose_boat(log, system),)
    receipts = {name: log.table(name).receive_time_ns for name in log.counts()}
    return Survey(
        log.path,
        log.kind,
        _duration(receipts),
        log.statistics,
        {name: _message(times) for name, times in sorted(receipts.items())},
        tuple(_boat(log, boat) for boat in chosen),
    )


def _duration(receipts: Mapping[str, np.ndarray[Any, np.dtype[np.int64]]]) -> float:
    """Sum of the time between successive receipts [s], where it is forward and less than a day."""
    steps = [_steps(times) for times in receipts.values()]
    return float(max((some[some <= SLEEP * 1e-9].sum() for some in steps), default=0.0))


def _steps(times: np.ndarray[Any, np.dtype[np.int64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    steps = (times[1:] - times[:-1]) * 1e-9
    return np.asarray(steps[steps > 0.0], np.float64)


def _message(times: np.ndarray[Any, np.dtype[np.int64]]) -> MessageSurvey:
    steps = _steps(times)
    usual = steps[steps <= SLEEP * 1e-9]
    if not len(usual):
        return MessageSurvey(len(times), 0.0, 0.0)
    # The mean, not the median: receipts come in bunches.
    count = len(times) - 1 - (len(steps) - len(usual))
    return MessageSurvey(len(times), count / float(usual.sum()), float(usual.max()))


def _boat(log: Log, boat: Boat) -> BoatSurvey:
    decoded = log.decode(boat)
    choices = choose(decoded.samples)
    repaired = repair_table(decoded, choices)
    parameters = log.parameters(boat)
    outputs = actuators(parameters)
    lengths = session_lengths(decoded)
    return BoatSurvey(
        boat,
        log.firmware(boat),
        sum(lengths),
        lengths,
        decoded.clock,
        _unix_ahead(decoded),
        {name: _source(choice, decoded) for name, choice in repaired.choices.items()},
        tuple(outputs),
        len(parameters),
        _limits(boat, choices, _ever_armed(choices)),
        (
            *swap_notices(log, choices, outputs),
            *outputs_notice(log, boat),
            *reconciled(repaired.choices).contradictions,
            *repaired.notices,
            *repeated_notice(repeated_spans(choices, decoded.sessions), decoded.sessions),
        ),
        named_outputs(parameters),
    )


def session_lengths(decoded: BoatSamples) -> tuple[float, ...]:
    """Length of each boot [s].

    Leaps are no part of it that no boat is silent for: where one voyage was appended to another,
    messages without a counter bear times of both until the clock is sure of the new boot.
    """
    times = np.sort(
        np.concatenate([np.zeros(0, np.int64), *(s.vehicle_time_ns for s in decoded.samples)])
    )
    lengths = []
    for start, end in decoded.sessions:
        inside = times[(times >= start) & (times <= end)]
        steps = np.diff(np.concatenate([[start], inside, [end]]))
        lengths.append(float(steps[steps <= SLEEP].sum()) * 1e-9)
    return tuple(lengths)


def _source(choice: Choice, decoded: BoatSamples) -> SourceSurvey:
    """`preference` names the sources of this log where they stand for others."""
    own = {(s.quantity, s.equivalent): s.source for s in reversed(decoded.samples)}
    order = tuple(own.get(key, key[1]) for key in PRIORITY[choice.name])
    return SourceSurvey(choice.source, choice.rate_hz, choice.longest_gap_s, choice.why, order)


def _unix_ahead(decoded: BoatSamples) -> float | None:
    clocks = decoded.of(Quantity.UNIX_TIME)
    if not clocks:
        return None
    return float(np.median(clocks[0].values[:, 0] - clocks[0].vehicle_time_ns * 1e-9))


def _ever_armed(choices: Mapping[str, Choice]) -> bool | None:
    """None where the log does not hold it. A log of changes alone has seen both states."""
    if "armed" not in choices:
        return None
    armed = choices["armed"]
    return bool((armed.samples.values > 0.0).any()) or armed.samples.on_change


def _limits(boat: Boat, choices: Mapping[str, Choice], ever_armed: bool | None) -> tuple[str, ...]:
    """What cannot be found from the recording, a sentence each with its reason; at least one."""
    found = [*_motion_limits(choices), *_command_limits(choices, ever_armed)]
    if not_a_boat(boat):
        found.insert(0, not_a_boat(boat))
    if "voltage" not in choices:
        found.append("no battery voltage: a sagging battery cannot be told from a weak motor")
    if "wind" not in choices:
        found.append("no measured wind: wind can only be inferred, and is easily taken for current")
    return tuple(found) or ("motion and commands are complete and fast: all effects can be told",)


def _motion_limits(choices: Mapping[str, Choice]) -> list[str]:
    found = []
    if "yaw" not in choices:
        found.append("no heading: surge cannot be told from sway, nothing can be identified")
    if "yaw rate" not in choices:
        found.append("no yaw rate: it follows from the heading alone, its noise is larger")
    moving = choices.get("velocity") or choices.get("position")
    if moving is None:
        found.append("no velocity and no position: nothing can be identified")
    elif moving.rate_hz < FAST_HZ:
        found.append(
            f"{moving.name} at {moving.rate_hz:.1f} Hz: accelerations are smoothed over about "
            f"{2.0 / max(moving.rate_hz, 0.1):.1f} s, quick manoeuvres teach little"
        )
    if "velocity" in choices and choices["velocity"].source == "VFR_HUD":
        found.append("velocity from VFR_HUD has no direction: sway and going astern are unknown")
    return found


def _command_limits(choices: Mapping[str, Choice], ever_armed: bool | None) -> list[str]:
    if "commands" not in choices:
        return ["no servo outputs: the motion can be shown, but no model be identified or compared"]
    found = []
    if ever_armed is False:
        found.append("never armed: nothing to identify")
    rate = choices["commands"].rate_hz
    if rate < FAST_HZ:
        found.append(
            f"commands at {rate:.1f} Hz: thruster lag, command delay and velocity latency cannot "
            f"be told from it ({MIN_RATE_HZ:.0f} Hz needed)"
        )
    return found
