"""Figures of one mission sailed twice: both tracks from above, gap and lag along the first."""

import numpy as np
from numpy.typing import NDArray

from gateway.figures.figure_data import Axis, FigureData, Level, Line, Mark, Panel, SeriesRole
from gateway.figures.motion import map_panel
from sim.comparison.missions import MissionComparison, Passage

ALONG = Axis("along the boat's track", "m")
GAP = Axis("the loop to starboard", "m")
LAG = Axis("the loop later", "s")
BOAT, LOOP = "the boat", "in the loop"


def mission_tracks(found: MissionComparison) -> FigureData:
    """Both tracks from above, each from where it begins to move; parted stretches marked."""

    def line(p: Passage, role: SeriesRole, label: str) -> Line:
        return Line(p.east, p.north, role, label)

    marks: list[Mark] = [
        line(found.first, SeriesRole.MEASURED, BOAT),
        line(found.second, SeriesRole.MODEL, LOOP),
    ]
    parted = np.abs(found.gap) > found.limit
    if parted.any():
        marks.append(_parted(found, parted))
    caption = f"more than {found.limit:.1f} m apart counts as parted"
    panel = map_panel(tuple(marks), "north and east of where each begins to move")
    return FigureData(f"{found.first.name}: beside the loop", (panel,), caption=caption)


def _parted(found: MissionComparison, parted: NDArray[np.bool_]) -> Line:
    north = np.interp(found.time, found.first.time, found.first.north)
    east = np.interp(found.time, found.first.time, found.first.east)
    blank = np.where(parted, 1.0, np.nan)
    return Line(east * blank, north * blank, SeriesRole.ERROR, "parted")


def mission_gaps(found: MissionComparison) -> FigureData:
    """Gap to the side and lag in time, over the length of the boat's track."""
    limits = tuple(
        Level(side * found.limit, SeriesRole.CONTEXT, "parted beyond" if side > 0 else "")
        for side in (1.0, -1.0)
    )
    gap = Line(found.along, found.gap, SeriesRole.ERROR, "gap")
    lag = Line(found.along, found.lag, SeriesRole.ERROR, "lag")
    panels = (Panel(ALONG, GAP, (gap, *limits)), Panel(ALONG, LAG, (lag,)))
    return FigureData(f"{found.first.name}: gap and lag of the loop", panels, shared_x=True)


def mission_figures(found: MissionComparison) -> dict[str, FigureData]:
    """All figures of a mission sailed twice, by name."""
    return {
        f"{found.first.name} beside the loop": mission_tracks(found),
        f"{found.first.name} gap and lag": mission_gaps(found),
    }
