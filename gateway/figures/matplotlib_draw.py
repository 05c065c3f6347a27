"""Figure data drawn by matplotlib, without a window or global state: PNG and SVG files, SVG text.

The text of an SVG, for the report, is as narrow as a phone held upright can show. Matplotlib is
imported when something is drawn: it takes as long as many a command that draws nothing.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cache
from io import BytesIO, StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures import (
    COLOUR,
    COLOUR_SCALE,
    COMPASS,
    HEADING,
    Band,
    Bars,
    ColouredPoints,
    Dots,
    FigureData,
    Lanes,
    Level,
    Line,
    Mark,
    Panel,
    SeriesRole,
    Strip,
    decimated,
    worst_kept,
)
from gateway.files import picture_name, write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = (".png", ".svg")
RC_PARAMS = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.titlesize": 10.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.1,
    "svg.fonttype": "path",
    "svg.hashsalt": "shadow",
}
WIDTH, ROW, STRIP_ROW, NAMES_ROW, MAP_ROW = 10.0, 2.3, 1.35, 3.6, 5.0  # inches
NARROW = 5.6  # inches: at 360 px of a phone, text of 9 points is still read
SVG_COLUMNS, SVG_POINTS = 500, 1500  # of a line, of a coloured track


@cache
def _colours() -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("little_to_much", COLOUR_SCALE)


def _own_style() -> AbstractContextManager[None]:
    from matplotlib import rc_context

    return rc_context(RC_PARAMS)  # type: ignore[no-any-return]


def save_figure(figure: FigureData, path: str | Path) -> Path:
    """Write .png or .svg, whole or not at all; the same data give the same bytes."""
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in FORMATS:
        raise BadInput(f"{file}: pictures are written as {' or '.join(FORMATS)}")
    undated = {"Date": None} if suffix == ".svg" else {"Software": None}
    drawn = BytesIO()
    with _own_style():
        draw_figure(figure).savefig(drawn, format=suffix[1:], dpi=130, metadata=undated)
    write_whole(file, drawn.getvalue(), "the picture")
    return file


def save_figures(figures: Mapping[str, FigureData], folder: str | Path) -> list[Path]:
    """Write figures as NAME.png into a folder, with dashes for blanks and special characters."""
    return [
        save_figure(figure, Path(folder) / picture_name(name)) for name, figure in figures.items()
    ]


def svg_text(figure: FigureData) -> str:
    """An SVG, one panel below the other, without the title, which the page has."""
    panels = tuple(
        replace(panel, marks=tuple(map(_thinned, panel.marks))) for panel in figure.panels
    )
    plain = replace(figure, title="", caption="", columns=1, panels=panels)
    out = StringIO()
    with _own_style():
        draw_figure(plain, NARROW).savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _thinned(mark: Any) -> Any:
    """A mark with fewer points; tracks are not over time, but their gaps and ends stay."""
    if isinstance(mark, Line):
        x, y = decimated(mark.x, mark.y, SVG_COLUMNS)
        return replace(mark, x=x, y=y)
    if isinstance(mark, ColouredPoints):
        kept = worst_kept(mark.value, SVG_POINTS)
        return replace(mark, x=mark.x[kept], y=mark.y[kept], value=mark.value[kept])
    return mark


def draw_figure(figure: FigureData, width: float = WIDTH) -> "Figure":
    """The whole figure, `width` inches wide, panels row by row, one legend for all."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    rows = -(-len(figure.panels) // figure.columns)
    height = rows * max(map(_height, figure.panels), default=ROW)
    canvas = Figure(figsize=(width, height + 0.9), layout="constrained")
    axes = canvas.subplots(rows, figure.columns, squeeze=False, sharex=figure.shared_x).reshape(-1)
    for panel, ax in zip(figure.panels, axes, strict=False):
        _panel(panel, ax)
    for ax in axes[len(figure.panels) :]:
        ax.set_visible(False)
    if figure.shared_x:
        for ax in axes[: -figure.columns]:
            ax.set_xlabel("")
    strip = next((panel.strip for panel in figure.panels if panel.strip is not None), None)
    if strip is not None:  # one colour scale for all strips: they share it
        cells = ScalarMappable(Normalize(0.0, strip.highest), _colours())
        canvas.colorbar(cells, ax=canvas.axes, label=strip.scale.text, aspect=40, pad=0.01)
    _captions(canvas, figure)
    return canvas


def _height(panel: Panel) -> float:
    if panel.equal:
        return MAP_ROW
    if panel.strip is not None:
        return STRIP_ROW
    if panel.lanes is not None:
        return STRIP_ROW
    return NAMES_ROW if panel.names else ROW


def _captions(canvas: "Figure", figure: FigureData) -> None:
    """Title, the sentence below it, and one legend for marks of the same name."""
    heading = figure.title + (f"\n{figure.caption}" if figure.caption else "")
    canvas.suptitle(heading, fontsize=10.5, wrap=True)
    named: dict[str, Any] = {}
    for ax in canvas.axes:
        handles, labels = ax.get_legend_handles_labels()
        named |= dict(zip(labels, handles, strict=True))
    if named:
        columns = len(named) if canvas.get_figwidth() >= WIDTH else 2
        canvas.legend(named.values(), named.keys(), loc="outside lower center", ncols=columns)


def _panel(panel: Panel, ax: Any) -> None:
    ax.set_xlabel(panel.x.text)
    ax.set_ylabel(panel.y.text)
    ax.set_title(panel.title)
    for mark in panel.marks:
        draw_mark(mark, ax)
    if panel.equal:
        ax.set_aspect("equal", adjustable="box")
    if panel.names:
        ax.set_xticks(range(len(panel.names)), panel.names)
        ax.set_xlim(*panel.names_span)
        ax.grid(visible=False, axis="x")
    elif not panel.equal:
        ax.margins(x=0.01)
    if panel.x == HEADING:
        ax.set_xticks(range(0, 361, 45), [f"{45 * k}\n{name}" for k, name in enumerate(COMPASS)])
        ax.set_xlim(0.0, 360.0)


def draw_mark(mark: Mark, ax: Any) -> None:
    """One mark onto a pair of axes."""
    match mark:
        case Line():
            ax.plot(
                mark.x, mark.y, color=mark.colour or COLOUR[mark.role], label=mark.label or None
            )
        case ColouredPoints():
            order = np.argsort(mark.value)  # what is worst lies on top
            points = ax.scatter(
                mark.x[order], mark.y[order], c=mark.value[order], s=9, cmap=_colours(), vmin=0.0,
                vmax=mark.highest, linewidths=0, rasterized=True, zorder=3,
            )  # fmt: skip
            ax.figure.colorbar(points, ax=ax, label=mark.scale.text, shrink=0.7, extend="max")
        case Bars():
            colour = COLOUR[mark.role]
            outline = {"facecolor": "none", "edgecolor": colour, "linewidth": 1.4, "zorder": 3}
            filled = {"color": colour, "edgecolor": "white", "linewidth": 0.8}
            ax.bar(
                mark.start, mark.height, width=mark.end - mark.start, align="edge",
                label=mark.label or None, **(outline if mark.outline else filled),
            )  # fmt: skip
        case Strip():
            _draw_strip(mark, ax)
        case Dots():
            whiskers = np.abs(np.vstack([mark.y - mark.low, mark.high - mark.y]))
            ax.errorbar(
                mark.x, mark.y, yerr=whiskers, fmt="o", markersize=4.5, capsize=3, linewidth=1.2,
                color=COLOUR[mark.role], label=mark.label or None,
            )  # fmt: skip
        case Band():
            ax.fill_between(
                mark.x, mark.low, mark.high, color=COLOUR[mark.role], alpha=0.12, linewidth=0,
                label=mark.label or None,
            )  # fmt: skip
        case Level():
            ax.axhline(
                mark.y, color=COLOUR[mark.role], linewidth=1.6 if mark.label else 0.8,
                linestyle="--" if mark.label else "-", label=mark.label or None,
            )  # fmt: skip
        case Lanes():
            for start, end, row in zip(mark.start, mark.end, mark.row, strict=True):
                ax.plot([start, end], [row, row], "|-", color=COLOUR[SeriesRole.CONTEXT])
            ax.set_yticks(range(len(mark.names)), mark.names)
            ax.set_ylim(len(mark.names) - 0.5, -0.5)
        case _:
            raise TypeError(f"cannot draw {type(mark).__name__}")


def _draw_strip(mark: Strip, ax: Any) -> None:
    for k in range(len(mark.start)):  # bins need not touch: one without data leaves a gap
        edges = [mark.start[k], mark.end[k]]
        ax.pcolormesh(
            edges, np.arange(len(mark.rows) + 1) - 0.5, mark.value[:, k : k + 1],
            cmap=_colours(), vmin=0.0, vmax=mark.highest,
        )  # fmt: skip
    ax.set_yticks(range(len(mark.rows)), mark.rows)
    ax.invert_yaxis()
    ax.grid(visible=False)
