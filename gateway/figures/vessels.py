"""Several vessels on one trial: their error with its interval, and the noise floor as a line."""

from collections.abc import Sequence

import numpy as np

from gateway.figures.figure_data import Axis, Bars, Dots, FigureData, Level, Mark, Panel, Role
from sim.comparison.compare import Comparison

NRMSE = Axis("nrmse (0 is perfect)")


def vessels(comparisons: Sequence[Comparison]) -> FigureData:
    """One bar per vessel; all of one trial, under one ruler."""
    x = np.arange(len(comparisons), dtype=float)
    height = np.array([c.nrmse for c in comparisons])
    interval = np.array([c.nrmse_ci95 or (c.nrmse, c.nrmse) for c in comparisons])
    floor = comparisons[0].noise_floor_nrmse
    marks: tuple[Mark, ...] = (
        Bars(x - 0.25, x + 0.25, height, Role.MODEL, "error of the model"),
        Dots(x, height, interval[:, 0], interval[:, 1], Role.INTERVAL, "95 % interval"),
        Level(floor, Role.FLOOR, "noise floor: what a perfect model would show"),
    )
    names = tuple(c.vessel for c in comparisons)
    return FigureData(
        f"{comparisons[0].log}: error of each vessel",
        (Panel(Axis("vessel"), NRMSE, marks, names=names),),
    )
