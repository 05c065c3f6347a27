"""Velocities: measured against the model, running freely for a horizon, or over the whole trial.

Measured, the model as it was, and the model as it is now, in one picture.
"""

from dataclasses import replace

import numpy as np

from gateway.figures.error_against import DEGREES
from gateway.figures.figure_data import Axis, FigureData, Line, Panel, Role
from sim.comparison.compare import Comparison
from sim.prediction.free_runs import Prediction
from sim.state import Floats
from sim.trial import Trial

TIME = Axis("time", "s")
CHANNELS = (
    (3, Axis("surge u", "m/s"), 1.0),
    (4, Axis("sway v", "m/s"), 1.0),
    (5, Axis("yaw rate r", "°/s"), DEGREES),
)


def horizon_runs(trial: Trial, comparison: Comparison) -> FigureData:
    """u, v, r measured, and the model started anew from the measurement again and again."""
    time, model = pieces(trial, comparison.prediction)
    runs = f"{comparison.vessel}, free for {comparison.ruler.settings.horizon:g} s at a time"
    return _figure(f"{comparison.log}: velocities, {comparison.vessel}", trial, time, model, runs)


def free_run(trial: Trial, comparison: Comparison) -> FigureData:
    """u, v, r measured, and the model left alone from the start."""
    run = comparison.free_run
    time = trial.time[run.start : run.start + len(run.model)]
    label = f"{comparison.vessel}, left alone" + (" (diverges)" if run.diverged else "")
    title = f"{comparison.log}: free run, {comparison.vessel}"
    return _figure(title, trial, time, run.model, label)


def _figure(title: str, trial: Trial, time: Floats, model: Floats, label: str) -> FigureData:
    measured = np.where(trial.usable[:, None], np.hstack([trial.eta, trial.nu]), np.nan)
    panels = [
        Panel(
            TIME,
            axis,
            (
                Line(trial.time, measured[:, i] * factor, Role.MEASURED, "measured"),
                Line(time, model[:, i] * factor, Role.MODEL, label),
            ),
        )
        for i, axis, factor in CHANNELS
    ]
    return FigureData(title, tuple(panels), shared_x=True)


def pieces(trial: Trial, prediction: Prediction) -> tuple[Floats, Floats]:
    """Free runs that follow one another without overlap: time (n,), motion (n, 6), NaN between."""
    time: list[Floats] = []
    motion: list[Floats] = []
    free = -1
    for row, steps, run in zip(prediction.rows, prediction.steps, prediction.model, strict=True):
        if row < free:
            continue
        free = int(row + steps)
        time += [trial.time[row : free + 1], trial.time[free : free + 1]]
        motion += [run[: steps + 1], np.full((1, 6), np.nan)]
    return np.concatenate(time), np.concatenate(motion)


def overlay(before: FigureData, now: FigureData) -> FigureData:
    """Two pictures of the same panels, each with a measured and a model line."""
    panels = tuple(
        replace(new, marks=(*_as_context(old.marks), *new.marks))
        for old, new in zip(before.panels, now.panels, strict=True)
    )
    return replace(now, panels=panels)


def _as_context(marks: tuple[object, ...]) -> tuple[Line, ...]:
    return tuple(
        replace(mark, role=Role.CONTEXT, label="as given")
        for mark in marks
        if isinstance(mark, Line) and mark.role is Role.MODEL
    )
