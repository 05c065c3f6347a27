"""Bins of a comparison in the units that people read: degrees, per cent.

The error against heading, speed, turn rate, throttle, time: shares as bars, size as strips.
"""

import numpy as np

from gateway.figures.figure_data import Axis, Bars, FigureData, Panel, Role, Strip
from sim.comparison.compare import Comparison
from sim.comparison.where import Bin
from sim.state import Floats

DEGREES = 180.0 / np.pi
SHOWN = {  # name of the regime -> axis and how much of its unit makes one SI unit
    "heading": (Axis("heading", "°"), DEGREES),
    "speed": (Axis("speed over ground", "m/s"), 1.0),
    "turn_rate": (Axis("turn rate", "°/s"), DEGREES),
    "drift_angle": (Axis("drift angle", "°"), DEGREES),
    "throttle": (Axis("mean throttle", "%"), 100.0),
    "reverse": (Axis("hardest reverse", "%"), 100.0),
    "voltage": (Axis("battery", "V"), 1.0),
    "time": (Axis("time", "s"), 1.0),
    "north": (Axis("north", "m"), 1.0),
    "east": (Axis("east", "m"), 1.0),
}


def bins_of(comparison: Comparison, by: str) -> list[Bin]:
    """The bins of one regime, in the order of its values."""
    return sorted((b for b in comparison.where if b.by == by), key=lambda b: b.start)


def edges_of(bins: list[Bin], by: str) -> tuple[Floats, Floats]:
    """Where bins begin and end (n,), in the unit shown."""
    factor = SHOWN[by][1]
    return np.array([b.start for b in bins]) * factor, np.array([b.end for b in bins]) * factor


SHARE = Axis("share", "%")
SIZE = Axis("rms error", "nrmse scales")
BY = ("heading", "speed", "turn_rate", "throttle", "reverse", "time")
ROWS = ("u", "v", "r")


def shares(comparison: Comparison, by: tuple[str, ...] = BY) -> FigureData:
    """Share of the squared error beside the share of the time: where bars rise above, it is bad."""
    panels = []
    for name in by:
        bins = bins_of(comparison, name)
        if not bins:
            continue
        start, end = edges_of(bins, name)
        error = 100.0 * np.array([b.share for b in bins])
        time = 100.0 * np.array([b.time_share for b in bins])
        marks = (
            Bars(start, end, error, Role.ERROR, "of the squared error"),
            Bars(start, end, time, Role.CONTEXT, "of the time", outline=True),
        )
        panels.append(Panel(SHOWN[name][0], SHARE, marks))
    worst = comparison.worst(1)
    says = worst[0].says if worst else ""
    title = f"{comparison.log}: where the error is, {comparison.vessel}"
    return FigureData(title, tuple(panels), columns=2, says=says)


def strips(comparison: Comparison, by: tuple[str, ...] = BY) -> FigureData:
    """Root mean square error of u, v, r in every bin, as heat strips."""
    scales = comparison.ruler.scales
    found = {name: bins for name in by if (bins := bins_of(comparison, name))}
    sizes = {
        name: np.array([b.rmse for b in bins]).T / scales[:, None] for name, bins in found.items()
    }
    highest = max((float(size.max()) for size in sizes.values()), default=1.0)
    panels = [
        Panel(
            SHOWN[name][0],
            Axis(""),
            (Strip(*edges_of(bins, name), ROWS, sizes[name], SIZE, highest),),
        )
        for name, bins in found.items()
    ]
    title = f"{comparison.log}: size of the error, {comparison.vessel}"
    return FigureData(title, tuple(panels), columns=2)
