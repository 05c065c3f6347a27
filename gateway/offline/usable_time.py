"""Which time of a trial is usable: reasons that exclude it, and what a user leaves out.

One reason are sensors of the recording that contradict each other: no model may be judged there.

    frozen    the same value to the last bit for `FROZEN_S`, and meanwhile another source moved:
              heading against the integral of the gyro, gyro against the heading, velocity against
              the position, position against the integral of the velocity
    compass   the rule of the live checks (`gateway.shadow.sensor_checks`), and `SETTLE_S` after it;
              one that never comes back is believed once it has settled

Live, a value that stands still is enough. Afterwards the whole stretch is known, and a value that
rightly stands still (a table without noise on a straight leg) contradicts nothing and is kept.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.estimation import MeasurementKind
from gateway.estimation.events import Events
from gateway.ingest.mapping import FIX_3D, STATUS_CONFIRMED_S, THRUST_FUNCTIONS, actuators
from gateway.ingest.sources import Choice
from gateway.shadow import HeldInputs
from gateway.shadow.sensor_checks import (
    CONFIRMED_S,
    FROZEN_COUNT,
    FROZEN_S,
    JUMP_HELD_S,
    MAX_YAW_GAP_S,
    SETTLE_S,
    TURNED_RAD,
    SensorFault,
    SensorMemory,
)
from sim.diagnosis.thresholds import MIN_RATE_HZ
from sim.model import Model
from sim.near_names import did_you_mean
from sim.prediction import vessel_commands
from sim.prediction.segments import usable_stretches
from sim.state import Floats, Nu
from sim.trial import Stretch, Trial
from sim.vessel import Vessel

Bools = NDArray[np.bool_]

DISARMED = "disarmed"
NO_FIX = "no 3-D fix"
EKF_ILL = "the autopilot's EKF unhealthy"
LANE_SWITCH = "a switch of the autopilot's EKF"
FROZEN = "a frozen sensor"
COMPASS = "a compass that jumped"
REPEATED = "there twice"
GAP = "no telemetry"
NO_COMMANDS = "no commands"
IDLE = "not under way"
SPINNING = "turning too fast for its grid"
REASONS = (
    DISARMED,
    NO_FIX,
    EKF_ILL,
    LANE_SWITCH,
    FROZEN,
    COMPASS,
    REPEATED,
    GAP,
    NO_COMMANDS,
    IDLE,
    SPINNING,
)
LEFT_OUT = "left out by --exclude"

# All chosen by looking at recordings, none measured.
GAP_S = 2.0  # a longer silence of heading, motion or commands is a gap
IDLE_S = 10.0  # without thrust and motion for at least this long, a boat is not under way
IDLE_MPS, IDLE_RADPS = 0.1, 0.05  # slower is no motion
NEUTRAL_US = 20.0  # a pulse within this of its neutral is no thrust
MAX_TURN_RAD = 0.6  # from sample to sample; beyond, a mean over a step says little of the motion


def disarmed(held: HeldInputs, time: Floats) -> Bools:
    """Where the boat reports that it is disarmed: (T,) s -> (T,)."""
    return np.asarray(held.armed.at(time)[:, 0] == 0.0)


def no_fix(held: HeldInputs, time: Floats) -> Bools:
    """Where no receiver has a 3-D fix: (T,) s -> (T,).

    By the rule of the live checks: an EKF that tells of itself and never had a fix goes without (by
    motion capture, a DVL), and says itself when that fails.
    """
    fixes = held.fix.time[held.fix.values[:, 0] >= FIX_3D]
    had = time >= (fixes.min() if len(fixes) else np.inf)
    unknown = ~np.isfinite(held.estimator.at(time)[:, 0])
    return np.asarray((held.fix.at(time)[:, 0] < FIX_3D) & (had | unknown))


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


def around(moments: Sequence[float], time: Floats) -> Bools:
    """Where a step of the autopilot's estimate is near: moments [s], (T,) s -> (T,)."""
    near = [np.abs(time - moment) <= SETTLE_S for moment in moments]
    return np.logical_or.reduce(near) if near else np.zeros(len(time), np.bool_)


def within(spans: Sequence[tuple[float, float]], time: Floats) -> Bools:
    """Spans [s], (T,) s -> (T,): which moments lie in one of them."""
    inside = [(time >= start) & (time <= end) for start, end in spans]
    return np.logical_or.reduce(inside) if inside else np.zeros(len(time), np.bool_)


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


NEUTRAL = 0.02  # of full command: no more is none


def runs_without_thrust(trials: Sequence[Trial], boat: Vessel) -> bool:
    """Whether no thruster of the vessel was commanded in any usable time."""
    model = Model.of(boat)
    count = len(boat.thrusters)
    commands = (vessel_commands(model, t)[t.usable, :count] for t in trials)
    return not any(bool((np.abs(c) > NEUTRAL).any()) for c in commands)


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


def excluded_summary(trials: Sequence[Trial]) -> str:
    """What excluded how much: "disarmed 153 s, …"; empty where nothing was excluded. What excluded
    less than half a second is not told beside the rest.
    """
    lost: dict[str, float] = {}
    for stretch in (stretch for trial in trials for stretch in trial.excluded):
        lost[stretch.why] = lost.get(stretch.why, 0.0) + stretch.end - stretch.start
    told = {why: length for why, length in lost.items() if round(length)} or lost
    return ", ".join(f"{why} {length:.0f} s" for why, length in told.items())


# A voyage whose outputs were thinned: its own vessel errs by 2.0 floors at 1 Hz, 1.25 at 2 Hz, as
# much as noise at 4 Hz. Asked for is what lags need, a little more.
SELDOM_HZ = 1.8


def told_too_seldom(choices: Mapping[str, Choice]) -> list[str]:
    """That outputs are told so seldom that nobody knows what the motors did between; a table may
    hold them until they change.
    """
    hz = choices["commands"].rate_hz if "commands" in choices else 0.0
    if not 0.0 < hz < SELDOM_HZ:
        return []
    return [
        f"outputs are told at {hz:.2g} Hz: what the motors did between is not known, and errors "
        f"that look like an effect may be that ({MIN_RATE_HZ:g} Hz are enough)"
    ]


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
            meant = did_you_mean(one.recording, names)
            raise BadInput(f"--exclude: no recording {one.recording!r}: {meant}there are {names}")
    return [_exclude(trial, exclusions) for trial in trials]


def _exclude(trial: Trial, exclusions: Sequence[Exclusion]) -> Trial:
    usable, excluded = trial.usable.copy(), list(trial.excluded)
    for one in exclusions:
        if one.recording in (None, trial.name):
            usable[(trial.time >= one.start) & (trial.time < one.end)] = False
            end = min(one.end, float(trial.time[-1]))
            if one.start < end:  # else the recording is over before it begins
                excluded.append(Stretch(one.start, end, LEFT_OUT))
    return replace(trial, usable=usable, excluded=tuple(excluded))


# All chosen, not measured: what two sources may be apart, at once and with time.
APART_M, APART_MPS = 3.0, 0.1  # a receiver wanders, an integral of velocities drifts
APART_RADPS = 0.02  # a gyro whose bias nobody took away
MAX_RADPS, MAX_MPS = 1.0, 10.0  # no more of a step counts: a jump is no motion
MAX_STEP_S = 2.0  # between two values of a source; a longer silence ends a stretch


class Track(NamedTuple):
    """One source in order of the boat's clock: time (K,) [s], values (K, n), those sent (K, n)."""

    time: Floats
    values: Floats
    sent: Floats

    def at(self, time: Floats) -> Floats:
        """(T,) s -> (T, n), on a line between its values."""
        columns = [np.interp(time, self.time, column) for column in self.values.T]
        return np.stack(columns, axis=1)

    def integral(self) -> "Track":
        """The integral of the values over time; a silence adds nothing."""
        step = np.diff(self.time)[:, None]
        step = np.where(step <= MAX_STEP_S, step, 0.0)
        mean = 0.5 * (self.values[1:] + self.values[:-1])
        start = np.zeros((1, self.values.shape[1]))
        sums = np.concatenate([start, np.cumsum(step * mean, axis=0)])
        return Track(self.time, sums, self.sent)

    def still(self) -> list[slice]:
        """Stretches in which it stands still to the last bit, without a silence."""
        same = (np.diff(self.sent, axis=0) == 0.0).all(axis=1)
        same &= np.diff(self.time) <= MAX_STEP_S
        found = [slice(start, stop + 1) for start, stop in usable_stretches(same)]
        return [
            part
            for part in found
            if part.stop - part.start > FROZEN_COUNT
            and self.time[part.stop - 1] - self.time[part.start] >= FROZEN_S
        ]


class Tolerance(NamedTuple):
    """What two sources may be apart [rad or m], that with time [1/s], and the fastest motion."""

    least: float
    drift: float
    fastest: float


def frozen(events: Events, time: Floats) -> Bools:
    """Where a source stood still though another one moved: measurements, (T,) s -> (T,)."""
    heading, turn, velocity, position = _tracks(events)
    out = np.zeros(len(time), np.bool_)
    turned, moved = turn.integral(), velocity.integral()
    angle = Tolerance(TURNED_RAD, APART_RADPS, MAX_RADPS)
    place = Tolerance(APART_M, APART_MPS, MAX_MPS)
    for source, rate, other, tolerance in (
        (heading, False, turned, angle),
        (turn, True, heading, angle),
        (velocity, True, position, place),
        (position, False, moved, place),
    ):
        for part in source.still() if len(other.time) > 1 else ():
            if _contradicted(source, part, other, rate, tolerance):
                start, end = source.time[part.start], source.time[part.stop - 1]
                out |= (time >= start) & (time <= end + SETTLE_S)
    return out


def _contradicted(
    source: Track, part: slice, other: Track, rate: bool, tolerance: Tolerance
) -> bool:
    """Did the other source move otherwise than one that stands still says?"""
    time = source.time[part]
    gone = np.diff(other.at(time), axis=0)
    if rate:
        gone -= np.diff(time)[:, None] * 0.5 * (source.values[part][1:] + source.values[part][:-1])
        for pause in other.still():  # there it is the other one that may be frozen
            start, end = other.time[pause.start], other.time[min(pause.stop, len(other.time) - 1)]
            gone[(time[1:] > start) & (time[:-1] < end)] = 0.0
    most, steps = tolerance.fastest * np.diff(time), np.linalg.norm(gone, axis=1)
    gone *= np.divide(most, steps, out=np.ones_like(steps), where=steps > most)[:, None]
    apart = np.linalg.norm(np.cumsum(gone, axis=0), axis=1)
    return bool((apart > tolerance.least + tolerance.drift * (time[1:] - time[0])).any())


def _tracks(events: Events) -> tuple[Track, Track, Track, Track]:
    """Heading without jumps at ±π, turn rate, velocity over ground (N, E), position (N, E)."""
    heading, turn = heading_and_turn(events)
    velocity = _track(events, MeasurementKind.VELOCITY, 2)
    body = _track(events, MeasurementKind.BODY_VELOCITY, 2)
    if len(body.time) and len(heading.time):
        psi = heading.at(body.time)[:, 0]
        u, v = body.values.T
        north, east = u * np.cos(psi) - v * np.sin(psi), u * np.sin(psi) + v * np.cos(psi)
        velocity = body._replace(values=np.stack([north, east], axis=1))
    return heading, turn, velocity, _track(events, MeasurementKind.POSITION, 2)


def heading_and_turn(events: Events) -> tuple[Track, Track]:
    """Heading without jumps at ±π [rad], turn rate [rad/s]."""
    heading = _track(events, MeasurementKind.YAW, 1)
    heading = heading._replace(values=np.unwrap(heading.values, axis=0))
    return heading, _track(events, MeasurementKind.YAW_RATE, 1)


def _track(events: Events, kind: MeasurementKind, width: int) -> Track:
    rows = np.flatnonzero((events.kind == int(kind)) & np.isfinite(events.z).all(axis=1))
    rows = rows[np.argsort(events.time_s[rows], kind="stable")]
    values = events.z[rows, :width]
    return Track(events.time_s[rows], values, values)


def compass_jumped(events: Events, time: Floats) -> Bools:
    """Where the heading had jumped though the gyro saw no such turn: (T,) s -> (T,).

    Until it is back. One that stays is believed after `JUMP_HELD_S`; nothing happens to it then:
    here, where that is known, it is believed as soon as the autopilot's filter has settled.
    """
    unknown = np.full(len(events), np.nan)
    _, bits = SensorMemory().after(events, (unknown, unknown, np.zeros(len(events)), unknown))
    out = np.zeros(len(time), np.bool_)
    for start, stop in usable_stretches((bits & int(SensorFault.COMPASS)) > 0):
        begin, end = events.time_s[start] - CONFIRMED_S, events.time_s[stop - 1]
        stays = end - begin >= JUMP_HELD_S - 2.0 * MAX_YAW_GAP_S
        end = (begin + CONFIRMED_S if stays else end) + SETTLE_S
        out |= (time >= begin) & (time <= end)
    return out
