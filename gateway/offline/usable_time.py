"""Which time of a trial is usable: reasons that exclude it, and what a user leaves out.

Also the notices on recordings that every result repeats: wiring, then what looks odd in them.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.parameters import THRUST_FUNCTIONS, actuators
from gateway.shadow.held_series import HeldInputs
from gateway.shadow.sensor_checks import SETTLE_S, STATUS_CONFIRMED_S
from sim.identification.wiring import wiring_notices, wiring_of
from sim.prediction.segments import usable_stretches
from sim.state import Floats, Nu
from sim.trial import Stretch, Trial
from sim.vessel import Vessel

Bools = NDArray[np.bool_]

DISARMED = "disarmed"
NO_FIX = "no 3-D fix"
EKF_ILL = "the autopilot's EKF unhealthy"
FROZEN = "a frozen sensor"
COMPASS = "a compass that jumped"
GAP = "no telemetry"
NO_COMMANDS = "no commands"
IDLE = "not under way"
SPINNING = "turning too fast for its grid"
REASONS = (DISARMED, NO_FIX, EKF_ILL, FROZEN, COMPASS, GAP, NO_COMMANDS, IDLE, SPINNING)
LEFT_OUT = "left out by --exclude"

# All chosen by looking at recordings, none measured.
FIX_3D = 3  # GPS_FIX_TYPE_3D_FIX of MAVLink
GAP_S = 2.0  # a longer silence of heading, motion or commands is a gap
IDLE_S = 10.0  # without thrust and motion for at least this long, a boat is not under way
IDLE_MPS, IDLE_RADPS = 0.1, 0.05  # slower is no motion
NEUTRAL_US = 20.0  # a pulse within this of its neutral is no thrust
MAX_TURN_RAD = 0.6  # from sample to sample; beyond, a mean over a step says little of the motion


def disarmed(held: HeldInputs, time: Floats) -> Bools:
    """Where the boat reports that it is disarmed: (T,) s -> (T,)."""
    return np.asarray(held.armed.at(time)[:, 0] == 0.0)


def no_fix(held: HeldInputs, time: Floats) -> Bools:
    """Where the receiver reports that it has no 3-D fix: (T,) s -> (T,)."""
    return np.asarray(held.fix.at(time)[:, 0] < FIX_3D)


def ekf_ill(held: HeldInputs, time: Floats) -> Bools:
    """Where the autopilot's filter says that it is ill, or was until just now: (T,) s -> (T,).

    By the rules of the live checks: one report alone is none, and the filter has to find back.
    """
    ill = np.asarray(held.estimator.at(time)[:, 0] > 0.0)
    out = np.zeros(len(time), np.bool_)
    for start, stop in usable_stretches(ill):
        if time[stop - 1] - time[start] >= STATUS_CONFIRMED_S:
            out |= (time >= time[start]) & (time <= time[stop - 1] + SETTLE_S)
    return out


def idle(time: Floats, nu: Floats, thrust: Bools) -> Bools:
    """Where there is neither thrust nor motion for a while: (T,) s, (T, 3), (T,) -> (T,)."""
    speed = np.hypot(nu[:, Nu.U], nu[:, Nu.V])
    still = ~thrust & (speed < IDLE_MPS) & (np.abs(nu[:, Nu.R]) < IDLE_RADPS)
    out = np.zeros(len(time), np.bool_)
    for start, stop in usable_stretches(still):
        if time[stop - 1] - time[start] >= IDLE_S:
            out[start:stop] = True
    return out


def spinning(nu: Floats, dt: float) -> Bools:
    """Where the heading turns too far in one step of the grid: (T, 3), s -> (T,)."""
    return np.asarray(np.abs(nu[:, Nu.R]) * dt > MAX_TURN_RAD)


def thrust_commanded(
    pwm: Floats, channels: Sequence[int], parameters: Mapping[str, float]
) -> Bools:
    """Where a motor is away from neutral: pulses (T, n) [µs] -> (T,).

    Without SERVOn_FUNCTION parameters, any channel counts as a motor with neutral at 1500 µs.
    """
    neutrals = {a.channel: a.pwm[1] for a in actuators(parameters) if a.kind in THRUST_FUNCTIONS}
    default = np.nan if neutrals else 1500.0
    neutral = np.array([neutrals.get(channel, default) for channel in channels])
    away = np.abs(pwm - neutral) > NEUTRAL_US  # NaN is not away
    return np.asarray(away.any(axis=1))


def excluded_stretches(
    time: Floats, dt: float, reasons: Mapping[str, Bools]
) -> tuple[Stretch, ...]:
    """Reason -> flags (T,) as stretches of time, in order."""
    found = [
        Stretch(float(time[start]), float(time[stop - 1]) + dt, reason)
        for reason, flags in reasons.items()
        for start, stop in usable_stretches(flags)
    ]
    return tuple(sorted(found, key=lambda stretch: stretch.start))


@dataclass(frozen=True)
class TimeSpan:
    """From when to when [s after the first sample of each trial]; None: to its end."""

    start: float | None = None
    end: float | None = None


def limit_to_span(trial: Trial, span: TimeSpan) -> Trial:
    """The same trial with only the span usable; BadInput where the span is empty."""
    start, end = span.start or 0.0, np.inf if span.end is None else span.end
    if not start < end:
        raise BadInput(f"--from {start:g} --to {end:g}: expected a span of time, from before to")
    rows = (trial.time >= start) & (trial.time < end)
    return replace(trial, usable=trial.usable & rows)


@dataclass(frozen=True)
class Exclusion:
    """From when to when [s after the first sample]; of one recording, or of all."""

    start: float
    end: float
    recording: str | None = None


def parse_exclusions(texts: Iterable[str]) -> tuple[Exclusion, ...]:
    """FROM:TO or RECORDING:FROM:TO as typed; an empty end is the recording's own."""
    return tuple(_exclusion(text) for text in texts)


def _exclusion(text: str) -> Exclusion:
    expected = "expected FROM:TO or RECORDING:FROM:TO, in seconds after its first sample"
    name, _, rest = text.rpartition(":")[0].rpartition(":")
    last = text.rpartition(":")[2]
    try:
        start, end = float(rest or 0.0), float(last or np.inf)
    except ValueError:
        raise BadInput(f"--exclude {text}: {expected}") from None
    if ":" not in text or not start < end:
        raise BadInput(f"--exclude {text}: {expected}")
    return Exclusion(start, end, name or None)


def exclude_stretches(trials: Sequence[Trial], exclusions: Sequence[Exclusion]) -> list[Trial]:
    """The trials with those stretches not usable, listed among what is excluded."""
    names = [trial.name for trial in trials]
    for one in exclusions:
        if one.recording is not None and one.recording not in names:
            raise BadInput(f"--exclude: no recording {one.recording!r}: there are {names}")
    return [_exclude(trial, exclusions) for trial in trials]


def _exclude(trial: Trial, exclusions: Sequence[Exclusion]) -> Trial:
    usable, excluded = trial.usable.copy(), list(trial.excluded)
    for one in exclusions:
        if one.recording in (None, trial.name):
            usable[(trial.time >= one.start) & (trial.time < one.end)] = False
            end = min(one.end, float(trial.time[-1]))
            excluded.append(Stretch(one.start, end, LEFT_OUT))
    return replace(trial, usable=usable, excluded=tuple(excluded))


NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


def assumed_by(vessel: Vessel) -> list[str]:
    """What was assumed for the vessel's effects to act."""
    return [f"{vessel.name}: {text}" for text in vessel.assumptions]


def notices_of(trials: Sequence[Trial], vessel: Vessel) -> tuple[str, ...]:
    """Notices on the wiring and on what the vessel's effects assume, then those of the recordings,
    like ones in one sentence.

    Notices are alike where they differ in numbers alone; the numbers shown are the first one's.
    """
    alike: dict[str, list[tuple[str, str]]] = {}
    for trial in trials:
        for notice in trial.notices:
            alike.setdefault(NUMBER.sub("", notice), []).append((trial.name, notice))
    out = [*wiring_notices(wiring_of(trials, vessel), vessel), *assumed_by(vessel)]
    for group in alike.values():
        names = list(dict.fromkeys(name for name, _ in group))
        listed = names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"
        out.append(f"{listed}: {group[0][1]}")
    return tuple(out)
