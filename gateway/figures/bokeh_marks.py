"""Marks of figure data as Bokeh glyphs: the columns of their data source, and how each is drawn."""

from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
from bokeh.models import BasicTicker, ColorBar, ColumnDataSource, LinearColorMapper

from gateway.figures.decimate import decimated, within, worst_kept
from gateway.figures.figure_data import (
    Band,
    Bars,
    ColouredPoints,
    Dots,
    Level,
    Line,
    Mark,
    Strip,
)
from gateway.figures.style import Theme

POINTS = 3000  # of a coloured track
Columns = dict[str, Any]


@dataclass
class DrawnMark:
    """One mark on screen: its data, what draws them, and its scale where they are coloured."""

    mark: Mark
    source: Any
    renderer: Any
    mapper: Any = None

    @property
    def label(self) -> str:
        """What stands in the legend."""
        return getattr(self.mark, "label", "")

    def fill(self, mark: Mark, window: tuple[float, float] | None = None) -> None:
        """Show another mark of the same kind; of a line over time perhaps only a window."""
        self.mark = mark
        self.source.data = columns_of(mark, window)
        if self.mapper is not None:
            self.mapper.high = _highest(mark)


def draw_mark(mark: Mark, figure: Any, theme: Theme) -> DrawnMark:
    """One mark onto a figure."""
    source, mapper = ColumnDataSource(columns_of(mark)), None
    if isinstance(mark, ColouredPoints | Strip):
        mapper = LinearColorMapper(palette=theme.scale(), low=0.0, high=_highest(mark))
    renderer = _draw(mark, figure, source, theme, mapper)
    if mapper is not None:
        title = mark.scale.text if isinstance(mark, ColouredPoints) else ""
        figure.add_layout(_colour_bar(mapper, title, theme), "right")
    return DrawnMark(mark, source, renderer, mapper)


def _highest(mark: Any) -> float:
    return max(mark.highest, 1e-9)


@singledispatch
def columns_of(mark: Any, window: tuple[float, float] | None = None) -> Columns:
    """The columns of a mark's data source; `window` limits a line over time."""
    raise TypeError(f"cannot draw {type(mark).__name__}")


@columns_of.register
def _(mark: Line, window: tuple[float, float] | None = None) -> Columns:
    x, y = (mark.x, mark.y) if window is None else within(mark.x, mark.y, *window)
    x, y = decimated(x, y)
    return {"x": x, "y": y}


@columns_of.register
def _(mark: ColouredPoints, window: Any = None) -> Columns:
    kept = worst_kept(mark.value, POINTS)
    kept = kept[np.argsort(mark.value[kept])]  # what is worst lies on top
    return {"x": mark.x[kept], "y": mark.y[kept], "value": mark.value[kept]}


@columns_of.register
def _(mark: Bars, window: Any = None) -> Columns:
    return {"left": mark.start, "right": mark.end, "y": mark.height,
            "x": 0.5 * (mark.start + mark.end)}  # fmt: skip


@columns_of.register
def _(mark: Strip, window: Any = None) -> Columns:
    rows, n = mark.value.shape
    row = np.repeat(np.arange(rows), n)
    return {
        "left": np.tile(mark.start, rows), "right": np.tile(mark.end, rows),
        "bottom": row + 0.5, "top": row - 0.5, "value": mark.value.reshape(-1),
        "row": [mark.rows[i] for i in row],
    }  # fmt: skip


@columns_of.register
def _(mark: Dots, window: Any = None) -> Columns:
    return {"x": mark.x, "y": mark.y, "low": mark.low, "high": mark.high}


@columns_of.register
def _(mark: Band, window: Any = None) -> Columns:
    return {"x": mark.x, "low": mark.low, "high": mark.high}


@columns_of.register
def _(mark: Level, window: Any = None) -> Columns:
    return {"y": [mark.y]}


@singledispatch
def _draw(mark: Any, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    """The glyphs of a mark; the renderer that stands in the legend."""
    raise TypeError(f"cannot draw {type(mark).__name__}")


@_draw.register
def _(mark: Line, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    drawn = figure.line(
        x="x", y="y", source=source, line_color=theme.colour(mark.role), line_width=1.6,
        name=mark.label or None,
    )  # fmt: skip
    drawn.nonselection_glyph = None  # a box drawn over time is shown by itself
    return drawn


@_draw.register
def _(mark: ColouredPoints, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    return figure.scatter(x="x", y="y", source=source, size=5, line_color=None,
                          fill_color={"field": "value", "transform": mapper})  # fmt: skip


@_draw.register
def _(mark: Bars, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    colour = theme.colour(mark.role)
    style = (
        {"fill_color": None, "line_color": colour, "line_width": 1.8}
        if mark.outline
        else {"fill_color": colour, "line_color": theme.paper}
    )
    return figure.quad(left="left", right="right", top="y", bottom=0, source=source,
                       name=mark.label or None, **style)  # fmt: skip


@_draw.register
def _(mark: Strip, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    return figure.quad(left="left", right="right", top="top", bottom="bottom", source=source,
                       line_color=theme.paper, line_width=1,
                       fill_color={"field": "value", "transform": mapper})  # fmt: skip


@_draw.register
def _(mark: Dots, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    colour = theme.colour(mark.role)
    for end in ("low", "high"):  # glyphs, so that the axis has room for them
        figure.scatter(x="x", y=end, source=source, size=9, marker="dash", color=colour)
    figure.segment(x0="x", x1="x", y0="low", y1="high", source=source, line_color=colour,
                   line_width=1.6)  # fmt: skip
    return figure.scatter(x="x", y="y", source=source, size=7, color=colour,
                          name=mark.label or None)  # fmt: skip


@_draw.register
def _(mark: Band, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    return figure.varea(x="x", y1="low", y2="high", source=source, fill_alpha=0.16,
                        fill_color=theme.colour(mark.role))  # fmt: skip


@_draw.register
def _(mark: Level, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    return figure.hspan(
        y="y", source=source, line_color=theme.colour(mark.role),
        line_width=1.8 if mark.label else 1.0, line_dash="dashed" if mark.label else "solid",
    )  # fmt: skip


def _colour_bar(mapper: Any, title: str, theme: Theme) -> Any:
    return ColorBar(
        color_mapper=mapper, title=title, width=10, padding=4, label_standoff=5,
        title_text_color=theme.ink, title_text_font_style="normal", ticker=BasicTicker(
            desired_num_ticks=4), major_label_text_color=theme.ink,
        background_fill_color=theme.paper, bar_line_color=None, major_tick_line_color=None,
    )  # fmt: skip
