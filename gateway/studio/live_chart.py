"""Bokeh figures of live boats: a chart from above, strips of velocities and missing force."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
from bokeh.models import Arrow, ColumnDataSource, OpenHead, ScaleBar
from bokeh.plotting import figure as new_figure

from gateway.figures import EAST, MISSING_FORCES, NORTH, VELOCITIES, Axis, SeriesRole, Theme
from gateway.figures.bokeh_draw import style_figure
from gateway.monitor import TRUTH, Message, VesselStatus
from gateway.studio.live_history import RESIDUAL, WINDOW_S, WatchedBoat
from gateway.studio.page import fill_source
from sim.state import Floats

SERIES = (("measured", SeriesRole.MEASURED, "solid"), ("shadow", SeriesRole.SHADOW, "solid"),
          ("reference", SeriesRole.CONTEXT, "dotted"),
          (TRUTH, SeriesRole.MODEL, "dashed"))  # fmt: skip
HULLS = tuple(series for series in SERIES if series[0] != "reference")
HULL = np.array(  # outline of a boat of 2 m: ahead, to starboard [m]
    [[1.0, 0.0], [0.3, 0.45], [-1.0, 0.4], [-1.0, -0.4], [0.3, -0.45]]
)
SMALLEST_M = 40.0  # that the chart shows
FADED = 0.25  # opacity of a boat that is not heard
AGES = 5  # shades of a track
SIGNIFICANT = 2.0  # standard deviations: a missing force below that is not drawn
NOISE = tuple(f"{name}_{end}" for end in ("low", "high") for name in "XYN")
MOST_ROWS = int(WINDOW_S * 12)  # of a strip: some more than the history has


class Chart:
    """Tracks, hulls and missing forces from above."""

    def __init__(self, theme: Theme) -> None:
        self.figure = new_figure(
            height=430, sizing_mode="stretch_width", match_aspect=True, x_axis_label=EAST.text,
            y_axis_label=NORTH.text, tools="pan,wheel_zoom,reset", toolbar_location="right",
        )  # fmt: skip
        style_figure(self.figure, theme)
        self._tracks = {topic: _source("xs", "ys", "alpha") for topic, _, _ in HULLS}
        self._hulls = {topic: _source("xs", "ys", "alpha") for topic, _, _ in HULLS}
        for topic, role, _ in HULLS:
            colour = theme.colour(role)
            self.figure.multi_line("xs", "ys", source=self._tracks[topic], line_color=colour,
                                   line_width=2, line_alpha="alpha")  # fmt: skip
            self.figure.patches("xs", "ys", source=self._hulls[topic], fill_color=colour,
                                fill_alpha="alpha", line_color=colour, line_alpha="alpha",
                                line_width=2, legend_label=topic)  # fmt: skip
        self._forces = _source("x0", "y0", "x1", "y1")
        colour = theme.colour(SeriesRole.ERROR)
        self.figure.add_layout(Arrow(
            source=self._forces, x_start="x0", y_start="y0", x_end="x1", y_end="y1",
            line_color=colour, line_width=3, end=OpenHead(size=12, line_color=colour),
        ))  # fmt: skip
        self._corners = _source("x", "y")  # of what is to be seen
        seen = self.figure.scatter("x", "y", source=self._corners, alpha=0.0)
        for axis in (self.figure.x_range, self.figure.y_range):
            axis.renderers, axis.range_padding = [seen], 0.0
        self._names = _source("x", "y", "name")
        self.figure.text("x", "y", "name", source=self._names, text_color=theme.ink, x_offset=10,
                         text_font_size="12px")  # fmt: skip
        _legend_above(self.figure, theme)
        self.figure.add_layout(ScaleBar(
            range=self.figure.x_range, unit="m", location="bottom_right", border_line_color=None,
            background_fill_alpha=0.0, bar_line_color=theme.ink, bar_line_width=2,
            label_text_color=theme.ink, title="",
        ))  # fmt: skip

    def show(
        self, boats: tuple[WatchedBoat, ...], followed: str | None = None, across_m: float = 0.0
    ) -> None:
        """All boats as they are now; the chart shows so much around one of them, or all tracks."""
        fill_source(self._corners, _corners(boats, followed, across_m))
        for topic, _, _ in HULLS:
            fill_source(
                self._tracks[topic],
                (piece for boat in boats
                 for piece in _shaded(*boat.tracks.get(topic, ([], [])), strength(boat, topic))),
            )  # fmt: skip
            hulls = ((boat, boat.placed(topic)) for boat in boats)
            fill_source(
                self._hulls[topic], ((*_hull(m), strength(boat, topic)) for boat, m in hulls if m)
            )
        _legend_of_truth(self.figure, any(boat.placed(TRUTH) for boat in boats))
        fill_source(self._forces, (arrow for boat in boats if (arrow := _arrow(boat))))
        motions = ((boat.status, boat.status.motion()) for boat in boats)
        fill_source(
            self._names, ((m["east_m"], m["north_m"], _name(status)) for status, m in motions if m)
        )


def _corners(
    boats: tuple[WatchedBoat, ...], followed: str | None, across_m: float
) -> list[tuple[float, float]]:
    """Two corners [m] of a square around the boat that is followed, else around all tracks."""
    motions = {boat.status.name: m for boat in boats if (m := boat.status.motion())}
    half, places = 0.5 * across_m, list[tuple[float, float]]()
    if across_m > 0.0 and followed in motions:
        places = [(motions[followed]["east_m"], motions[followed]["north_m"])]
    else:
        half = 0.0
        places += [(m["east_m"], m["north_m"]) for m in motions.values()]
        for boat in boats:
            for track in boat.tracks.values():
                places += zip(*track, strict=True)
    if not places:
        return []
    low, high = np.min(places, axis=0) - half, np.max(places, axis=0) + half
    more = 0.5 * np.maximum(SMALLEST_M - (high - low), 0.1 * (high - low)) * (half == 0.0)
    return [tuple((low - more).tolist()), tuple((high + more).tolist())]


def strength(boat: WatchedBoat, topic: str) -> float:
    """Opacity of a boat or its shadow: one that is not heard any more fades at its last place."""
    lost = boat.status.silent_s is not None
    lost |= topic == "measured" and boat.status.link_silent_s is not None
    return FADED if lost else 1.0


def _name(status: VesselStatus) -> str:
    """The name, and behind that of a boat that is not heard that it is so."""
    if status.silent_s is None:
        return f"{status.name}{': link silent, was here' if status.link_silent_s else ''}"
    return f"{status.name}: {'silent' if status.alive else 'gone'}, was here"


class Strips:
    """u, v, r and the missing force over the last minute, streamed."""

    def __init__(self, theme: Theme) -> None:
        self._sources = {topic: _source("t", *"uvr") for topic, _, _ in SERIES}
        self._sources[RESIDUAL] = _source("t", *"XYN", *NOISE)
        self._latest: dict[str, float] = {}  # topic -> time of the last row
        self.velocities = [
            self._figure(axis, theme, name) for name, axis in zip("uvr", VELOCITIES, strict=True)
        ]
        time = self.velocities[0].x_range
        time.follow, time.follow_interval = "end", WINDOW_S * 1000.0
        time.range_padding = 0.0
        self.forces = [
            self._figure(axis, theme, name)
            for name, axis in zip("XYN", MISSING_FORCES, strict=True)
        ]
        for fig in (*self.velocities[1:], *self.forces):
            fig.x_range = time
        _legend_above(self.velocities[0], theme)

    def _figure(self, axis: Axis, theme: Theme, name: str) -> Any:
        """The strip of one velocity of all motions, or of one missing force within its noise."""
        fig = new_figure(
            height=150, sizing_mode="stretch_width", y_axis_label=axis.text,
            x_axis_type="datetime", tools="pan,wheel_zoom,reset", toolbar_location=None,
            html_attributes={"role": "group", "aria-label": f"plot of {axis.label} over time"},
        )  # fmt: skip
        style_figure(fig, theme)
        if name in "XYN":
            colour, source = theme.colour(SeriesRole.ERROR), self._sources[RESIDUAL]
            fig.varea("t", f"{name}_low", f"{name}_high", source=source, fill_alpha=0.25,
                      fill_color=theme.colour(SeriesRole.CONTEXT))  # fmt: skip
            fig.line("t", name, source=source, line_color=colour, line_width=1.8)
            return fig
        for topic, role, dash in SERIES:
            fig.line("t", name, source=self._sources[topic], line_color=theme.colour(role),
                     line_width=1.8, line_dash=dash,
                     **({"legend_label": topic} if name == "u" else {}))  # fmt: skip
        return fig

    def clear(self) -> None:
        """Another boat is shown from now on, or none."""
        if not self._latest:
            return
        self._latest.clear()
        for source in self._sources.values():
            source.data = {name: [] for name in source.column_names}

    def show(self, boat: WatchedBoat) -> None:
        """Draw the rows that came since the last call."""
        _legend_of_truth(self.velocities[0], TRUTH in boat.rows)
        for topic, source in self._sources.items():
            rows = boat.rows_since(topic, self._latest.get(topic, 0.0))
            if len(rows):
                self._latest[topic] = float(rows[-1, 0])
                columns = _with_noise(rows) if topic == RESIDUAL else rows
                times = 1000.0 * rows[:, 0]
                values = dict(zip(source.column_names, (times, *columns.T[1:]), strict=True))
                source.stream(values, rollover=MOST_ROWS)


def _with_noise(rows: Floats) -> Floats:
    """Rows (n, 7) of time, forces and their std -> (n, 10): time, forces, noise below and above."""
    noise = SIGNIFICANT * rows[:, 4:]
    return np.hstack([rows[:, :4], -noise, noise])


def _source(*columns: str) -> Any:
    return ColumnDataSource({name: [] for name in columns})


def _legend_above(fig: Any, theme: Theme) -> None:
    """The legend where it covers no line."""
    fig.add_layout(fig.legend[0], "above")
    legend = fig.legend
    legend.orientation, legend.location = "horizontal", "left"
    legend.background_fill_alpha, legend.label_text_color = 0.0, theme.ink
    legend.border_line_color, legend.margin, legend.padding = None, 2, 0


def _legend_of_truth(fig: Any, there: bool) -> None:
    """Only a boat in the loop has a truth: the legend of others does not name it."""
    for item in fig.legend[0].items:
        if item.label.value == TRUTH and item.visible is not there:
            item.visible = there


def _shaded(
    east: list[float], north: list[float], strongest: float
) -> list[tuple[list[float], list[float], float]]:
    """A track in pieces with their opacity, the older the fainter."""
    ends = [len(east) * k // AGES for k in range(AGES + 1)]
    return [
        (east[max(a - 1, 0) : b], north[max(a - 1, 0) : b], strongest * (k + 1) / AGES)
        for k, (a, b) in enumerate(pairwise(ends)) if b > a
    ]  # fmt: skip


def _hull(m: Message) -> tuple[list[float], list[float]]:
    """The outline of a boat where it is and as it points: east, north [m]."""
    c, s = math.cos(m["yaw_rad"]), math.sin(m["yaw_rad"])
    north = m["north_m"] + HULL[:, 0] * c - HULL[:, 1] * s
    east = m["east_m"] + HULL[:, 0] * s + HULL[:, 1] * c
    return east.tolist(), north.tolist()


def _arrow(boat: WatchedBoat) -> tuple[float, float, float, float] | None:
    """The missing force from the boat on, its length logarithmic; None where it is not significant,
    or not of now.

    East and north of both ends [m].
    """
    m, f = boat.status.motion(), boat.status.message("residual")
    silent = boat.status.silent_s is not None or boat.status.link_silent_s is not None
    if m is None or f is None or silent:
        return None
    X, Y = f["missing_surge_n"], f["missing_sway_n"]
    size = math.hypot(X, Y)
    if size <= SIGNIFICANT * math.hypot(f["missing_surge_n_std"], f["missing_sway_n_std"]):
        return None
    length = 4.0 * math.log1p(size / 5.0) / size
    c, s = math.cos(m["yaw_rad"]), math.sin(m["yaw_rad"])
    return (m["east_m"], m["north_m"], m["east_m"] + length * (X * s + Y * c),
            m["north_m"] + length * (X * c - Y * s))  # fmt: skip
