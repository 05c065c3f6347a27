"""The ladder as far as it has been climbed: the error on unseen time after each step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gateway.pictures.figure_data import Axis, Bars, Dots, FigureData, Level, Mark, Panel, Role

ERROR = Axis("error on unseen time, nrmse (0 is perfect)")


@dataclass(frozen=True)
class Step:
    """One step: what was done, the error after it, and its 95 % interval where there is one."""

    name: str
    error: float
    ci95: tuple[float, float] | None


def steps(title: str, climbed: Sequence[Step], floor: float) -> FigureData:
    """One bar per step and the noise floor as a line."""
    x = np.arange(len(climbed), dtype=float)
    height = np.array([step.error for step in climbed])
    interval = np.array([step.ci95 or (step.error, step.error) for step in climbed])
    marks: tuple[Mark, ...] = (
        Bars(x - 0.3, x + 0.3, height, Role.MODEL, "error of the model"),
        Dots(x, height, interval[:, 0], interval[:, 1], Role.INTERVAL, "95 % interval"),
        Level(floor, Role.FLOOR, "noise floor: a perfect model would show this"),
    )
    names = tuple(step.name for step in climbed)
    return FigureData(title, (Panel(Axis("step"), ERROR, marks, names=names),))


def name_of(effects: Sequence[str], base: str) -> str:
    """What was done on a rung, in words."""
    if effects:
        return f"+ {effects[-1].replace('_', ' ')}"
    return "as given" if base == "plain" else "base re-fitted"
