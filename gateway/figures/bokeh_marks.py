"""Marks of figure data as Bokeh glyphs: how each is drawn, and how it is filled."""

from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np
from bokeh.models import BasicTicker, ColorBar, ColumnDataSource, LinearColorMapper

from gateway.figures.decimate import decimated, within, worst_kept
from gateway.figures.figure_data import Band, Bars, Coloured, Dots, Level, Line, Strip
from gateway.figures.style import Look

POINTS = 3000  # of a coloured track
WORST = 0.99  # quantile of the values where the colours end
Columns = dict[str, Any]


@dataclass
class Drawing:
    """One mark on screen: where its data go, and what stands in the legend."""

    source: Any
    renderer: Any
    label: str = ""
    mapper: Any = None
    over_time: bool = False


def fill(mark: Any, drawing: Drawing, window: tuple[float, float] | None = None) -> None:
    """Put the mark's data where it is drawn; of a line over time perhaps only a window."""
    drawing.source.data = columns(mark, window)
    if drawing.mapper is not None:
        drawing.mapper.high = top(mark)


def top(mark: Any) -> float:
    """Value at the end of the colour scale."""
    if isinstance(mark, Strip):
        return max(mark.highest, 1e-9)
    return max(float(np.quantile(mark.value, WORST)) if len(mark.value) else 1.0, 1e-9)


@singledispatch
def columns(mark: Any, window: tuple[float, float] | None = None) -> Columns:
    """The columns of a mark's source."""
    raise TypeError(f"cannot draw {type(mark).__name__}")


@columns.register
def _(mark: Line, window: tuple[float, float] | None = None) -> Columns:
    x, y = mark.x, mark.y
    if window is not None:
        x, y = within(x, y, *window)
    x, y = decimated(x, y)
    return {"x": x, "y": y}


@columns.register
def _(mark: Coloured, window: Any = None) -> Columns:
    kept = worst_kept(mark.value, POINTS)
    kept = kept[np.argsort(mark.value[kept])]  # what is worst lies on top
    return {"x": mark.x[kept], "y": mark.y[kept], "value": mark.value[kept]}


@columns.register
def _(mark: Bars, window: Any = None) -> Columns:
    return {"left": mark.start, "right": mark.end, "y": mark.height,
            "x": 0.5 * (mark.start + mark.end)}  # fmt: skip


@columns.register
def _(mark: Strip, window: Any = None) -> Columns:
    rows, n = mark.value.shape
    row = np.repeat(np.arange(rows), n)
    return {
        "left": np.tile(mark.start, rows), "right": np.tile(mark.end, rows),
        "bottom": row + 0.5, "top": row - 0.5, "value": mark.value.reshape(-1),
        "row": [mark.rows[i] for i in row],
    }  # fmt: skip


@columns.register
def _(mark: Dots, window: Any = None) -> Columns:
    return {"x": mark.x, "y": mark.y, "low": mark.low, "high": mark.high}


@columns.register
def _(mark: Band, window: Any = None) -> Columns:
    return {"x": mark.x, "low": mark.low, "high": mark.high}


@columns.register
def _(mark: Level, window: Any = None) -> Columns:
    return {"y": [mark.y]}


@singledispatch
def add(mark: Any, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    """One mark onto a figure."""
    raise TypeError(f"cannot draw {type(mark).__name__}")


@add.register
def _(mark: Line, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source = ColumnDataSource(columns(mark))
    drawn = fig.line(
        x="x", y="y", source=source, line_color=look.colour(mark.role), line_width=1.6,
        name=mark.label or None,
    )  # fmt: skip
    drawn.nonselection_glyph = None  # a box drawn over time is shown by itself
    return Drawing(source, drawn, mark.label, over_time=over_time)


@add.register
def _(mark: Coloured, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source = ColumnDataSource(columns(mark))
    mapper = _mapper(look, mark)
    drawn = fig.scatter(x="x", y="y", source=source, size=5, line_color=None,
                        fill_color={"field": "value", "transform": mapper})  # fmt: skip
    fig.add_layout(_colour_bar(mapper, mark.scale.text, look), "right")
    return Drawing(source, drawn, mapper=mapper)


@add.register
def _(mark: Bars, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source, colour = ColumnDataSource(columns(mark)), look.colour(mark.role)
    style = (
        {"fill_color": None, "line_color": colour, "line_width": 1.8}
        if mark.outline
        else {"fill_color": colour, "line_color": look.paper}
    )
    drawn = fig.quad(left="left", right="right", top="y", bottom=0, source=source,
                     name=mark.label or None, **style)  # fmt: skip
    return Drawing(source, drawn, mark.label)


@add.register
def _(mark: Strip, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source, mapper = ColumnDataSource(columns(mark)), _mapper(look, mark)
    drawn = fig.quad(left="left", right="right", top="top", bottom="bottom", source=source,
                     line_color=look.paper, line_width=1,
                     fill_color={"field": "value", "transform": mapper})  # fmt: skip
    fig.add_layout(_colour_bar(mapper, "", look), "right")
    return Drawing(source, drawn, mapper=mapper)


@add.register
def _(mark: Dots, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source, colour = ColumnDataSource(columns(mark)), look.colour(mark.role)
    for end in ("low", "high"):  # glyphs, so that the axis has room for them
        fig.scatter(x="x", y=end, source=source, size=9, marker="dash", color=colour)
    fig.segment(x0="x", x1="x", y0="low", y1="high", source=source, line_color=colour,
                line_width=1.6)  # fmt: skip
    drawn = fig.scatter(x="x", y="y", source=source, size=7, color=colour, name=mark.label or None)
    return Drawing(source, drawn, mark.label)


@add.register
def _(mark: Band, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source = ColumnDataSource(columns(mark))
    drawn = fig.varea(x="x", y1="low", y2="high", source=source, fill_alpha=0.16,
                      fill_color=look.colour(mark.role))  # fmt: skip
    return Drawing(source, drawn, mark.label)


@add.register
def _(mark: Level, fig: Any, look: Look, over_time: bool = False) -> Drawing:
    source = ColumnDataSource(columns(mark))
    drawn = fig.hspan(
        y="y", source=source, line_color=look.colour(mark.role),
        line_width=1.8 if mark.label else 1.0, line_dash="dashed" if mark.label else "solid",
    )  # fmt: skip
    return Drawing(source, drawn, mark.label)


def _mapper(look: Look, mark: Coloured | Strip) -> Any:
    return LinearColorMapper(palette=look.scale(), low=0.0, high=top(mark))


def _colour_bar(mapper: Any, title: str, look: Look) -> Any:
    return ColorBar(
        color_mapper=mapper, title=title, width=10, padding=4, label_standoff=5,
        title_text_color=look.ink, title_text_font_style="normal", ticker=BasicTicker(
            desired_num_ticks=4), major_label_text_color=look.ink,
        background_fill_color=look.paper, bar_line_color=None, major_tick_line_color=None,
    )  # fmt: skip
