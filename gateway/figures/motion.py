"""Motion over time and on the map: as measured, as models predict it, and the error between them.

A model runs freely for a horizon and starts anew from the measurement, or runs once over the trial.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gateway.figures.figure_data import (
    Axis,
    ColouredPoints,
    FigureData,
    Lanes,
    Level,
    Line,
    Mark,
    Panel,
    SeriesRole,
)
from gateway.figures.style import EAST, NORTH, TIME, VELOCITIES
from gateway.ingest.happenings import Happening, Happenings
from sim.comparison.compare import Comparison
from sim.comparison.where import along_trial
from sim.prediction.free_runs import Prediction
from sim.state import Eta, Floats
from sim.trial import Trial

LANES = ("armed", "mode", "events")
ERROR = Axis("velocity error", "nrmse scales")


class MotionSeries(NamedTuple):
    """One motion: time (n,) [s], η and ν (n, 6) or ν alone (n, 3), NaN where it is not known."""

    time: Floats
    motion: Floats
    role: SeriesRole
    label: str


def velocity_panels(series: Sequence[MotionSeries]) -> tuple[Panel, ...]:
    """Panels of u, v, r over time, all motions in each."""
    return tuple(
        Panel(
            TIME, axis,
            tuple(Line(s.time, s.motion[:, i] * axis.factor, s.role, s.label) for s in series),
        )
        for i, axis in zip((-3, -2, -1), VELOCITIES, strict=True)
    )  # fmt: skip


def track_line(motion: Floats, role: SeriesRole, label: str = "") -> Line:
    """Motion (n, 2 or more), north and east first -> its track from above."""
    return Line(motion[:, Eta.EAST], motion[:, Eta.NORTH], role, label)


def map_panel(marks: tuple[Mark, ...], title: str) -> Panel:
    """A map in metres, north up."""
    return Panel(EAST, NORTH, marks, title, equal=True)


def measured_series(trial: Trial) -> MotionSeries:
    """The measured motion; NaN where it is not usable."""
    motion = np.where(trial.usable[:, None], np.hstack([trial.eta, trial.nu]), np.nan)
    return MotionSeries(trial.time, motion, SeriesRole.MEASURED, "measured")


def measured_velocities(trial: Trial) -> FigureData:
    """u, v, r as measured, before anything is compared."""
    panels = velocity_panels([measured_series(trial)])
    return FigureData(f"{trial.name}: velocities", panels, shared_x=True)


def horizon_velocities(trial: Trial, comparison: Comparison) -> FigureData:
    """u, v, r measured, and the model started anew from the measurement again and again."""
    model = MotionSeries(
        *joined_runs(trial, comparison.prediction), SeriesRole.MODEL, _runs_label(comparison)
    )
    panels = velocity_panels([measured_series(trial), model])
    return FigureData(f"{comparison.log}: velocities, {comparison.vessel}", panels, shared_x=True)


def free_run_velocities(trial: Trial, comparison: Comparison) -> FigureData:
    """u, v, r measured, and one run of the model over the whole trial."""
    run = comparison.free_run
    time = trial.time[run.start : run.start + len(run.model)]
    label = f"{comparison.vessel}, left alone" + (" (diverges)" if run.diverged else "")
    model = MotionSeries(time, run.model, SeriesRole.MODEL, label)
    panels = velocity_panels([measured_series(trial), model])
    return FigureData(f"{comparison.log}: free run, {comparison.vessel}", panels, shared_x=True)


def residuals(trial: Trial, comparison: Comparison) -> FigureData:
    """Measured − model of u, v, r along the free runs that follow one another."""
    time, model = joined_runs(trial, comparison.prediction)
    rows = np.rint((time - trial.time[0]) / trial.dt).astype(np.int64)
    error = np.hstack([trial.eta, trial.nu])[rows] - model
    label = f"measured − {comparison.vessel}, free for {_horizon(comparison)}"
    panels = tuple(
        replace(panel, marks=(Level(0.0, SeriesRole.CONTEXT), *panel.marks))
        for panel in velocity_panels([MotionSeries(time, error, SeriesRole.ERROR, label)])
    )
    title = f"{comparison.log}: error over time, {comparison.vessel}"
    return FigureData(title, panels, shared_x=True)


def track(trial: Trial, comparison: Comparison) -> FigureData:
    """Measured against the model from above, and beside it the error coloured along the track."""
    _, model = joined_runs(trial, comparison.prediction)
    measured = measured_series(trial).motion
    error = along_trial(comparison.prediction, comparison.ruler.scales, len(trial))
    known = np.flatnonzero(np.isfinite(error))
    places = (
        track_line(measured, SeriesRole.MEASURED, "measured"),
        track_line(model, SeriesRole.MODEL, _runs_label(comparison)),
    )
    east, north = trial.eta[known, Eta.EAST], trial.eta[known, Eta.NORTH]
    errors = (
        track_line(measured, SeriesRole.CONTEXT),
        ColouredPoints(east, north, error[known], ERROR),
    )
    panels = (map_panel(places, "Track"), map_panel(errors, "Where the model is wrong"))
    return FigureData(f"{comparison.log}: track, {comparison.vessel}", panels, columns=2)


def _horizon(comparison: Comparison) -> str:
    return f"{comparison.ruler.settings.horizon:g} s"


def _runs_label(comparison: Comparison) -> str:
    return f"{comparison.vessel}, free for {_horizon(comparison)} at a time"


def joined_runs(trial: Trial, prediction: Prediction) -> tuple[Floats, Floats]:
    """Free runs that follow one another without overlap: time (n,), motion (n, 6), NaN between."""
    time: list[Floats] = []
    motion: list[Floats] = []
    end = -1
    for row, steps, run in zip(prediction.rows, prediction.steps, prediction.model, strict=True):
        if row < end:
            continue
        end = int(row + steps)
        time += [trial.time[row : end + 1], trial.time[end : end + 1]]
        motion += [run[: steps + 1], np.full((1, 6), np.nan)]
    return np.concatenate(time), np.concatenate(motion)


def free_runs_on_rows(trial: Trial, prediction: Prediction) -> Floats:
    """Free runs that follow one another (T, 6), NaN where there is none."""
    out: Floats = np.full((len(trial), 6), np.nan)
    time, motion = joined_runs(trial, prediction)
    known = np.isfinite(motion).all(axis=1)
    out[np.rint((time[known] - trial.time[0]) / trial.dt).astype(np.int64)] = motion[known]
    return out


def commands_over_time(trial: Trial) -> FigureData:
    """Pulses of every channel, one below the other; nothing where the boat was disarmed."""
    panels = tuple(
        Panel(TIME, Axis(f"output {channel}", "µs"),
              (Line(trial.time, trial.pwm[:, i], SeriesRole.CONTEXT, ""),))
        for i, channel in enumerate(trial.channels)
        if np.nanstd(trial.pwm[:, i]) > 0.0
    )  # fmt: skip
    return FigureData(f"{trial.name}: commands", panels, shared_x=True)


def lanes_over_time(trial: Trial, known: Happenings, disarmed: str) -> FigureData:
    """Armed, mode and events of a trial's time as lanes; `disarmed`: why such time is excluded."""
    start, end = float(trial.time[0]), float(trial.time[-1]) + trial.dt
    off = [(s.start, s.end) for s in trial.excluded if s.why == disarmed]
    edges = [start, *(edge for pair in sorted(off) for edge in pair), end]
    armed = [(a, b, "armed", False) for a, b in zip(edges[::2], edges[1::2], strict=True) if a < b]

    def seconds(one: Happening) -> float:
        return (one.time_ns - trial.start_time_ns) * 1e-9

    ends = [*(seconds(one) for one in known.modes[1:]), end]
    modes = [
        (max(seconds(one), start), min(until, end), one.text, False)
        for one, until in zip(known.modes, ends, strict=True)
        if until > start and seconds(one) < end
    ]
    events = [(t, t, e.text, e.bad) for e in known.events if start <= (t := seconds(e)) <= end]
    rows = [(k, *one) for k, lane in enumerate((armed, modes, events)) for one in lane]
    columns = list(zip(*rows, strict=True)) or [(), (), (), (), ()]
    row, begun, until, texts, bad = columns
    lanes = Lanes(LANES, np.array(begun, float), np.array(until, float), np.array(row, np.int64),
                  texts, bad)  # fmt: skip
    return FigureData(f"{trial.name}: mode and events", (Panel(TIME, Axis(""), (lanes,)),))


def with_earlier_model(earlier: FigureData, now: FigureData, label: str = "as given") -> FigureData:
    """A figure of velocities with the model's lines of another one, of the vessel as given."""

    def models(panel: Panel) -> list[Line]:
        return [
            replace(mark, role=SeriesRole.CONTEXT, label=label)
            for mark in panel.marks
            if isinstance(mark, Line) and mark.role is SeriesRole.MODEL
        ]

    panels = tuple(
        replace(new, marks=(*models(old), *new.marks))
        for old, new in zip(earlier.panels, now.panels, strict=True)
    )
    return replace(now, panels=panels)
