"""Figure data drawn by Bokeh, for the screen: zoomed, hovered over, and filled anew in place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import (
    BoxSelectTool,
    ColumnDataSource,
    FixedTicker,
    HoverTool,
    Legend,
    LegendItem,
    Range1d,
)
from bokeh.plotting import figure as new_figure

from gateway.figures.bokeh_marks import Drawing, add, fill
from gateway.figures.figure_data import Bars, FigureData, Line, Mark, Panel, Strip
from gateway.figures.style import CHOSEN, LIGHT, Look
from gateway.figures.track import EAST
from gateway.figures.velocities import TIME

HEIGHT, TIME_HEIGHT, STRIP_HEIGHT, MAP_HEIGHT, NAMES_HEIGHT = 230, 175, 130, 430, 320
NARROWEST = 310  # px, of a panel beside another
LEGEND_ROW = 24  # px
LEGEND_LETTERS = 45  # that fit side by side on a phone
COMPASS = {45 * k: name for k, name in enumerate(("N", "NE", "E", "SE", "S", "SW", "W", "NW", "N"))}


@dataclass
class Stage:
    """What the pictures of one page share: the look, the time axis, and what is pointed at."""

    look: Look = LIGHT
    time: Any = None  # Range1d of every time axis, made by the first
    spans: Any = field(default_factory=lambda: ColumnDataSource({"x0": [], "x1": []}))
    spots: Any = field(default_factory=lambda: ColumnDataSource({"x": [], "y": []}))
    on_brush: Callable[[float, float], None] | None = None

    def time_range(self, start: float, end: float) -> Any:
        """One range for all; it bounds what can be panned to."""
        if self.time is None:
            self.time = Range1d(start, end, bounds=(start, end), min_interval=1.0)
        return self.time


class Picture:
    """A picture on screen; `show` puts other data of the same shape into it."""

    def __init__(self, data: FigureData, stage: Stage | None = None) -> None:
        self._stage = stage or Stage()
        self._shape = _shape(data)
        self._drawings: list[tuple[Drawing, Mark]] = []
        self.figures = [self._panel(panel, i == 0) for i, panel in enumerate(data.panels)]
        self.layout = _layout(self.figures, data.columns)

    def show(self, data: FigureData) -> bool:
        """Fill with other data; False where it is of another shape and has to be drawn anew."""
        if _shape(data) != self._shape:
            return False
        marks = [mark for panel in data.panels for mark in panel.marks]
        self._drawings = [(d, m) for (d, _), m in zip(self._drawings, marks, strict=True)]
        for drawing, mark in self._drawings:
            fill(mark, drawing)
        return True

    def look_at(self, start: float, end: float) -> None:
        """Lines over time with as many points as that window deserves."""
        for drawing, mark in self._drawings:
            if isinstance(mark, Line) and drawing.over_time:
                fill(mark, drawing, (start, end))

    def _panel(self, panel: Panel, first: bool) -> Any:
        look, over_time = self._stage.look, panel.x == TIME
        options: dict[str, Any] = {"x_range": self._time_of(panel)} if over_time else {}
        if panel.equal:
            options["match_aspect"] = True
        fig = new_figure(
            height=_height(panel), sizing_mode="stretch_width", title=panel.title or None,
            x_axis_label=panel.x.text or None, y_axis_label=panel.y.text or None,
            tools="pan,wheel_zoom,box_zoom,reset,save", toolbar_location="right",
            active_scroll=None, output_backend="canvas", **options,
        )  # fmt: skip
        dress_figure(fig, look)
        if over_time:
            fig.vstrip(x0="x0", x1="x1", source=self._stage.spans, fill_color=CHOSEN,
                       fill_alpha=0.25, line_color=None)  # fmt: skip
            self._brush(fig)
        items = []
        for mark in panel.marks:
            drawing = add(mark, fig, look, over_time)
            self._drawings.append((drawing, mark))
            if drawing.label and drawing.renderer is not None:
                items.append(LegendItem(label=drawing.label, renderers=[drawing.renderer]))
        if panel.equal and panel.x == EAST:
            fig.line(x="x", y="y", source=self._stage.spots, line_color=CHOSEN, line_width=6,
                     line_alpha=0.75, line_cap="round")  # fmt: skip
        _axes(fig, panel)
        _hover(fig, panel)
        if items and first:
            legend = _legend(items, look)
            fig.add_layout(legend, "above")
            fig.height += LEGEND_ROW * ((len(items) - 1) // legend.ncols)
        return fig

    def _time_of(self, panel: Panel) -> Any:
        ends = [m.x[[0, -1]] for m in panel.marks if isinstance(m, Line) and len(m.x)]
        every = np.concatenate(ends) if ends else np.array([0.0, 1.0])
        return self._stage.time_range(float(every.min()), float(every.max()))

    def _brush(self, fig: Any) -> None:
        """Draw a box over time: whoever listens is told from when to when."""
        if self._stage.on_brush is None:
            return
        tool, tell = BoxSelectTool(dimensions="width", description="Mark time"), self._stage
        fig.add_tools(tool)
        fig.toolbar.active_drag = tool

        def heard(event: Any) -> None:
            if event.final and event.geometry.get("type") == "rect" and tell.on_brush is not None:
                tell.on_brush(float(event.geometry["x0"]), float(event.geometry["x1"]))

        fig.on_event("selectiongeometry", heard)


def _shape(data: FigureData) -> Any:
    """What has to be the same for data to be filled in place."""
    return data.columns, tuple(
        (p.x, p.y, p.title, p.equal, p.names, tuple(type(m) for m in p.marks)) for p in data.panels
    )


def _layout(figures: Sequence[Any], columns: int) -> Any:
    if columns == 1:
        return column(*figures, sizing_mode="stretch_width")
    for fig in figures:
        fig.min_width = NARROWEST  # side by side where there is room, else one below the other
    rows = [
        row(*figures[i : i + columns], sizing_mode="stretch_width", styles={"flex-wrap": "wrap"})
        for i in range(0, len(figures), columns)
    ]
    return column(*rows, sizing_mode="stretch_width")


def _height(panel: Panel) -> int:
    if panel.equal:
        return MAP_HEIGHT
    if any(isinstance(mark, Strip) for mark in panel.marks):
        return STRIP_HEIGHT
    if panel.names:
        return NAMES_HEIGHT
    return TIME_HEIGHT if panel.x == TIME else HEIGHT


def dress_figure(fig: Any, look: Look) -> None:
    """Paper and ink of the theme."""
    fig.background_fill_color = fig.border_fill_color = look.paper
    fig.outline_line_color = None
    fig.grid.grid_line_color = look.grid
    if fig.title is not None:
        fig.title.text_color = look.ink
    for axis in fig.axis:
        axis.axis_label_text_color = axis.major_label_text_color = look.ink
        axis.axis_label_text_font_style = "normal"
        axis.axis_line_color = axis.major_tick_line_color = look.faint
        axis.minor_tick_line_color = None
    fig.toolbar.logo = None
    fig.toolbar.autohide = True
    fig.min_border_right = 12


def _axes(fig: Any, panel: Panel) -> None:
    """Ticks with names, a compass for headings, rows of strips."""
    if panel.names:
        fig.xaxis.ticker = FixedTicker(ticks=list(range(len(panel.names))))
        fig.xaxis.major_label_overrides = dict(enumerate(panel.names))
        fig.x_range = Range1d(-0.6, max(len(panel.names) - 0.4, 2.6))
        fig.xgrid.visible = False
        fig.y_range.start = 0.0 if _from_zero(panel) else None
    if panel.x.label == "heading":
        fig.xaxis.ticker = FixedTicker(ticks=list(COMPASS))
        fig.xaxis.major_label_overrides = {k: f"{k} {name}" for k, name in COMPASS.items()}
        fig.x_range = Range1d(0.0, 360.0)
    strips = [mark for mark in panel.marks if isinstance(mark, Strip)]
    if strips:
        rows = strips[0].rows
        fig.yaxis.ticker = FixedTicker(ticks=list(range(len(rows))))
        fig.yaxis.major_label_overrides = dict(enumerate(rows))
        fig.y_range = Range1d(len(rows) - 0.5, -0.5)
        fig.grid.visible = False


def _from_zero(panel: Panel) -> bool:
    return any(isinstance(mark, Bars) for mark in panel.marks)


def _hover(fig: Any, panel: Panel) -> None:
    """Numbers under the pointer, with their units."""
    named = [r for r in fig.renderers if r.name]
    x, y = panel.x, panel.y
    if named and not panel.equal:
        rows = [("", "$name"), (x.label or "x", f"@x{{0.00}} {x.unit}"),
                (y.label or "y", f"@y{{0.000}} {y.unit}")]  # fmt: skip
        fig.add_tools(HoverTool(renderers=named, tooltips=rows, mode="mouse"))


def _short(items: list[Any]) -> bool:
    """Whether three beside one another fit where the picture is narrow."""
    return sum(len(str(item.label.value)) for item in items[:3]) < LEGEND_LETTERS


def _legend(items: list[Any], look: Look) -> Any:
    short = _short(items)
    return Legend(
        items=items, orientation="horizontal", location="left", border_line_color=None,
        background_fill_alpha=0.0, label_text_color=look.ink, label_text_font_size="12px",
        padding=0, margin=4, spacing=14 if short else 0, ncols=3 if short else 1,
    )  # fmt: skip
