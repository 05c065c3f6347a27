"""A recording -> trials: smoothed motion and commands on a uniform grid.

    log -> boat -> samples -> sources -> events -> smoother -> grid

Each boot and each stretch between long silences is a trial of its own.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gateway.errors import BadInput, numerical_errors
from gateway.estimation.events import Events
from gateway.estimation.settings import SOURCES, FilterSettings
from gateway.estimation.smoother import SmoothedMotion, smooth
from gateway.ingest.earth import Origin
from gateway.ingest.log import Log, choose_boat
from gateway.ingest.open import open_log
from gateway.ingest.sources import Choice, choose
from gateway.ingest.table_repair import settings_for, tidied
from gateway.offline import usable
from gateway.samples import Quantity
from gateway.shadow.inputs import Held, held, motion_events, origin_of, seconds, series
from sim.state import Floats
from sim.trial import Trial

SPLIT_S = 30.0  # a longer silence of heading or velocity ends a trial
SHORTEST_S = 5.0

# A trial holds the heading that the compass reported: what the filter would set aside as a slow
# error of the compass is for the sensor effects to explain. With 1.1° of it, sway at 1.6 m/s was
# 0.03 m/s off between two logs of one run.
#
# A compass wanders, so fifty headings a second are not fifty independent ones: taken so, they pull
# the yaw rate to and fro by 0.0025 rad/s where the gyro beside them errs by 0.0006. And nothing
# that follows is served by rounding corners: velocities may change faster than they do live.
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
    """What trials are made of."""

    rate_hz: float = 10.0
    keep: tuple[str, ...] = ()  # reasons of `usable.REASONS` that do not exclude
    motion_only: bool = False  # a log without commands will do
    settings: FilterSettings = AS_REPORTED

    def __post_init__(self) -> None:
        if not 0.5 <= self.rate_hz <= 200.0:
            raise BadInput(f"rate {self.rate_hz} Hz: expected 0.5 to 200")
        unknown = set(self.keep) - set(usable.REASONS)
        if unknown:
            raise BadInput(f"cannot keep {sorted(unknown)}: expected some of {usable.REASONS}")


def load_trials(
    paths: str | Path | Sequence[str | Path],
    system: int | None = None,
    options: TrialOptions | None = None,
    mapping: str | Path | None = None,
) -> list[Trial]:
    """Recordings -> their trials, in order; a recording without any is bad input.

    `mapping` names the mapping file of .csv tables; default: the one beside each.
    """
    files = [paths] if isinstance(paths, str | Path) else list(paths)
    return [t for file in files for t in trials_of(open_log(file, mapping), system, options)]


def usable_trials(
    logs: Sequence[str | Path],
    system: int | None,
    options: TrialOptions | None,
    mapping: str | Path | None,
    tell: Callable[[str], None],
) -> list[Trial]:
    """All trials of all recordings that hold usable time; `tell` hears what is being read."""
    out: list[Trial] = []
    for log in logs:
        tell(f"reading {Path(log).name}")
        out += [t for t in load_trials(log, system, options, mapping) if t.usable.any()]
    return out


def trials_of(
    log: Log, system: int | None = None, options: TrialOptions | None = None
) -> list[Trial]:
    """One opened log -> its trials."""
    with numerical_errors(log.path):
        return _trials_of(log, system, options or TrialOptions())


def _trials_of(log: Log, system: int | None, options: TrialOptions) -> list[Trial]:
    source = _gather(log, system, options)
    spans = _spans(source.choices, source.sessions, source.epoch_ns)
    if not spans:
        raise BadInput(f"{log.path}: no {SHORTEST_S:.0f} s of heading and velocity in one piece")
    names = _names(Path(log.path).stem, len(spans))
    trials = [_trial(name, source, span, options) for name, span in zip(names, spans, strict=True)]
    if not options.motion_only and not any(trial.usable.any() for trial in trials):
        raise BadInput(f"{log.path}: nothing usable in it: {excluded_summary(trials)}")
    return trials


def excluded_summary(trials: Sequence[Trial]) -> str:
    """What excluded how much: "disarmed 153 s, …"; empty where nothing was excluded."""
    lost: dict[str, float] = {}
    for stretch in (stretch for trial in trials for stretch in trial.excluded):
        lost[stretch.why] = lost.get(stretch.why, 0.0) + stretch.end - stretch.start
    return ", ".join(f"{why} {length:.0f} s" for why, length in lost.items())


@dataclass(frozen=True)
class _Source:
    """All that the trials of one log are cut from, on one time axis."""

    epoch_ns: int
    sessions: tuple[tuple[int, int], ...]
    choices: Mapping[str, Choice]
    origin: Origin | None
    events: Events
    held: Held
    parameters: Mapping[str, float]
    settings: FilterSettings
    notices: tuple[str, ...]


def _gather(log: Log, system: int | None, options: TrialOptions) -> _Source:
    boat = choose_boat(log, system)
    decoded = log.decode(boat)
    tidy = tidied(choose(decoded.samples), decoded.of(Quantity.ACCELERATION))
    choices = tidy.choices
    _check(log.path, choices, options)
    epoch_ns = decoded.sessions[0][0]
    origin = origin_of(decoded, choices)
    parameters = log.parameters(boat)
    settings = settings_for(choices, options.settings.told_by(parameters))
    return _Source(
        epoch_ns,
        decoded.sessions,
        choices,
        origin,
        motion_events(choices, origin, settings, epoch_ns),
        held(decoded, choices, epoch_ns),
        parameters,
        settings,
        tidy.notices,
    )


def _check(path: str, choices: Mapping[str, Choice], options: TrialOptions) -> None:
    """One line about what is missing."""
    if "yaw" not in choices:
        raise BadInput(f"{path}: no heading in it (ATTITUDE, ATT, …): cannot tell surge from sway")
    if "velocity" not in choices and "position" not in choices:
        raise BadInput(f"{path}: no velocity or position in it (LOCAL_POSITION_NED, XKF1, GPS, …)")
    if "commands" not in choices and not options.motion_only:
        raise BadInput(f"{path}: no servo outputs in it (SERVO_OUTPUT_RAW, RCOU, …): no commands")


def _spans(
    choices: Mapping[str, Choice], sessions: Sequence[tuple[int, int]], epoch_ns: int
) -> list[tuple[float, float]]:
    """Stretches [s] in which heading and velocity are known without a long silence."""
    moving = choices["velocity" if "velocity" in choices else "position"]
    yaw = _pieces(choices["yaw"], sessions, epoch_ns)
    motion = _pieces(moving, sessions, epoch_ns)
    both = [(max(a, c), min(b, d)) for a, b in yaw for c, d in motion]
    both = [(_placed_from(choices, a, b, epoch_ns), b) for a, b in both]
    return sorted((a, b) for a, b in both if b - a >= SHORTEST_S)


def _placed_from(choices: Mapping[str, Choice], start: float, end: float, epoch_ns: int) -> float:
    """Start of a stretch [s], moved to its first known position if it has one."""
    if "position" not in choices:
        return start
    time = seconds(choices["position"].samples.vehicle_time_ns, epoch_ns)
    inside = time[(time >= start) & (time <= end)]
    return float(inside.min()) if len(inside) else start


def _pieces(
    choice: Choice, sessions: Sequence[tuple[int, int]], epoch_ns: int
) -> list[tuple[float, float]]:
    """First and last time [s] between long silences, boot by boot."""
    time = seconds(np.sort(choice.samples.vehicle_time_ns), epoch_ns)
    starts = seconds(np.array([start for start, _ in sessions[1:]], np.int64), epoch_ns)
    apart = np.diff(time) > SPLIT_S
    apart |= np.diff(np.searchsorted(starts, time, side="right")) > 0
    return [(float(part[0]), float(part[-1])) for part in np.split(time, np.flatnonzero(apart) + 1)]


def _names(stem: str, count: int) -> list[str]:
    return [stem] if count == 1 else [f"{stem} #{number}" for number in range(1, count + 1)]


def _trial(name: str, source: _Source, span: tuple[float, float], options: TrialOptions) -> Trial:
    """One stretch on its grid."""
    dt = 1.0 / options.rate_hz
    start, end = span
    grid: Floats = start + dt * np.arange(int((end - start) / dt) + 1, dtype=np.float64)
    inside = (source.events.time_s >= start) & (source.events.time_s <= end)
    motion = smooth(source.events[inside], grid, source.settings)
    edges = np.append(grid, grid[-1] + dt)
    channels, pwm = _commands(source.held, edges)
    why = _reasons(source, motion, grid, pwm, channels, options)
    return Trial(
        name=name,
        time=grid - start,
        eta=motion.eta,
        nu=motion.nu,
        nu_dot=motion.nu_dot,
        covariance=motion.covariance,
        channels=channels,
        pwm=pwm,
        voltage=source.held.voltage.mean(edges)[:, 0],
        wind=source.held.wind.mean(edges),
        usable=~np.logical_or.reduce(list(why.values())),
        excluded=usable.stretches(grid - start, dt, why),
        start_time_ns=source.epoch_ns + round(start * 1e9),
        origin_deg=source.origin,
        sources={name: choice.source for name, choice in source.choices.items()},
        rates_hz={name: choice.rate_hz for name, choice in source.choices.items()},
        notices=source.notices,
    )


def _commands(held: Held, edges: Floats) -> tuple[tuple[int, ...], Floats]:
    """Channels that ever have a pulse, and their mean over each interval; none while disarmed."""
    pwm = held.pulses.mean(edges)
    pwm[usable.disarmed(held, 0.5 * (edges[:-1] + edges[1:]))] = np.nan
    alive = np.flatnonzero(np.isfinite(pwm).any(axis=0))
    return tuple(int(i) + 1 for i in alive), pwm[:, alive]


def _reasons(
    source: _Source,
    motion: SmoothedMotion,
    grid: Floats,
    pwm: Floats,
    channels: Sequence[int],
    options: TrialOptions,
) -> dict[str, usable.Bools]:
    """Reason -> (T,): where it excludes."""
    dead = np.zeros(len(grid), np.bool_)
    gap = np.asarray(~motion.known | (_silence(source, grid) > usable.GAP_S))
    why = {
        usable.DISARMED: usable.disarmed(source.held, grid + 0.5 / options.rate_hz),
        usable.NO_FIX: usable.no_fix(source.held, grid),
        usable.GAP: gap,
    }
    silent = ~np.isfinite(pwm).any(axis=1) & ~why[usable.DISARMED]
    why[usable.NO_COMMANDS] = silent if "commands" in source.choices else dead
    thrust = usable.thrust_commanded(pwm, channels, source.parameters)
    why[usable.IDLE] = usable.idle(grid, motion.nu, thrust)
    why[usable.SPINNING] = usable.spinning(motion.nu, 1.0 / options.rate_hz)
    return {reason: dead if reason in options.keep else flags for reason, flags in why.items()}


def _silence(source: _Source, grid: Floats) -> Floats:
    """(T,) s: the longest silence around each moment of heading, velocity or commands."""
    moving = source.choices["velocity" if "velocity" in source.choices else "position"]
    silences = [
        series(choice.samples, source.epoch_ns).silence(grid)
        for choice in (source.choices["yaw"], moving)
    ]
    if len(source.held.pulses):
        silences.append(source.held.pulses.silence(grid))
    return np.asarray(np.max(silences, axis=0))
