"""Motion over time and on the map: as measured, as models predict it, and as a plan has it.

A model runs freely for a horizon and starts anew from the measurement, or runs once over the trial;
the error between them is drawn too. Of a plan: sticks, motion and track; of an effect: what it
does; of an identification: measured, before and after, and the parameters with intervals.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gateway.figures import (
    EAST,
    NORTH,
    SURGE,
    TIME,
    VELOCITIES,
    YAW_RATE,
    Axis,
    ColouredPoints,
    Dots,
    FigureData,
    Lanes,
    Level,
    Line,
    Mark,
    Panel,
    SeriesRole,
)
from gateway.ingest.log_events import Happening, Happenings
from sim.comparison import along_trial
from sim.comparison.compare import Comparison
from sim.excitation import Plan, Stick
from sim.excitation.responses import EffectExample
from sim.identification.intervals import Estimate
from sim.prediction.free_runs import Prediction
from sim.state import Eta, Floats
from sim.trial import Trial

LANES = ("armed", "mode", "events")
ERROR = Axis("velocity error", "nrmse scales")
MOST_NUMBERS = 6  # of an effect, in a legend


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
    label = f"measured − {comparison.vessel}, free for {comparison.horizon}"
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


def _runs_label(comparison: Comparison) -> str:
    return f"{comparison.vessel}, free for {comparison.horizon} at a time"


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

    last = Happening(trial.start_time_ns + round(end * 1e9), "")
    modes = [
        (max(seconds(one), start), min(seconds(after), end), one.text, False)
        for one, after in pairwise((*known.modes, last))  # none of a log that names no mode
        if seconds(after) > start and seconds(one) < end
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


def plan_motion(plan: Plan) -> FigureData:
    """Throttle, steer, surge and yaw rate, one below the other."""

    def panel(axis: Axis, values: Floats, role: SeriesRole, label: str) -> Panel:
        return Panel(TIME, axis, (Line(plan.time, values * axis.factor, role, label),))

    model, sticks = (SeriesRole.MODEL, _label(plan)), (SeriesRole.CONTEXT, "sticks")
    panels = (
        panel(Axis("throttle"), plan.sticks[:, Stick.THROTTLE], *sticks),
        panel(Axis("steer"), plan.sticks[:, Stick.STEER], *sticks),
        panel(SURGE, plan.motion[:, 3], *model),
        panel(YAW_RATE, plan.motion[:, 5], *model),
    )
    return FigureData(_title(plan), panels, shared_x=True, caption=plan.manoeuvre.reveals)


def plan_track(plan: Plan, radius_m: float) -> FigureData:
    """The planned track from above, bow to the north at the start, and the circle around it."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = Line(radius_m * np.sin(angle), radius_m * np.cos(angle), SeriesRole.CONTEXT,
                  f"{radius_m:g} m: beyond, the script stops")  # fmt: skip
    path = track_line(plan.motion[:, :2] - plan.motion[0, :2], SeriesRole.MODEL, _label(plan))
    east, north = Axis("east of the start", "m"), Axis("north of the start", "m")
    caption = f"at most {plan.reach:.0f} m from the start; wind and current come on top"
    panel = Panel(east, north, (circle, path), equal=True)
    return FigureData(_title(plan), (panel,), caption=caption)


def _title(plan: Plan) -> str:
    return f"{plan.manoeuvre.name}, {plan.seconds:.0f} s, {plan.vessel.name}"


def _label(plan: Plan) -> str:
    return f"{plan.vessel.name}, predicted"


def effect_example_figure(example: EffectExample, looks_like: str = "") -> FigureData:
    """u, v, r of the same run of a small boat, plain and with the effect.

    Ahead, a turn to either side, full ahead, astern, coast, slowly ahead.
    """
    label = f"with {effect_with_values(example)}"
    panels = velocity_panels([
        MotionSeries(example.time, example.plain, SeriesRole.CONTEXT, "without it"),
        MotionSeries(example.time, example.changed, SeriesRole.MODEL, label),
    ])  # fmt: skip
    title = f"{example.effect}: what it does"
    return FigureData(title, panels, shared_x=True, caption=looks_like)


def effect_with_values(example: EffectExample) -> str:
    """The effect with its numbers: `NAME (PARAMETER 0.8)`; of a table the first ones."""
    each = [f"{name} {value:.3g}" for name, value in example.values.items()]
    more = ["…"] if len(each) > MOST_NUMBERS else []
    return f"{example.effect} ({', '.join([*each[:MOST_NUMBERS], *more])})"


CHANGE = Axis("against the vessel file before", "%")
LONGEST_WHISKER = 3.0  # times the largest change, at least 30 %; chosen for readability


def identification_figures(
    trial: Trial, before: Prediction, after: Prediction, horizon: float
) -> dict[str, FigureData]:
    """Velocities and tracks of one recording, models running freely for `horizon` seconds."""
    measured = measured_series(trial)
    models = [
        MotionSeries(*joined_runs(trial, before), SeriesRole.CONTEXT, "before"),
        MotionSeries(*joined_runs(trial, after), SeriesRole.MODEL, "after"),
    ]
    boat = track_line(measured.motion, measured.role, measured.label)
    maps = tuple(
        map_panel((track_line(m.motion, m.role, m.label), boat), m.label.capitalize())
        for m in models
    )
    caption = f"models run free for {round(horizon, 1):g} s at a time"
    return {
        "velocities": FigureData(
            f"{trial.name}: velocities", velocity_panels([*models, measured]), shared_x=True,
            caption=caption,
        ),
        "track": FigureData(f"{trial.name}: track", maps, columns=2, caption=caption),
    }  # fmt: skip


def parameter_changes(vessel: str, estimates: Sequence[Estimate]) -> FigureData:
    """Each number with its 95 % interval, in per cent of what it was."""
    before = np.array([e.before for e in estimates])
    size = np.array([abs(e.before) or abs(e.value) or 1.0 for e in estimates])
    value, low, high = (
        100.0 * (np.array(numbers) - before) / size
        for numbers in (
            [e.value for e in estimates],
            [e.ci95[0] for e in estimates],
            [e.ci95[1] for e in estimates],
        )
    )
    reach = LONGEST_WHISKER * max(float(np.abs(value).max(initial=0.0)), 10.0)
    dots = Dots(
        np.arange(len(estimates), dtype=float), value, np.clip(low, -reach, value),
        np.clip(high, value, reach), SeriesRole.MODEL, "after, with its 95 % interval",
    )  # fmt: skip
    identifiable = all(e.identifiable for e in estimates)
    label = "parameter" if identifiable else "parameter (?: these data do not tell it)"
    marks = (Level(0.0, SeriesRole.CONTEXT, "before"), dots)
    panel = Panel(Axis(label), CHANGE, marks, names=tuple(map(_name, estimates)))
    return FigureData(f"{vessel}: parameters", (panel,))


def _name(e: Estimate) -> str:
    lines = [e.name if e.identifiable else f"{e.name} ?", *([e.trial] if e.trial else [])]
    return "\n".join(lines).replace(".", ".\n")
