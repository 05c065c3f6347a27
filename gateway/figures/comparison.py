"""Figures of a comparison: error and missing force of each vessel, and where they are largest.

Errors lie in bins of heading, speed, turn rate, throttle and time, in the units that people read.
Of one mission sailed twice: both tracks from above, gap and lag along the first.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.figures import (
    MISSING_FORCES,
    NRMSE,
    REGIMES,
    Axis,
    Band,
    Bars,
    Dots,
    FigureData,
    Level,
    Line,
    Mark,
    Panel,
    SeriesRole,
    Strip,
)
from gateway.figures.motion import free_run_velocities, horizon_velocities, map_panel, track
from sim.comparison import Bin
from sim.comparison.compare import Comparison
from sim.comparison.independence import ERRORS, MAX_LAG, Independence
from sim.comparison.missions import MissionComparison, Passage
from sim.state import Floats
from sim.trial import Trial

SHARE = Axis("share", "%")
RMS_ERROR = Axis("rms error", "nrmse scales")
ERROR_REGIMES = ("heading", "speed", "turn_rate", "throttle", "reverse", "time")
SHOWN_SHARE = 0.95  # of independent series within the band that is drawn
FORCE_REGIMES = ("heading", "speed")


def comparison_figures(trial: Trial, comparisons: Sequence[Comparison]) -> dict[str, FigureData]:
    """All figures by name, of one trial and its vessels under one ruler."""
    figures = {} if len(comparisons) < 2 else {"vessels": vessel_errors(comparisons)}
    for one in comparisons:
        figures |= {
            f"{one.vessel} velocities": horizon_velocities(trial, one),
            f"{one.vessel} free run": free_run_velocities(trial, one),
            f"{one.vessel} track": track(trial, one),
            f"{one.vessel} shares": error_shares(one),
            f"{one.vessel} strips": error_strips(one),
            f"{one.vessel} missing force": missing_force_by_regime(one),
        }
        if one.independence is not None:
            figures[f"{one.vessel} independence"] = error_correlations(one)
    return figures


def bars_with_intervals(
    x: Floats, height: Floats, intervals: Sequence[tuple[float, float] | None], half: float
) -> tuple[Mark, Mark]:
    """Errors (n,) as bars x ± half (n,), each with its 95 % interval where there is one."""
    ends = np.array([ci95 or (h, h) for ci95, h in zip(intervals, height, strict=True)])
    return (
        Bars(x - half, x + half, height, SeriesRole.MODEL, "error of the model"),
        Dots(x, height, ends[:, 0], ends[:, 1], SeriesRole.INTERVAL, "95 % interval"),
    )


def vessel_errors(comparisons: Sequence[Comparison]) -> FigureData:
    """One bar per vessel with its interval, all of one trial, and the noise floor as a line."""
    x = np.arange(len(comparisons), dtype=float)
    height = np.array([c.nrmse for c in comparisons])
    floor = "noise floor: what a perfect model would show"
    marks: tuple[Mark, ...] = (
        *bars_with_intervals(x, height, [c.nrmse_ci95 for c in comparisons], 0.25),
        Level(comparisons[0].noise_floor_nrmse, SeriesRole.FLOOR, floor),
    )
    panel = Panel(Axis("vessel"), NRMSE, marks, names=tuple(c.vessel for c in comparisons))
    return FigureData(f"{comparisons[0].log}: error of each vessel", (panel,))


def _bins_of(comparison: Comparison, names: Sequence[str]) -> dict[str, list[Bin]]:
    """Name of a regime -> its bins in the order of its values, without empty regimes."""
    found = {
        name: sorted((b for b in comparison.where if b.by == name), key=lambda b: b.start)
        for name in names
    }
    return {name: bins for name, bins in found.items() if bins}


def _edges(bins: Sequence[Bin], name: str) -> tuple[Floats, Floats]:
    """Where bins begin and end (n,), in the unit of the axis."""
    factor = REGIMES[name].factor
    return np.array([b.start for b in bins]) * factor, np.array([b.end for b in bins]) * factor


def error_shares(comparison: Comparison, regimes: Sequence[str] = ERROR_REGIMES) -> FigureData:
    """Share of the squared error in each bin beside the bin's share of the time."""
    panels = []
    for name, bins in _bins_of(comparison, regimes).items():
        start, end = _edges(bins, name)
        error = 100.0 * np.array([b.share for b in bins])
        time = 100.0 * np.array([b.time_share for b in bins])
        marks = (
            Bars(start, end, error, SeriesRole.ERROR, "of the squared error"),
            Bars(start, end, time, SeriesRole.CONTEXT, "of the time", outline=True),
        )
        panels.append(Panel(REGIMES[name], SHARE, marks))
    worst = comparison.worst(1)
    title = f"{comparison.log}: where the error is, {comparison.vessel}"
    return FigureData(title, tuple(panels), columns=2, caption=worst[0].sentence if worst else "")


def error_strips(comparison: Comparison, regimes: Sequence[str] = ERROR_REGIMES) -> FigureData:
    """Root mean square error of u, v, r in every bin, as heat strips under one scale."""
    scales = comparison.ruler.scales
    found = _bins_of(comparison, regimes)
    sizes = {
        name: np.array([b.rmse for b in bins]).T / scales[:, None] for name, bins in found.items()
    }
    highest = max((float(size.max()) for size in sizes.values()), default=1.0)
    panels = []
    for name, bins in found.items():
        strip = Strip(*_edges(bins, name), ("u", "v", "r"), sizes[name], RMS_ERROR, highest)
        panels.append(Panel(REGIMES[name], Axis(""), (strip,)))
    title = f"{comparison.log}: size of the error, {comparison.vessel}"
    return FigureData(title, tuple(panels), columns=2)


def missing_force_by_regime(comparison: Comparison) -> FigureData:
    """X, Y, N row by row against heading and speed, over the noise of a single estimate."""
    found = _bins_of(comparison, FORCE_REGIMES)
    panels = tuple(
        Panel(REGIMES[name], axis, _force_marks(bins, name, i))
        for i, axis in enumerate(MISSING_FORCES)
        for name, bins in found.items()
    )
    title = f"{comparison.log}: missing force, {comparison.vessel}"
    return FigureData(title, panels, columns=len(found))


def _force_marks(bins: Sequence[Bin], name: str, i: int) -> tuple[Mark, ...]:
    """Mean and spread of component i in each bin over the noise of a single estimate."""
    start, end = _edges(bins, name)
    x = np.column_stack([start, end]).reshape(-1)
    noise = np.repeat([b.missing_std[i] for b in bins], 2)
    mean = np.array([b.missing[i] for b in bins])
    spread = np.array([b.missing_spread[i] for b in bins])
    return (
        Band(x, -noise, noise, SeriesRole.FLOOR, "noise of one estimate (1 σ)"),
        Level(0.0, SeriesRole.CONTEXT),
        Dots(0.5 * (start + end), mean, mean - spread, mean + spread, SeriesRole.ERROR,
             "mean and spread (1 σ)"),
    )  # fmt: skip


def error_correlations(comparison: Comparison) -> FigureData:
    """Correlation of each error with itself and with each commanded force, over the lag.

    The band holds 95 % of independent series. An error that outlasts the band is not white: the
    model lacks dynamics. After a command, both made white: a peak at a positive lag is thrust that
    comes late, one on both sides of 0 is the smoother's, one at negative lags alone is an autopilot
    that answers the error.
    """
    found = comparison.independence
    assert found is not None
    lags = np.asarray(found.step * np.arange(-MAX_LAG, MAX_LAG + 1), dtype=float)
    after = lags[MAX_LAG + 1 :]
    panels = [
        _correlation_panel("after itself", after, rho, found, f"{name}: error after itself")
        for name, rho in zip(ERRORS, found.autocorrelation, strict=True)
    ] + [
        _correlation_panel(
            "after command", lags, p.correlation, found, f"{p.error} after {p.input}"
        )
        for p in found.pairs
    ]  # fmt: skip
    title = f"{comparison.log}: do errors follow the commands? {comparison.vessel}"
    return FigureData(title, tuple(panels), columns=3, caption=found.description)


def _correlation_panel(
    what: str, lags: Floats, rho: Floats, found: Independence, title: str
) -> Panel:
    """One correlation (n,) over its lags (n,) [s], and the band of independent series."""
    level: Floats = np.full(len(lags), found.band_at(SHOWN_SHARE))
    marks = (
        Band(lags, -level, level, SeriesRole.INTERVAL, "95 % of independent series"),
        Dots(lags, rho, np.minimum(rho, 0.0), np.maximum(rho, 0.0), SeriesRole.ERROR,
             "correlation"),
    )  # fmt: skip
    return Panel(Axis(f"error {what}", "s"), Axis("correlation", "1"), marks, title)


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
