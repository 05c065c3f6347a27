"""Figures of an identification: measured, before and after; and the parameters with intervals."""

from collections.abc import Sequence

import numpy as np

from gateway.figures.figure_data import Axis, Dots, FigureData, Level, Panel, SeriesRole
from gateway.figures.motion import (
    MotionSeries,
    joined_runs,
    map_panel,
    measured_series,
    track_line,
    velocity_panels,
)
from sim.identification.intervals import Estimate
from sim.prediction.free_runs import Prediction
from sim.trial import Trial

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
    caption = f"models run free for {horizon:g} s at a time"
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
