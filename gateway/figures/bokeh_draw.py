"""Figure data drawn by Bokeh, for the screen: zoomed, hovered over, and filled anew in place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import (
    Arrow,
    BoxSelectTool,
    ColumnDataSource,
    CrosshairTool,
    FixedTicker,
    HoverTool,
    Legend,
    LegendItem,
    OpenHead,
    Range1d,
    Span,
)
from bokeh.plotting import figure as new_figure

from gateway.figures import (
    COMPASS,
    EAST,
    HEADING,
    LIGHT,
    SELECTED,
    TIME,
    Bars,
    FigureData,
    Line,
    Panel,
    SeriesRole,
    Theme,
)
from gateway.figures.bokeh_marks import DrawnMark, draw_mark

LANE_HEIGHT = 26
HEIGHT, TIME_HEIGHT, STRIP_HEIGHT, MAP_HEIGHT, NAMES_HEIGHT = 230, 175, 130, 430, 320
NARROWEST = 310  # px, of a panel beside another
LEGEND_ROW = 24  # px
LEGEND_LETTERS = 45  # that fit side by side on a phone


@dataclass
class LinkedView:
    """What the figures of one page share: the theme, the time axis, what is marked, the moment.

    now, boats, arrow   the time cursor: time [s]; outlines of boats and a force on the track
    on_tap              what a click on a time axis does, in the browser
    """

    theme: Theme = LIGHT
    time: Any = None  # Range1d of every time axis, made by the first
    spans: Any = field(default_factory=lambda: ColumnDataSource({"x0": [], "x1": []}))
    points: Any = field(default_factory=lambda: ColumnDataSource({"x": [], "y": []}))
    now: Any = field(default_factory=lambda: ColumnDataSource({"x": []}))
    boats: Any = field(default_factory=lambda: ColumnDataSource({"xs": [], "ys": [], "colour": []}))
    arrow: Any = field(
        default_factory=lambda: ColumnDataSource({"x0": [], "y0": [], "x1": [], "y1": []})
    )
    hovered: Any = field(default_factory=lambda: Span(dimension="height", line_dash="dotted"))
    on_brush: Callable[[float, float], None] | None = None
    on_tap: Any = None

    def time_range(self, panel: Panel) -> Any:
        """The range of all time axes, from the first panel; it bounds what can be panned to."""
        if self.time is None:
            ends = [m.x[[0, -1]] for m in panel.marks if isinstance(m, Line) and len(m.x)]
            every = np.concatenate(ends) if ends else np.array([0.0, 1.0])
            start, end = float(every.min()), float(every.max())
            self.time = Range1d(start, end, bounds=(start, end), min_interval=1.0)
        return self.time


class BokehFigure:
    """A figure on screen; `update` puts other data of the same shape into it."""

    def __init__(self, data: FigureData, view: LinkedView | None = None) -> None:
        self._view = view or LinkedView()
        self._shape = _shape(data)
        self._over_time: list[DrawnMark] = []
        self._drawn: list[DrawnMark] = []
        self.figures = [self._panel(panel, i == 0) for i, panel in enumerate(data.panels)]
        self.layout = _layout(self.figures, data.columns)

    def update(self, data: FigureData) -> bool:
        """Fill with other data; False where it is of another shape and has to be drawn anew."""
        if _shape(data) != self._shape:
            return False
        marks = [mark for panel in data.panels for mark in panel.marks]
        for drawn, mark in zip(self._drawn, marks, strict=True):
            drawn.fill(mark)
        return True

    def resample(self, start: float, end: float) -> None:
        """Lines over time with as many points as that window deserves."""
        for drawn in self._over_time:
            drawn.fill(drawn.mark, (start, end))

    def _panel(self, panel: Panel, first: bool) -> Any:
        theme, over_time = self._view.theme, panel.x == TIME
        options: dict[str, Any] = {"x_range": self._view.time_range(panel)} if over_time else {}
        if panel.equal:
            options["match_aspect"] = True
        fig = new_figure(
            height=_height(panel), sizing_mode="stretch_width", title=panel.title or None,
            x_axis_label=panel.x.text or None, y_axis_label=panel.y.text or None,
            tools="pan,wheel_zoom,box_zoom,reset,save", toolbar_location="right",
            active_scroll=None, output_backend="canvas",
            html_attributes={"role": "group", "aria-label": _spoken(panel)}, **options,
        )  # fmt: skip
        style_figure(fig, theme)
        if over_time:
            fig.vstrip(x0="x0", x1="x1", source=self._view.spans, fill_color=SELECTED,
                       fill_alpha=0.25, line_color=None)  # fmt: skip
            self._add_brush(fig)
            self._add_cursor(fig)
        items = []
        for mark in panel.marks:
            drawn = draw_mark(mark, fig, theme)
            self._drawn.append(drawn)
            if over_time and isinstance(mark, Line):
                self._over_time.append(drawn)
            if drawn.label and drawn.renderer is not None:
                drawn.legend = LegendItem(label=drawn.label, renderers=[drawn.renderer])
                items.append(drawn.legend)
        if panel.equal and panel.x == EAST:
            fig.line(x="x", y="y", source=self._view.points, line_color=SELECTED, line_width=6,
                     line_alpha=0.75, line_cap="round")  # fmt: skip
            fig.patches("xs", "ys", source=self._view.boats, fill_color="colour", fill_alpha=0.6,
                        line_color=theme.ink, line_width=1.5)  # fmt: skip
            colour = theme.colour(SeriesRole.ERROR)
            fig.add_layout(Arrow(
                source=self._view.arrow, x_start="x0", y_start="y0", x_end="x1", y_end="y1",
                line_color=colour, line_width=3, end=OpenHead(size=10, line_color=colour),
            ))  # fmt: skip
        _axes(fig, panel)
        _hover(fig, panel)
        if items and first:
            legend = _legend(items, theme)
            fig.add_layout(legend, "above")
            fig.height += LEGEND_ROW * ((len(items) - 1) // legend.ncols)
        return fig

    def _add_cursor(self, fig: Any) -> None:
        """The moment of the time cursor, and a line under the pointer in all figures at once."""
        if self._view.on_tap is None:
            return
        fig.vspan(x="x", source=self._view.now, line_color=self._view.theme.ink, line_width=1.5)
        self._view.hovered.line_color = self._view.theme.faint
        fig.add_tools(CrosshairTool(dimensions="height", overlay=self._view.hovered))
        fig.js_on_event("tap", self._view.on_tap)

    def _add_brush(self, fig: Any) -> None:
        """Draw a box over time: `on_brush` is called with its start and end."""
        on_brush = self._view.on_brush
        if on_brush is None:
            return
        tool = BoxSelectTool(dimensions="width", description="Mark time")
        fig.add_tools(tool)
        fig.toolbar.active_drag = tool

        def selected(event: Any) -> None:
            if event.final and event.geometry.get("type") == "rect":
                on_brush(float(event.geometry["x0"]), float(event.geometry["x1"]))

        fig.on_event("selectiongeometry", selected)


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
    if panel.strip is not None:
        return STRIP_HEIGHT
    if panel.lanes is not None:
        return LANE_HEIGHT * len(panel.lanes.names) + 60
    if panel.names:
        return NAMES_HEIGHT
    return TIME_HEIGHT if panel.x == TIME else HEIGHT


def _spoken(panel: Panel) -> str:
    """What a panel shows, for people who hear it."""
    of = panel.y.label or ", ".join(getattr(m, "label", "") for m in panel.marks) or "rows"
    return " ".join(f"plot of {of} over {panel.x.label or 'names'} {panel.title}".split())


def style_figure(fig: Any, theme: Theme) -> None:
    """Paper and ink of the theme."""
    fig.background_fill_color = fig.border_fill_color = theme.paper
    fig.outline_line_color = None
    fig.grid.grid_line_color = theme.grid
    if fig.title is not None:
        fig.title.text_color = theme.ink
    for axis in fig.axis:
        axis.axis_label_text_color = axis.major_label_text_color = theme.ink
        axis.axis_label_text_font_style = "normal"
        axis.axis_line_color = axis.major_tick_line_color = theme.faint
        axis.minor_tick_line_color = None
    fig.toolbar.logo = None
    fig.toolbar.autohide = True
    fig.min_border_right = 12


def _axes(fig: Any, panel: Panel) -> None:
    """Ticks with names, a compass for headings, rows of strips."""
    if panel.names:
        _named_ticks(fig.xaxis, dict(enumerate(panel.names)))
        fig.x_range = Range1d(*panel.names_span)
        fig.xgrid.visible = False
        bars = any(isinstance(mark, Bars) for mark in panel.marks)
        fig.y_range.start = 0.0 if bars else None
    if panel.x == HEADING:
        _named_ticks(fig.xaxis, {90 * k: f"{90 * k} {name}" for k, name in enumerate(COMPASS[::2])})
        fig.x_range = Range1d(0.0, 360.0)
    if panel.strip is not None or panel.lanes is not None:
        rows = panel.strip.rows if panel.strip else panel.lanes.names if panel.lanes else ()
        _named_ticks(fig.yaxis, dict(enumerate(rows)))
        fig.y_range = Range1d(len(rows) - 0.5, -0.5)
        fig.grid.visible = False


def _named_ticks(axis: Any, names: dict[int, str]) -> None:
    axis.ticker = FixedTicker(ticks=list(names))
    axis.major_label_overrides = names


def _hover(fig: Any, panel: Panel) -> None:
    """Numbers under the pointer, with their units."""
    named = [r for r in fig.renderers if r.name]
    x, y = panel.x, panel.y
    if panel.lanes is not None:
        rows = [("", "@text"), (x.label, f"@left{{0.0}} {x.unit}")]
        fig.add_tools(HoverTool(renderers=named, tooltips=rows, mode="mouse"))
        return
    if named and not panel.equal:
        rows = [("", "$name"), (x.label or "x", f"@x{{0.00}} {x.unit}"),
                (y.label or "y", f"@y{{0.000}} {y.unit}")]  # fmt: skip
        fig.add_tools(HoverTool(renderers=named, tooltips=rows, mode="mouse"))


def _legend(items: list[Any], theme: Theme) -> Any:
    """Three labels to a row where they fit beside one another in a narrow figure, else one."""
    short = sum(len(str(item.label.value)) for item in items[:3]) < LEGEND_LETTERS
    return Legend(
        items=items, orientation="horizontal", location="left", border_line_color=None,
        background_fill_alpha=0.0, label_text_color=theme.ink, label_text_font_size="12px",
        padding=0, margin=4, spacing=14 if short else 0, ncols=3 if short else 1,
    )  # fmt: skip
