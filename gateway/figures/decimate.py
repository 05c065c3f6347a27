"""Fewer points for the screen that look the same: no peak, no gap and no end is lost."""

import numpy as np

from sim.state import Floats

COLUMNS = 1200  # of pixels that a strip may be wide


def decimated(x: Floats, y: Floats, columns: int = COLUMNS) -> tuple[Floats, Floats]:
    """x (n,) ascending but for pauses, y (n,) -> the lowest and highest point of each column.

    NaN lifts the pen: one of each run of NaN stays where it was.
    """
    if len(x) <= 4 * columns:
        return x, y
    edges = np.linspace(0, len(x), columns + 1).astype(np.int64)
    starts, known = edges[:-1], np.isfinite(y)
    low = _first(np.where(known, y, np.inf), starts, np.minimum)
    high = _first(np.where(known, -y, np.inf), starts, np.minimum)
    pauses = np.flatnonzero(~known & np.concatenate([[True], known[:-1]]))
    ends = np.array([0, len(x) - 1])
    keep = np.unique(np.concatenate([low, high, pauses, ends]))
    return x[keep], y[keep]


def _first(values: Floats, starts: "np.ndarray[tuple[int], np.dtype[np.int64]]",
           least: np.ufunc) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":  # fmt: skip
    """Index of the least value of each column, values (n,), columns beginning at `starts`."""
    lengths = np.diff(np.append(starts, len(values)))
    floor = np.repeat(least.reduceat(values, starts), lengths)
    at = np.flatnonzero(values == floor)
    column = np.repeat(np.arange(len(starts)), lengths)[at]
    return at[np.unique(column, return_index=True)[1]]


def within(x: Floats, y: Floats, start: float, end: float) -> tuple[Floats, Floats]:
    """The points of x (n,) ascending between start and end, one more on either side."""
    first = max(int(np.searchsorted(x, start)) - 1, 0)
    last = int(np.searchsorted(x, end, side="right")) + 1
    return x[first:last], y[first:last]


def worst_kept(value: Floats, count: int) -> "np.ndarray[tuple[int], np.dtype[np.int64]]":
    """value (n,) -> indices of at most `count` points in order: of each run of points the worst."""
    if len(value) <= count:
        return np.arange(len(value))
    edges = np.linspace(0, len(value), count + 1).astype(np.int64)
    return _first(-value, edges[:-1], np.minimum)
