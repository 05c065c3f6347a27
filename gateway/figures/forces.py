"""The missing force against heading and speed, with its spread and what noise alone would show."""

import numpy as np

from gateway.figures.error_against import SHOWN, bins_of, edges_of
from gateway.figures.figure_data import Axis, Band, Dots, FigureData, Level, Mark, Panel, Role
from sim.comparison.compare import Comparison
from sim.comparison.where import Bin

FORCES = (Axis("missing surge X", "N"), Axis("missing sway Y", "N"), Axis("missing yaw N", "N m"))
BY = ("heading", "speed")


def missing_force(comparison: Comparison, by: tuple[str, ...] = BY) -> FigureData:
    """X, Y, N row by row against each variable."""
    found = {name: bins for name in by if (bins := bins_of(comparison, name))}
    panels = tuple(
        Panel(SHOWN[name][0], axis, _marks(bins, name, i))
        for i, axis in enumerate(FORCES)
        for name, bins in found.items()
    )
    title = f"{comparison.log}: missing force, {comparison.vessel}"
    return FigureData(title, panels, columns=len(found))


def _marks(bins: list[Bin], by: str, i: int) -> tuple[Mark, ...]:
    """Mean and spread in each bin over the noise of a single estimate."""
    start, end = edges_of(bins, by)
    x = np.column_stack([start, end]).reshape(-1)
    noise = np.repeat([b.missing_std[i] for b in bins], 2)
    mean = np.array([b.missing[i] for b in bins])
    spread = np.array([b.missing_spread[i] for b in bins])
    return (
        Band(x, -noise, noise, Role.FLOOR, "noise of one estimate (1 σ)"),
        Level(0.0, Role.CONTEXT),
        Dots(0.5 * (start + end), mean, mean - spread, mean + spread, Role.ERROR,
             "mean and spread (1 σ)"),
    )  # fmt: skip
