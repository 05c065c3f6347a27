"""Figure data as the text of an SVG that is as narrow as a phone held upright can show."""

from dataclasses import replace
from io import StringIO
from typing import Any

import matplotlib

from gateway.pictures.decimate import decimated, worst_kept
from gateway.pictures.draw import LOOKS, draw
from gateway.pictures.figure_data import Coloured, FigureData, Line, Panel

NARROW = 5.6  # inches: at 360 px of a phone, text of 9 points is still read
COLUMNS = 500
POINTS = 1500


def svg(figure: FigureData) -> str:
    """One panel below the other, without a title: the page has it."""
    plain = replace(
        figure, title="", says="", columns=1, panels=tuple(map(_thinned, figure.panels))
    )
    out = StringIO()
    with matplotlib.rc_context(LOOKS):
        draw(plain, NARROW).savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def _thinned(panel: Panel) -> Panel:
    return replace(panel, marks=tuple(_fewer(mark) for mark in panel.marks))


def _fewer(mark: Any) -> Any:
    """What is drawn with fewer points; tracks are not over time, but their gaps and ends stay."""
    if isinstance(mark, Line):
        x, y = decimated(mark.x, mark.y, COLUMNS)
        return replace(mark, x=x, y=y)
    if isinstance(mark, Coloured):
        kept = worst_kept(mark.value, POINTS)
        return replace(mark, x=mark.x[kept], y=mark.y[kept], value=mark.value[kept])
    return mark
