"""A recording -> trials: smoothed motion and commands on a uniform grid.

    log → boat → samples → sources → events → smoother → grid

Each boot and each stretch between long silences is a trial of its own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gateway.errors import BadInput, ShadowError, numerical_errors, shell_path
from gateway.estimation import SOURCES, FilterSettings
from gateway.estimation.events import Events
from gateway.estimation.gyro_delay import tells_delay
from gateway.estimation.smoother import SmoothedMotion
from gateway.files import recording_names
from gateway.ingest.agreement import reconciled
from gateway.ingest.log import BoatSamples, Log, choose_floating
from gateway.ingest.mapping import Origin, actuators, moment_of
from gateway.ingest.open import check_each_once, open_log
from gateway.ingest.parameter_changes import first_parameters, outputs_changes
from gateway.ingest.repeated import repeated_notice, repeated_spans
from gateway.ingest.sources import Choice, choose
from gateway.ingest.table_repair import repair_table, settings_for
from gateway.offline import usable_time
from gateway.offline.deviation import Deviation, with_deviation, without_deviation
from gateway.offline.noisy import noisy_notices
from gateway.offline.rate_bias import smooth_with_bias
from gateway.offline.usable_time import Bools, compass_jumped, frozen
from gateway.shadow import (
    HeldInputs,
    held_inputs,
    held_series,
    motion_events,
    origin_of,
    seconds,
)
from sim.state import Floats, Progress
from sim.trial import OutputsSet, Trial
from sim.vessel import Servo

SPLIT_S = 30.0  # a longer silence of heading or velocity ends a trial; chosen, not measured
SERVO_SETTINGS = ("MIN", "TRIM", "MAX", "REVERSED")  # of an output
SHORTEST_S = 5.0  # of a trial; chosen, not measured

# A trial holds the heading that the compass reported: what the filter would set aside as a slow
# error of the compass is for the sensor effects to explain. With 1.1° of it, sway at 1.6 m/s was
# 0.03 m/s off between two logs of one run.
#
# The noise of a compass is coloured: fifty headings a second taken as independent pull the yaw rate
# to and fro by 0.0025 rad/s where the gyro beside them errs by 0.0006. And rounding corners serves
# nothing that follows: velocities may change faster than they do live.
UNROUNDED = {
    name: replace(
        white,
        yaw_rad=max(white.yaw_rad, 0.01),
        yaw_rate_radps=min(white.yaw_rate_radps, 0.003),
    )
    for name, white in SOURCES.items()
}
AS_REPORTED = FilterSettings(
    heading_error_rad=1e-3,
    surge_acceleration_mps2=1.0,
    sway_acceleration_mps2=1.0,
    sources=UNROUNDED,
)


@dataclass(frozen=True)
class TrialOptions:
    """What trials are made of: whose data of a log, on which grid, and which time."""

    rate_hz: float = 10.0
    keep: tuple[str, ...] = ()  # reasons of `usable_time.REASONS` that do not exclude
    motion_only: bool = False  # a log without commands will do
    settings: FilterSettings = AS_REPORTED
    system: int | None = None  # id of the boat, where a log holds several
    mapping: str | Path | None = None  # mapping file of .csv tables; default: the one beside each
    anyway: bool = False  # take the log of a vehicle that says it is no boat
    measured_hz: float | None = None  # a first look: of each kind so many measurements are taken
    together: tuple[Path, ...] = ()  # all that are read: no two get one name

    def __post_init__(self) -> None:
        if not 0.5 <= self.rate_hz <= 200.0:
            raise BadInput(f"rate {self.rate_hz} Hz: expected 0.5 to 200")
        unknown = set(self.keep) - set(usable_time.REASONS)
        if unknown:
            raise BadInput(f"cannot keep {sorted(unknown)}: expected some of {usable_time.REASONS}")

    def with_all(self, logs: Sequence[str | Path]) -> "TrialOptions":
        """The same, where these recordings are read too."""
        return replace(self, together=tuple(dict.fromkeys((*self.together, *map(Path, logs)))))

    def name_of(self, log: str | Path) -> str:
        """What a recording is called among all that are read."""
        together = self.with_all([log]).together
        return recording_names(together)[together.index(Path(log))]

    @property
    def flags(self) -> str:
        """Of the command line, each after a space: what says whose data of a log, and how."""
        mapping = "" if self.mapping is None else f" --mapping {shell_path(self.mapping)}"
        system = "" if self.system is None else f" --system {self.system}"
        return f"{mapping}{system}{' --anyway' if self.anyway else ''}"


DEFAULT_TRIALS = TrialOptions()
NOTHING_USABLE = "nothing usable in it: "
# An hour of 50 Hz in a quarter of the time; velocities 0.01 m/s off, root mean square.
FIRST_LOOK = TrialOptions(rate_hz=2.0, measured_hz=4.0)


def load_trials(
    paths: str | Path | Sequence[str | Path],
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
) -> list[Trial]:
    """Recordings -> their trials, in order; a recording without any is bad input.

    `system` and `mapping` go over those of the options.
    """
    files = [paths] if isinstance(paths, str | Path) else list(paths)
    check_each_once(files)
    options = (options or DEFAULT_TRIALS).with_all(files)
    if system is not None:
        options = replace(options, system=system)
    if mapping is not None:
        options = replace(options, mapping=mapping)
    return [t for file in files for t in trials_of(open_log(file, options.mapping), options)]


def usable_trials(
    logs: Sequence[str | Path], options: TrialOptions, progress: Progress
) -> list[Trial]:
    """All trials of all recordings that hold usable time."""
    check_each_once(logs)
    options, out = options.with_all(logs), list[Trial]()
    for log in logs:
        progress(f"reading {Path(log).name}")
        out += [t for t in load_trials(log, None, options) if t.usable.any()]
    return out


def trials_of(log: Log, options: TrialOptions = DEFAULT_TRIALS) -> list[Trial]:
    """One opened log -> its trials."""
    with numerical_errors(log.path):
        source = source_of(log, options)
        spans = source.spans()
        name = options.name_of(log.path)
        names = [name] if len(spans) == 1 else [f"{name} #{k + 1}" for k in range(len(spans))]
        trials = [source.trial(*each, options) for each in zip(names, spans, strict=True)]
    if not trials:
        raise BadInput(f"{log.path}: no {SHORTEST_S:.0f} s of heading and velocity in one piece")
    if not options.motion_only and not any(trial.usable.any() for trial in trials):
        raise BadInput(f"{log.path}: {NOTHING_USABLE}{usable_time.excluded_summary(trials)}")
    return trials


def why_unusable(log: Log, system: int | None = None) -> str:
    """Why nothing of a log can be compared, from a quick look; empty where something can."""
    try:
        trials_of(log, replace(FIRST_LOOK, system=system, anyway=True))
    except ShadowError as error:
        return str(error).removeprefix(f"{log.path}: ").removeprefix(NOTHING_USABLE)
    return ""


def date_of(trial: Trial) -> str:
    """The day on which a trial began, in UTC: 2026-05-01; empty where its clock tells no date."""
    began = moment_of(trial.start_time_ns * 1e-9)
    return "" if began is None else began.date().isoformat()


def source_of(log: Log, options: TrialOptions) -> "TrialSource":
    """Decode a log and choose its sources; BadInput where something needed is missing."""
    boat = choose_floating(log, options.system, options.anyway)
    decoded = log.decode(boat)
    table = repair_table(decoded, choose(decoded.samples))
    choices, contradictions, deviation = reconciled(table.choices)
    _check(log.path, choices, options, decoded.notices)
    epoch_ns = decoded.sessions[0][0]
    origin = origin_of(decoded, choices)
    parameters = log.parameters(boat)
    known = options.settings
    if tells_delay(parameters):  # else as reported: the doubt that a live filter needs would leave
        known = known.with_parameters(parameters)  # a smoothed yaw rate four times as uncertain
    settings = settings_for(decoded, choices, known)
    repeats = repeated_spans(choices, decoded.sessions)
    return TrialSource(
        epoch_ns,
        decoded.sessions,
        choices,
        origin,
        without_deviation(motion_events(choices, origin, settings, epoch_ns), deviation),
        held_inputs(decoded, choices, epoch_ns),
        parameters,
        outputs_set(log, decoded, epoch_ns),
        tuple((one.vehicle_time_ns - epoch_ns) * 1e-9 for one in decoded.lane_switches),
        settings,
        (
            *table.notices,
            *([] if decoded.tabular else usable_time.told_too_seldom(choices)),
            *repeated_notice(repeats, decoded.sessions),
            *noisy_notices(choices, settings, epoch_ns),
        ),
        contradictions,
        deviation,
        tuple(((a - epoch_ns) * 1e-9, (b - epoch_ns) * 1e-9) for a, b in repeats),
    )


def outputs_set(log: Log, decoded: BoatSamples, epoch_ns: int) -> tuple[OutputsSet, ...]:
    """How outputs are set [s after `epoch_ns`]: at first, then where that changes inside a log."""
    first = OutputsSet(-np.inf, "", outputs_of(first_parameters(log, decoded.boat)))
    found = outputs_changes(log, decoded.boat)
    times = decoded.times_at(np.array([one.change.order for one in found], np.int64))
    later = seconds(times, epoch_ns).tolist() if times is not None else ()
    return (
        first,
        *(
            OutputsSet(time, str(one.change), outputs_of(one.parameters))
            for time, one in zip(later, found, strict=bool(later))
        ),
    )


def outputs_of(parameters: Mapping[str, float]) -> tuple[Servo, ...]:
    """The outputs that move the boat, as parameters have them; not those of which some lack."""
    return tuple(
        Servo(a.channel, a.pwm, a.reversed)
        for a in actuators(parameters)
        if all(f"SERVO{a.channel}_{name}" in parameters for name in SERVO_SETTINGS)
    )


def _check(
    path: str, choices: Mapping[str, Choice], options: TrialOptions, notices: Sequence[str]
) -> None:
    """One line about what is missing, with what could not be read."""
    if "yaw" not in choices:
        raise BadInput(f"{path}: no heading in it (ATTITUDE, ATT, …): cannot tell surge from sway")
    if "velocity" not in choices and "position" not in choices:
        raise BadInput(f"{path}: no velocity or position in it (LOCAL_POSITION_NED, XKF1, GPS, …)")
    if "commands" not in choices and not options.motion_only:
        missing = "no servo outputs in it (SERVO_OUTPUT_RAW, RCOU, …): no commands"
        raise BadInput(f"{path}: {'; '.join((missing, *notices))}")


@dataclass(frozen=True)
class TrialSource:
    """All that the trials of one log are cut from; times in seconds after `epoch_ns`.

    events     without what the compass deviates by, where the gyro tells that (`deviation`)
    repeats    what an earlier session holds as well
    """

    epoch_ns: int
    sessions: tuple[tuple[int, int], ...]
    choices: Mapping[str, Choice]
    origin: Origin | None
    events: Events
    held: HeldInputs
    parameters: Mapping[str, float]
    outputs_set: tuple[OutputsSet, ...]
    lane_switches: tuple[float, ...]  # of the autopilot's filter
    settings: FilterSettings
    notices: tuple[str, ...]
    contradictions: tuple[str, ...] = ()
    deviation: Deviation = ()
    repeats: tuple[tuple[float, float], ...] = ()

    def spans(self) -> list[tuple[float, float]]:
        """Stretches [s] in which heading and velocity are known without a long silence."""
        yaw, motion = self._pieces(self.choices["yaw"]), self._pieces(self._moving)
        both = [(max(a, c), min(b, d)) for a, b in yaw for c, d in motion]
        both = [(self._first_position(a, b), b) for a, b in both]
        return sorted((a, b) for a, b in both if b - a >= SHORTEST_S)

    @property
    def _moving(self) -> Choice:
        return self.choices["velocity" if "velocity" in self.choices else "position"]

    def _first_position(self, start: float, end: float) -> float:
        """Start of a stretch [s], moved to its first known position if it has one."""
        if "position" not in self.choices:
            return start
        time = seconds(self.choices["position"].samples.vehicle_time_ns, self.epoch_ns)
        inside = time[(time >= start) & (time <= end)]
        return float(inside.min()) if len(inside) else start

    def _pieces(self, choice: Choice) -> list[tuple[float, float]]:
        """First and last time [s] between long silences, boot by boot."""
        time = seconds(np.sort(choice.samples.vehicle_time_ns), self.epoch_ns)
        boots = np.array([start for start, _ in self.sessions[1:]], np.int64)
        starts = seconds(boots, self.epoch_ns)
        apart = np.diff(time) > SPLIT_S
        apart |= np.diff(np.searchsorted(starts, time, side="right")) > 0
        pieces = np.split(time, np.flatnonzero(apart) + 1)
        return [(float(piece[0]), float(piece[-1])) for piece in pieces]

    def trial(self, name: str, span: tuple[float, float], options: TrialOptions) -> Trial:
        """One stretch on its grid."""
        dt = 1.0 / options.rate_hz
        start, end = span
        grid: Floats = start + dt * np.arange(int((end - start) / dt) + 1, dtype=np.float64)
        inside = (self.events.time_s >= start) & (self.events.time_s <= end)
        events = self.events[inside]
        if options.measured_hz is not None:
            events = events.thinned(options.measured_hz)
        motion = smooth_with_bias(events, grid, self.settings)
        motion = with_deviation(motion, self.deviation)
        edges = np.append(grid, grid[-1] + dt)
        channels, pwm = self._commands(edges)
        reasons = self._reasons(motion, grid, pwm, channels) | {
            usable_time.FROZEN: frozen(events, grid),
            usable_time.COMPASS: compass_jumped(events, grid),
            usable_time.REPEATED: usable_time.within(self.repeats, grid),
        }
        reasons = {why: where for why, where in reasons.items() if why not in options.keep}
        return Trial(
            name=name,
            time=grid - start,
            eta=motion.eta,
            nu=motion.nu,
            nu_dot=motion.nu_dot,
            covariance=motion.covariance,
            channels=channels,
            pwm=pwm,
            voltage=self.held.voltage.mean(edges)[:, 0],
            wind=self.held.wind.mean(edges),
            usable=~np.logical_or.reduce(list(reasons.values())),
            excluded=usable_time.excluded_stretches(grid - start, dt, reasons),
            start_time_ns=self.epoch_ns + round(start * 1e9),
            origin_deg=self.origin,
            outputs=next(s.outputs for s in reversed(self.outputs_set) if s.start <= start),
            outputs_set=tuple(
                replace(one, start=one.start - start)
                for one in self.outputs_set
                if start < one.start < end
            ),
            sources={name: choice.source for name, choice in self.choices.items()},
            rates_hz={name: choice.rate_hz for name, choice in self.choices.items()},
            notices=(*self.contradictions, *self.notices),
            contradictions=self.contradictions,
            filtered="velocity" in self.choices and self.choices["velocity"].of_a_filter,
        )

    def _commands(self, edges: Floats) -> tuple[tuple[int, ...], Floats]:
        """Channels that ever have a pulse, and their mean over each interval, NaN if disarmed."""
        pwm = self.held.pulses.mean(edges)
        pwm[usable_time.disarmed(self.held, 0.5 * (edges[:-1] + edges[1:]))] = np.nan
        alive = np.flatnonzero(np.isfinite(pwm).any(axis=0))
        return tuple(int(i) + 1 for i in alive), pwm[:, alive]

    def _reasons(
        self,
        motion: SmoothedMotion,
        grid: Floats,
        pwm: Floats,
        channels: Sequence[int],
    ) -> dict[str, Bools]:
        """Reason -> (T,): where it excludes."""
        nowhere, dt = np.zeros(len(grid), np.bool_), float(grid[1] - grid[0])
        gap = np.asarray(~motion.known | (self._silence(grid) > usable_time.GAP_S))
        disarmed = usable_time.disarmed(self.held, grid + 0.5 * dt)
        silent = ~np.isfinite(pwm).any(axis=1) & ~disarmed
        thrust = usable_time.thrust_commanded(pwm, channels, self.parameters)
        return {
            usable_time.DISARMED: disarmed,
            usable_time.NO_FIX: usable_time.no_fix(self.held, grid),
            usable_time.EKF_ILL: usable_time.ekf_ill(self.held, grid),
            usable_time.LANE_SWITCH: usable_time.around(self.lane_switches, grid),
            usable_time.GAP: gap,
            usable_time.NO_COMMANDS: silent if "commands" in self.choices else nowhere,
            usable_time.IDLE: usable_time.idle(grid, motion.nu, thrust),
            usable_time.SPINNING: usable_time.spinning(motion.nu, dt),
        }

    def _silence(self, grid: Floats) -> Floats:
        """(T,) s: the longest silence around each moment of heading, velocity or commands."""
        silences = [
            held_series(choice.samples, self.epoch_ns).silence(grid)
            for choice in (self.choices["yaw"], self._moving)
        ]
        if len(self.held.pulses):
            silences.append(self.held.pulses.silence(grid))
        return np.asarray(np.max(silences, axis=0))
