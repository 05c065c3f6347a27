"""Fewer points that look the same: no peak, no gap and no end of a line is lost."""

import numpy as np

from sim.state import Floats, Ints

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
