"""Times of a table: as dates or clock times, as whole seconds, from the last to the first."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from gateway.errors import counted
from sim.state import Floats, Ints

CLOCK = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:\.\d+)?)")
DAY_S, HALF_DAY_S = 86400.0, 43200.0
DESCENDING_SHARE = 0.9  # of steps that go back: a table that begins with its last row
FEWEST_SECONDS = 3
EVEN_SHARE = 0.9  # of the seconds with the usual number of rows, or one more or less


class Times(NamedTuple):
    """Times (K,) [s], NaN where there is none, and what was taken for granted about them."""

    time_s: Floats
    notes: tuple[str, ...] = ()


def written_times(cells: Sequence[str]) -> Times | None:
    """Cells (K,) as ISO 8601 (Unix time) or as times of a day; None where they are neither."""
    there = [cell for cell in cells if cell]
    found = _clock_times(there) or _dates(there)
    if found is None:
        return None
    time = np.full(len(cells), np.nan)
    time[[bool(cell) for cell in cells]] = found.time_s
    return Times(time, found.notes)


def _dates(cells: Sequence[str]) -> Times | None:
    """Unix time of ISO 8601."""
    try:
        moments = [datetime.fromisoformat(cell) for cell in cells]
    except ValueError:
        return None
    zoned = [moment if moment.tzinfo else moment.replace(tzinfo=UTC) for moment in moments]
    notes = () if zoned == moments else ("times without a zone are read as UTC",)
    return Times(np.array([moment.timestamp() for moment in zoned]), notes)


def _clock_times(cells: Sequence[str]) -> Times | None:
    """Seconds since the midnight before the first; a day more after each midnight."""
    parts = [CLOCK.fullmatch(cell) for cell in cells]
    of_day = np.array([3600 * int(p[1]) + 60 * int(p[2]) + float(p[3]) for p in parts if p])
    if not len(of_day) or len(of_day) < len(cells):
        return None
    midnights = np.cumsum(np.diff(of_day, prepend=of_day[0]) < -HALF_DAY_S)
    note = "clock times without a date: read as seconds since midnight"
    return Times(of_day + DAY_S * midnights, (note,))


def is_descending(time_s: Floats) -> bool:
    """Do times (K,) [s] go back from nearly every row to the next?"""
    steps = np.diff(time_s[np.isfinite(time_s)])
    return len(steps) > 0 and float(np.mean(steps < 0.0)) > DESCENDING_SHARE


def spread_whole_seconds(time_s: Floats) -> Times:
    """Ascending times (K,) [s] that are whole seconds of several rows each -> spread over them.

    In the first second rows may be missing at its beginning, in the last one at its end.
    """
    if np.any(time_s % 1.0) or np.any(np.diff(time_s) < 0.0):
        return Times(time_s)
    _, first, of_second, counts = np.unique(
        time_s, return_index=True, return_inverse=True, return_counts=True
    )
    usual = int(np.median(counts))
    if usual < 2 or len(counts) < FEWEST_SECONDS:
        return Times(time_s)
    place = np.arange(len(time_s)) - first[of_second]
    share = counts.astype(np.float64)
    share[[0, -1]] = np.maximum(share[[0, -1]], usual)
    place[of_second == 0] += int(share[0]) - int(counts[0])
    return Times(time_s + place / share[of_second], (_about_whole_seconds(counts, usual),))


def _about_whole_seconds(counts: Ints, usual: int) -> str:
    inner = counts[1:-1]
    what = f"times are whole seconds, with {counted(usual, 'row')} each"
    if np.mean(np.abs(inner - usual) <= 1) >= EVEN_SHARE:
        return f"{what}: rows are spread evenly over their second"
    return (
        f"{what} ({inner.min()} to {inner.max()}): rows are spread over their second, but do not "
        "come evenly: a lag found here may be off by half a second. Write times with fractions"
    )
