"""Pictures of an identification: measured, before and after; and the parameters."""

from collections.abc import Sequence

import numpy as np

from gateway.figures.figure_data import Axis, Dots, FigureData, Level, Line, Panel, Role
from gateway.figures.track import EAST, NORTH
from gateway.figures.velocities import CHANNELS, TIME, pieces
from sim.identification.intervals import Estimate
from sim.prediction.free_runs import Prediction
from sim.state import Eta, Floats
from sim.trial import Trial

CHANGE = Axis("against the vessel file before", "%")
WIDEST = 3.0  # times the largest change: whiskers end there


def album(
    trial: Trial, before: Prediction, after: Prediction, horizon: float
) -> dict[str, FigureData]:
    """One recording -> name of a picture -> what it shows; the model runs freely for `horizon`."""
    label = f"free for {horizon:g} s at a time"
    return {
        "velocities": velocities(trial, before, after, label),
        "track": track(trial, before, after, label),
    }


def velocities(trial: Trial, before: Prediction, after: Prediction, runs: str) -> FigureData:
    """u, v, r: measured, and the model before and after."""
    measured = _measured(trial)
    models = _models(trial, before, after)
    panels = [
        Panel(
            TIME,
            axis,
            (
                *(Line(t, m[:, i] * factor, role, name) for t, m, role, name in models),
                Line(trial.time, measured[:, i] * factor, Role.MEASURED, "measured"),
            ),
        )
        for i, axis, factor in CHANNELS
    ]
    return FigureData(
        f"{trial.name}: velocities", tuple(panels), shared_x=True, says=f"models run {runs}"
    )


def track(trial: Trial, before: Prediction, after: Prediction, runs: str) -> FigureData:
    """Two maps side by side, north up: before and after, each with what was measured."""
    measured = _measured(trial)
    boat = Line(measured[:, Eta.EAST], measured[:, Eta.NORTH], Role.MEASURED, "measured")
    panels = tuple(
        Panel(
            EAST, NORTH,
            (Line(m[:, Eta.EAST], m[:, Eta.NORTH], role, name), boat),
            name.capitalize(), equal=True,
        )
        for _, m, role, name in _models(trial, before, after)
    )  # fmt: skip
    return FigureData(f"{trial.name}: track", panels, columns=2, says=f"models run {runs}")


def parameters(vessel: str, estimates: Sequence[Estimate]) -> FigureData:
    """Each number with its 95 % interval, in per cent of what it was."""
    size = np.array([abs(e.before) or abs(e.value) or 1.0 for e in estimates])
    value, low, high = (
        100.0 * (np.array(numbers) - [e.before for e in estimates]) / size
        for numbers in (
            [e.value for e in estimates],
            [e.ci95[0] for e in estimates],
            [e.ci95[1] for e in estimates],
        )
    )
    reach = WIDEST * max(float(np.abs(value).max(initial=0.0)), 10.0)
    shown = Dots(
        np.arange(len(estimates), dtype=float), value, np.clip(low, -reach, value),
        np.clip(high, value, reach), Role.MODEL, "after, with its 95 % interval",
    )  # fmt: skip
    names = tuple(_name(e) for e in estimates)
    told = all(e.identifiable for e in estimates)
    panel = Panel(
        Axis("parameter" if told else "parameter (?: these data do not tell it)"), CHANGE,
        (Level(0.0, Role.CONTEXT, "before"), shown), names=names,
    )  # fmt: skip
    return FigureData(f"{vessel}: parameters", (panel,))


def _name(e: Estimate) -> str:
    lines = [e.name if e.identifiable else f"{e.name} ?", *([e.trial] if e.trial else [])]
    return "\n".join(lines).replace(".", ".\n")


def _measured(trial: Trial) -> Floats:
    return np.where(trial.usable[:, None], np.hstack([trial.eta, trial.nu]), np.nan)


def _models(
    trial: Trial, before: Prediction, after: Prediction
) -> list[tuple[Floats, Floats, Role, str]]:
    """Time, motion, role and label of both."""
    return [
        (*pieces(trial, before), Role.CONTEXT, "before"),
        (*pieces(trial, after), Role.MODEL, "after"),
    ]
