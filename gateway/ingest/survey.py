"""What is in a recording, and what cannot be found from it: all that `shadow info` shows."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gateway.ingest.clock import ClockReport
from gateway.ingest.log import (
    Boat,
    BoatSamples,
    Log,
    Statistics,
    boats_of,
    choose_boat,
    not_a_boat,
)
from gateway.ingest.parameters import Actuator, actuators
from gateway.ingest.port_starboard import swap_notices
from gateway.ingest.sources import PRIORITY, Choice, choose
from gateway.ingest.table_repair import repair_table
from gateway.samples import Quantity

FAST_HZ = 5.0  # slower commands or motion hide effects that act within a fraction of a second


@dataclass(frozen=True)
class MessageSurvey:
    """How often one message came, by its receipt."""

    count: int
    rate_hz: float  # between gaps
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
    sessions_s: tuple[float, ...]  # length of each boot
    clock: ClockReport
    unix_ahead_s: float | None  # the boat's own Unix time minus vehicle time, if it has one
    sources: Mapping[str, SourceSurvey]
    actuators: tuple[Actuator, ...]
    parameters: int
    good_for: tuple[str, ...]
    notices: tuple[str, ...]  # what looks wrong with it


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
    """Sum of the time between successive receipts [s], where it is forward."""
    steps = [_steps(times).sum() for times in receipts.values()]
    return float(max(steps, default=0.0))


def _steps(times: np.ndarray[Any, np.dtype[np.int64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    steps = (times[1:] - times[:-1]) * 1e-9
    return np.asarray(steps[steps > 0.0], np.float64)


def _message(times: np.ndarray[Any, np.dtype[np.int64]]) -> MessageSurvey:
    steps = _steps(times)
    if not len(steps):
        return MessageSurvey(len(times), 0.0, 0.0)
    # The mean, not the median: receipts come in bunches.
    return MessageSurvey(len(times), float(len(times) - 1) / float(steps.sum()), float(steps.max()))


def _boat(log: Log, boat: Boat) -> BoatSurvey:
    decoded = log.decode(boat)
    choices = choose(decoded.samples)
    repaired = repair_table(decoded, choices)
    parameters = log.parameters(boat)
    outputs = actuators(parameters)
    lengths = tuple((end - start) * 1e-9 for start, end in decoded.sessions)
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
        (*swap_notices(log, choices, outputs), *repaired.notices),
    )


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
            f"be told from it ({FAST_HZ:.0f} Hz needed)"
        )
    return found
