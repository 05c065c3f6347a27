"""What a picture shows, as plain values: any library can draw it, and nothing is computed there.

Fewer points that look the same: no peak, no gap and no end of a line is lost.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np

from sim.state import Floats, Ints

WORST = 0.99  # quantile of coloured values at which the colour scale ends


class SeriesRole(Enum):
    """What a mark stands for; each role has one colour in every figure."""

    MEASURED = "measured"
    MODEL = "model"
    SHADOW = "shadow"
    ERROR = "error"
    FLOOR = "noise floor"
    INTERVAL = "interval"
    CONTEXT = "context"


@dataclass(frozen=True)
class Axis:
    """A quantity as people read it: its label, its unit, and how many of that unit make an SI unit.

    An empty unit is for names and plain numbers.
    """

    label: str
    unit: str = ""
    factor: float = 1.0

    @property
    def text(self) -> str:
        """Label with its unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@dataclass(frozen=True)
class Line:
    """A line through x (n,), y (n,); NaN interrupts it. `colour`: another than its role's."""

    x: Floats
    y: Floats
    role: SeriesRole
    label: str = ""
    colour: str = ""


@dataclass(frozen=True)
class ColouredPoints:
    """Points x (n,), y (n,) coloured by value (n,)."""

    x: Floats
    y: Floats
    value: Floats
    scale: Axis

    @property
    def highest(self) -> float:
        """Value at the end of the colour scale."""
        return max(float(np.quantile(self.value, WORST)) if len(self.value) else 1.0, 1e-9)


@dataclass(frozen=True)
class Bars:
    """Bars from start (n,) to end (n,), height (n,); `outline` draws their edge alone."""

    start: Floats
    end: Floats
    height: Floats
    role: SeriesRole
    label: str = ""
    outline: bool = False


@dataclass(frozen=True)
class Strip:
    """Coloured cells: columns from start (n,) to end (n,), one row (n,) of `value` per name."""

    start: Floats
    end: Floats
    rows: tuple[str, ...]
    value: Floats  # (rows, n)
    scale: Axis
    highest: float  # value at the end of the colour scale


@dataclass(frozen=True)
class Dots:
    """Points x (n,), y (n,) with a whisker from low (n,) to high (n,)."""

    x: Floats
    y: Floats
    low: Floats
    high: Floats
    role: SeriesRole
    label: str = ""


@dataclass(frozen=True)
class Band:
    """The area between low (n,) and high (n,) over x (n,)."""

    x: Floats
    low: Floats
    high: Floats
    role: SeriesRole
    label: str = ""


@dataclass(frozen=True)
class Level:
    """A horizontal line at `y`."""

    y: float
    role: SeriesRole
    label: str = ""


@dataclass(frozen=True)
class Lanes:
    """Named stretches from start (n,) to end (n,) in lane `row` (n,), one lane below the other.

    A stretch without length is a moment. `bad` (n,): something was wrong then.
    """

    names: tuple[str, ...]
    start: Floats
    end: Floats
    row: Ints
    texts: tuple[str, ...]
    bad: tuple[bool, ...]


Mark = Line | ColouredPoints | Bars | Strip | Dots | Band | Level | Lanes


@dataclass(frozen=True)
class Panel:
    """One pair of axes. `equal`: one metre is as long on both. `names`: of x = 0, 1, 2, …"""

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    title: str = ""
    equal: bool = False
    names: tuple[str, ...] = ()

    @property
    def names_span(self) -> tuple[float, float]:
        """Ends of an axis of names; a few names do not fill all of its width."""
        return -0.6, max(len(self.names) - 0.4, 2.6)

    @property
    def strip(self) -> Strip | None:
        """The coloured cells of the panel, if it shows such."""
        return next((mark for mark in self.marks if isinstance(mark, Strip)), None)

    @property
    def lanes(self) -> Lanes | None:
        """The lanes of the panel, if it shows such."""
        return next((mark for mark in self.marks if isinstance(mark, Lanes)), None)


@dataclass(frozen=True)
class FigureData:
    """A whole figure: panels row by row, `columns` to a row, and a sentence about it."""

    title: str
    panels: tuple[Panel, ...]
    columns: int = 1
    shared_x: bool = False
    caption: str = ""


COLUMNS = 1200  # of pixels that a figure may be wide


def decimated(x: Floats, y: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """x (n,) ascending but for pauses, y (n,) -> the lowest and highest point of each column.

    NaN interrupts the line: one of each run of NaN stays where it was.
    """
    if len(x) <= 4 * columns:
        return x, y
    edges = np.linspace(0, len(x), columns + 1).astype(np.int64)
    starts, known = edges[:-1], np.isfinite(y)
    low = _least(np.where(known, y, np.inf), starts)
    high = _least(np.where(known, -y, np.inf), starts)
    pauses = np.flatnonzero(~known & np.concatenate([[True], known[:-1]]))
    ends = np.array([0, len(x) - 1])
    keep = np.unique(np.concatenate([low, high, pauses, ends]))
    return x[keep], y[keep]


def _least(values: Floats, starts: Ints) -> Ints:
    """Index of the least value of each column, values (n,), columns beginning at `starts`."""
    lengths = np.diff(np.append(starts, len(values)))
    floor = np.repeat(np.minimum.reduceat(values, starts), lengths)
    at = np.flatnonzero(values == floor)
    column = np.repeat(np.arange(len(starts)), lengths)[at]
    return at[np.unique(column, return_index=True)[1]]


def within(x: Floats, y: Floats, start: float, end: float) -> tuple[Floats, Floats]:
    """The points of x (n,) ascending between start and end, one more on either side."""
    first = max(int(np.searchsorted(x, start)) - 1, 0)
    last = int(np.searchsorted(x, end, side="right")) + 1
    return x[first:last], y[first:last]


def worst_kept(value: Floats, count: int) -> Ints:
    """value (n,) -> indices of at most `count` points in order: of each run of points the worst."""
    if len(value) <= count:
        return np.arange(len(value))
    edges = np.linspace(0, len(value), count + 1).astype(np.int64)
    return _least(-value, edges[:-1])
