"""Stretches of time that the user leaves out: FROM:TO, or RECORDING:FROM:TO for one of several.

Which stretches of a trial can be used, and why the others cannot.

What looks wrong with recordings, and with their wiring: a sentence each, said once for all.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.parameters import OutputFunction, actuators
from gateway.shadow.inputs import Held
from sim.identification.wiring import wiring_notices, wiring_of
from sim.state import Floats, Nu
from sim.trial import Stretch, Trial
from sim.vessel import Vessel

WHY = "left out by --exclude"
EXPECTED = "expected FROM:TO or RECORDING:FROM:TO, in seconds after its first sample"


@dataclass(frozen=True)
class Exclusion:
    """From when to when [s after the first sample]; of one recording, or of all."""

    start: float
    end: float
    recording: str | None = None


def parse_exclusions(texts: Iterable[str]) -> tuple[Exclusion, ...]:
    """What a command line says; an empty end is the recording's own."""
    return tuple(_exclusion(text) for text in texts)


def _exclusion(text: str) -> Exclusion:
    name, _, rest = text.rpartition(":")[0].rpartition(":")
    last = text.rpartition(":")[2]
    try:
        start, end = float(rest or 0.0), float(last or np.inf)
    except ValueError:
        raise BadInput(f"--exclude {text}: {EXPECTED}") from None
    if ":" not in text or not start < end:
        raise BadInput(f"--exclude {text}: {EXPECTED}")
    return Exclusion(start, end, name or None)


def without(trials: Sequence[Trial], exclusions: Sequence[Exclusion]) -> list[Trial]:
    """The trials with those stretches not usable, and told among what is excluded."""
    names = [trial.name for trial in trials]
    for one in exclusions:
        if one.recording is not None and one.recording not in names:
            raise BadInput(f"--exclude: no recording {one.recording!r}: there are {names}")
    return [_without(trial, exclusions) for trial in trials]


def _without(trial: Trial, exclusions: Sequence[Exclusion]) -> Trial:
    usable, told = trial.usable.copy(), list(trial.excluded)
    for one in exclusions:
        if one.recording in (None, trial.name):
            usable[(trial.time >= one.start) & (trial.time < one.end)] = False
            told.append(Stretch(one.start, min(one.end, float(trial.time[-1])), WHY))
    return replace(trial, usable=usable, excluded=tuple(told))


Bools = NDArray[np.bool_]

DISARMED = "disarmed"
NO_FIX = "no 3-D fix"
GAP = "no telemetry"
NO_COMMANDS = "no commands"
IDLE = "not under way"
SPINNING = "turning too fast for its grid"
REASONS = (DISARMED, NO_FIX, GAP, NO_COMMANDS, IDLE, SPINNING)

FIX_3D = 3
GAP_S = 2.0
IDLE_S = 10.0  # at least so long without thrust and motion
SLOW_MPS, SLOW_RADPS = 0.1, 0.05
THRUST_US = 20.0  # from neutral
TURNED = 0.6  # rad from sample to sample, beyond which means over a step tell little of it
PUSHES = (
    OutputFunction.THROTTLE,
    OutputFunction.THROTTLE_LEFT,
    OutputFunction.THROTTLE_RIGHT,
    OutputFunction.MOTOR,
)


def disarmed(held: Held, time: Floats) -> Bools:
    """(T,) s -> (T,): the boat says that it is disarmed."""
    return np.asarray(held.armed.at(time)[:, 0] == 0.0)


def no_fix(held: Held, time: Floats) -> Bools:
    """(T,) s -> (T,): the receiver says that it has no 3-D fix."""
    return np.asarray(held.fix.at(time)[:, 0] < FIX_3D)


def idle(time: Floats, nu: Floats, thrust: Bools) -> Bools:
    """(T,) s, (T, 3), (T,) -> (T,): neither thrust nor motion for a while."""
    speed = np.hypot(nu[:, Nu.U], nu[:, Nu.V])
    still = ~thrust & (speed < SLOW_MPS) & (np.abs(nu[:, Nu.R]) < SLOW_RADPS)
    found = np.zeros(len(time), np.bool_)
    for start, end in runs(still):
        if time[end - 1] - time[start] >= IDLE_S:
            found[start:end] = True
    return found


def spinning(nu: Floats, dt: float) -> Bools:
    """(T, 3) -> (T,): the heading turns so far in one step that steps cannot follow."""
    return np.asarray(np.abs(nu[:, Nu.R]) * dt > TURNED)


def thrust_commanded(
    pwm: Floats, channels: Sequence[int], parameters: Mapping[str, float]
) -> Bools:
    """Pulses (T, n) [µs] -> (T,): a motor is away from neutral; without functions, any channel."""
    motors = {a.channel: a.pwm[1] for a in actuators(parameters) if a.kind in PUSHES}
    neutral = np.array([motors.get(channel, np.nan if motors else 1500.0) for channel in channels])
    away = np.abs(pwm - neutral) > THRUST_US  # NaN is not away
    return np.asarray(away.any(axis=1))


def runs(flags: Bools) -> list[tuple[int, int]]:
    """(T,) -> first index and index after the last of each run of True."""
    steps = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def stretches(time: Floats, dt: float, why: Mapping[str, Bools]) -> tuple[Stretch, ...]:
    """Reason -> flags (T,) as stretches of time, in order."""
    found = [
        Stretch(float(time[start]), float(time[end - 1]) + dt, reason)
        for reason, flags in why.items()
        for start, end in runs(flags)
    ]
    return tuple(sorted(found, key=lambda stretch: stretch.start))


NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def notices_of(trials: Sequence[Trial], vessel: Vessel) -> tuple[str, ...]:
    """First the wiring, which comes before everything else; then recording by recording."""
    wiring = wiring_notices(wiring_of(trials, vessel), vessel)
    alike: dict[str, list[tuple[str, str]]] = {}
    for trial in trials:
        for notice in trial.notices:
            alike.setdefault(NUMBER.sub("", notice), []).append((trial.name, notice))
    return (*wiring, *(_together(told) for told in alike.values()))


def _together(told: Sequence[tuple[str, str]]) -> str:
    """One sentence with the names of those that it is about; numbers are the first one's."""
    names = list(dict.fromkeys(name for name, _ in told))
    listed = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
    return f"{listed}: {told[0][1]}"
