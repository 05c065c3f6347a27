"""The time column of a table, as far as it can be believed.

A few rows whose time lies elsewhere than that of the rows before and after them are damaged cells
and left out. Where the rest of the table goes on from another time, a new session begins: one that
steps back goes on a second after the end of the one before, so that time never runs backwards over
sessions; one that leaps ahead further than any boat is silent keeps its times.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.clock_step import CONFIRM, JUMP, SECOND, SLEEP
from sim.state import Floats

JUMP_S, SLEEP_S, CONFIRM_S = JUMP / SECOND, SLEEP / SECOND, CONFIRM / SECOND


@dataclass(frozen=True)
class TimeColumn:
    """Times of a table repaired.

    kept      (K,) bool  rows whose time can be believed
    time_s    (n,)       of those rows, over sessions ascending
    sessions  (start, end) of each [s]
    notes     a sentence for each thing that was wrong
    """

    kept: NDArray[np.bool_]
    time_s: Floats
    sessions: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]


def repair_time(time_s: Floats) -> TimeColumn:
    """Times (K,) [s] of the rows of a table, all finite -> those that hold, and their sessions."""
    kept = _believed(time_s)
    time = time_s[kept].copy()
    steps = np.diff(time)
    cuts = np.flatnonzero((steps < -JUMP_S) | (steps > SLEEP_S)) + 1
    pieces = np.split(time, cuts)
    for before, piece in pairwise(pieces):
        if piece[0] < before.max():
            piece += before.max() + 1.0 - piece.min()
    lost, notes = int((~kept).sum()), []
    if lost:
        notes.append(f"{lost} rows left out whose time is none that their neighbours have")
    if len(pieces) > 1:
        notes.append(f"time leaps within the table: read as {len(pieces)} sessions")
    sessions = tuple((float(p.min()), float(p.max())) for p in pieces if len(p))
    return TimeColumn(kept, np.concatenate(pieces), sessions, tuple(notes))


def _believed(time: Floats) -> NDArray[np.bool_]:
    """Which rows (K,) are no short stretch that lies elsewhere in time than its neighbours."""
    cuts = np.flatnonzero(np.abs(np.diff(time)) > JUMP_S) + 1
    kept, pieces = np.ones(len(time), np.bool_), np.split(np.arange(len(time)), cuts)
    last = -np.inf  # time of the last row that was believed
    for k, rows in enumerate(pieces):
        start, end = time[rows].min(), time[rows].max()
        after = float(time[pieces[k + 1][0]]) if k + 1 < len(pieces) else np.inf
        brief = len(pieces) > 1 and end - start < CONFIRM_S
        between = last <= start and end <= after
        alone = start - last > SLEEP_S and after - end > SLEEP_S
        if brief and (alone if between else last <= after):
            kept[rows] = False
        else:
            last = float(time[rows[-1]])
    return kept if kept.any() else np.ones(len(time), np.bool_)
