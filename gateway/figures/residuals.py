"""The error of the model over time: measured − model, and the noise that each error sits in."""

import numpy as np

from gateway.figures.figure_data import FigureData, Level, Line, Panel, Role
from gateway.figures.velocities import CHANNELS, TIME, pieces
from sim.comparison.compare import Comparison
from sim.state import Floats
from sim.trial import Trial


def residuals(trial: Trial, comparison: Comparison) -> FigureData:
    """Errors of u, v, r along the free runs that follow one another."""
    time, error = errors(trial, comparison)
    runs = f"measured − {comparison.vessel}, free for {comparison.ruler.settings.horizon:g} s"
    panels = tuple(
        Panel(
            TIME, axis,
            (Level(0.0, Role.CONTEXT), Line(time, error[:, i] * factor, Role.ERROR, runs)),
        )
        for i, axis, factor in CHANNELS
    )  # fmt: skip
    title = f"{comparison.log}: error over time, {comparison.vessel}"
    return FigureData(title, panels, shared_x=True)


def errors(trial: Trial, comparison: Comparison) -> tuple[Floats, Floats]:
    """Time (n,) and measured − model (n, 6), NaN between the runs."""
    time, model = pieces(trial, comparison.prediction)
    rows = np.rint((time - trial.time[0]) / trial.dt).astype(np.int64)
    return time, np.hstack([trial.eta, trial.nu])[rows] - model
