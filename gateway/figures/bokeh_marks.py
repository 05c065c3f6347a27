"""Marks of figure data as Bokeh glyphs: the columns of their data source, and how each is drawn."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.core.properties import value as literal
from bokeh.models import BasicTicker, ColorBar, ColumnDataSource, LinearColorMapper

from gateway.figures import (
    Band,
    Bars,
    ColouredPoints,
    Dots,
    Lanes,
    Level,
    Line,
    Mark,
    SeriesRole,
    Strip,
    Theme,
    decimated,
    within,
    worst_kept,
)

POINTS = 3000  # of a coloured track
LETTER = 0.008  # of the width of a figure
Columns = dict[str, Any]


@dataclass
class DrawnMark:
    """One mark on screen: its data, what draws them, and its scale where they are coloured."""

    mark: Mark
    source: Any
    renderer: Any
    mapper: Any = None
    legend: Any = None  # its item there

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
        if self.legend is not None and self.legend.label.value != self.label:
            self.legend.label = literal(self.label)


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


def columns_of(mark: Mark, window: tuple[float, float] | None = None) -> Columns:
    """The columns of a mark's data source; `window` limits a line over time."""
    match mark:
        case Line(x=x, y=y):
            x, y = decimated(x, y) if window is None else decimated(*within(x, y, *window))
            return {"x": x, "y": y}
        case ColouredPoints(x=x, y=y, value=value):
            kept = worst_kept(value, POINTS)
            kept = kept[np.argsort(value[kept])]  # what is worst lies on top
            return {"x": x[kept], "y": y[kept], "value": value[kept]}
        case Bars(start=start, end=end, height=height):
            return {"left": start, "right": end, "y": height, "x": 0.5 * (start + end)}
        case Strip(rows=names, value=value):
            row = np.repeat(np.arange(len(names)), value.shape[1])
            return {
                "left": np.tile(mark.start, len(names)), "right": np.tile(mark.end, len(names)),
                "bottom": row + 0.5, "top": row - 0.5, "value": value.reshape(-1),
                "row": [names[i] for i in row],
            }  # fmt: skip
        case Dots(x=x, y=y, low=low, high=high):
            return {"x": x, "y": y, "low": low, "high": high}
        case Band(x=x, low=low, high=high):
            return {"x": x, "low": low, "high": high}
        case Level(y=y):
            return {"y": [y]}
        case Lanes():
            return {
                "left": mark.start, "right": mark.end, "bottom": mark.row + 0.42,
                "top": mark.row - 0.42, "text": list(mark.texts), "row": mark.row,
                "shown": _readable(mark), "bad": [float(bad) for bad in mark.bad],
            }  # fmt: skip
    raise TypeError(f"cannot draw {type(mark).__name__}")


def _readable(mark: Lanes) -> list[str]:
    """The texts that have room in their stretch; the others show under the pointer."""
    whole = float(np.ptp(np.concatenate([mark.start, mark.end]))) if len(mark.start) else 0.0
    needed = [LETTER * len(text) * whole for text in mark.texts]
    lengths = mark.end - mark.start
    return [t if have > need else "" for t, have, need in zip(mark.texts, lengths, needed,
                                                             strict=True)]  # fmt: skip


def _draw(mark: Mark, figure: Any, source: Any, theme: Theme, mapper: Any) -> Any:
    """The glyphs of a mark on a figure; the renderer that stands in the legend."""
    colour = "" if isinstance(mark, ColouredPoints | Strip | Lanes) else theme.colour(mark.role)
    by_value = {"field": "value", "transform": mapper}
    match mark:
        case Line():
            drawn = figure.line(x="x", y="y", source=source, line_color=mark.colour or colour,
                                line_width=1.6, name=mark.label or None)  # fmt: skip
            drawn.nonselection_glyph = None  # a box drawn over time is shown by itself
            return drawn
        case ColouredPoints():
            return figure.scatter(x="x", y="y", source=source, size=5, line_color=None,
                                  fill_color=by_value)  # fmt: skip
        case Bars():
            outline = {"fill_color": None, "line_color": colour, "line_width": 1.8}
            filled = {"fill_color": colour, "line_color": theme.paper}
            return figure.quad(left="left", right="right", top="y", bottom=0, source=source,
                               name=mark.label or None,
                               **(outline if mark.outline else filled))  # fmt: skip
        case Strip():
            return figure.quad(left="left", right="right", top="top", bottom="bottom",
                               source=source, line_color=theme.paper, line_width=1,
                               fill_color=by_value)  # fmt: skip
        case Dots():
            for end in ("low", "high"):  # glyphs, so that the axis has room for them
                figure.scatter(x="x", y=end, source=source, size=9, marker="dash", color=colour)
            figure.segment(x0="x", x1="x", y0="low", y1="high", source=source, line_color=colour,
                           line_width=1.6)  # fmt: skip
            return figure.scatter(x="x", y="y", source=source, size=7, color=colour,
                                  name=mark.label or None)  # fmt: skip
        case Band():
            return figure.varea(x="x", y1="low", y2="high", source=source, fill_alpha=0.16,
                                fill_color=colour)  # fmt: skip
        case Level():
            return figure.hspan(y="y", source=source, line_color=colour,
                                line_width=1.8 if mark.label else 1.0,
                                line_dash="dashed" if mark.label else "solid")  # fmt: skip
        case Lanes():
            palette = [theme.faint, theme.colour(SeriesRole.MODEL)]
            edge = {"field": "bad", "transform": LinearColorMapper(palette, low=0.0, high=1.0)}
            figure.text(x="left", y="row", text="shown", source=source, text_color=theme.ink,
                        text_baseline="middle", text_font_size="12px", x_offset=5)  # fmt: skip
            return figure.quad(left="left", right="right", top="top", bottom="bottom", name="lanes",
                               source=source, fill_color=theme.faint, fill_alpha=0.18,
                               line_color=edge, line_width=1.6)  # fmt: skip


def _colour_bar(mapper: Any, title: str, theme: Theme) -> Any:
    return ColorBar(
        color_mapper=mapper, title=title, width=10, padding=4, label_standoff=5,
        title_text_color=theme.ink, title_text_font_style="normal", ticker=BasicTicker(
            desired_num_ticks=4), major_label_text_color=theme.ink,
        background_fill_color=theme.paper, bar_line_color=None, major_tick_line_color=None,
    )  # fmt: skip
