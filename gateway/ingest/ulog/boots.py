"""The clock of a ULog: which of its times cannot be, and where its autopilot booted again.

Rows of one instance of a topic are written in the order of their time, except where the clock
restarts: there every instance steps back. So a step back by more than `JUMP_US` is either a damaged
time or the clock's own, and the rows around it in the file tell which: at a restart those before
share the old time and those behind the new one.

    damaged     later than the rows around it, before and behind, though its own instance goes on
                earlier; or earlier than both, though its instance was later before
    restart     what remains: it lies somewhere between two rows of each instance that steps back;
                the fewest places that explain all of these steps are the restarts

An instance may begin with a row that is old: the logger writes the last value of each topic first.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.clock import JUMP
from gateway.ingest.mapping import CREDIBLE_US
from sim.state import Floats, Ints

JUMP_US = JUMP // 1000  # as the boat's clock has it
AROUND = 11  # rows before and behind that tell what time it is
SPREADS = 4.0  # median deviations of them that another row may be off by
FEWEST = 5  # rows that tell the time where nothing steps back
ROUNDS = 20  # of looking for damaged times: so many may follow each other in one instance

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Boots:
    """Which rows of each instance have a time that can be (K,), and the places of restarts (S,)."""

    kept: tuple[Bools, ...]
    restarts: Ints

    def of(self, place: Ints) -> Ints:
        """Places (K,) -> the boot that each belongs to, from 0."""
        return np.asarray(np.searchsorted(self.restarts, place, side="right"), np.int64)


def boots(places: Sequence[Ints], stamps: Sequence[NDArray[np.uint64]]) -> Boots:
    """Places (K,) in the file and times (K,) [µs since boot] of each instance -> its boots."""
    kept = [stamp <= CREDIBLE_US for stamp in stamps]
    times = [np.minimum(stamp, CREDIBLE_US).astype(np.int64) for stamp in stamps]
    for _ in range(ROUNDS):
        around = _Around(
            np.concatenate([place[keep] for place, keep in zip(places, kept, strict=True)]),
            np.concatenate([time[keep] for time, keep in zip(times, kept, strict=True)]),
        )
        damaged = [
            _damaged(place[keep], time[keep], around)
            for place, time, keep in zip(places, times, kept, strict=True)
        ]
        if not any(some.any() for some in damaged):
            break
        for keep, some in zip(kept, damaged, strict=True):
            keep[np.flatnonzero(keep)[some]] = False
    steps = [
        _steps_back(place[keep], time[keep])
        for place, time, keep in zip(places, times, kept, strict=True)
    ]
    return Boots(tuple(kept), _restarts(np.concatenate(steps)))


class _Around:
    """All rows in the order of the file: what time the ones around a place show."""

    def __init__(self, place: Ints, time: Ints) -> None:
        order = np.argsort(place, kind="stable")
        self.place, self.time, self.sorted = place[order], time[order], np.sort(time)

    def later(self, time: Ints, place: Ints) -> Bools:
        """Rows (M,) -> whether each is later than those before it and those behind it."""
        sides = [middle + width for middle, width in self._sides(place)]
        return np.logical_and.reduce([(time > latest) | np.isnan(latest) for latest in sides])

    def earlier(self, time: Ints, place: Ints) -> Bools:
        """… earlier than both."""
        sides = [middle - width for middle, width in self._sides(place)]
        return np.logical_and.reduce([(time < first) | np.isnan(first) for first in sides])

    def alone(self, time: Ints, place: Ints) -> Bools:
        """Rows (M,) -> whether hardly one of the whole log is as late, in a log that has many."""
        as_late = len(self.sorted) - np.searchsorted(self.sorted, time - JUMP_US)
        k = np.searchsorted(self.place, place)
        many = np.maximum(k, len(self.place) - k - 1) >= FEWEST
        return np.asarray((as_late <= FEWEST) & many)

    def _sides(self, place: Ints) -> list[tuple[Floats, Floats]]:
        """Places (M,) -> median time of the rows before, and how far another one may be from it;
        the same of those behind. NaN without rows; few rows in a minute reach further.
        """
        k = np.searchsorted(self.place, place)[:, None]
        out = []
        for steps in (np.arange(-AROUND, 0), np.arange(1, AROUND + 1)):
            rows = k + steps
            inside = (rows >= 0) & (rows < len(self.time))
            time = np.where(inside, self.time[np.clip(rows, 0, len(self.time) - 1)], np.nan)
            middle = _median(time)
            out.append((middle, JUMP_US + SPREADS * _median(np.abs(time - middle[:, None]))))
        return out


def _median(rows: Floats) -> Floats:
    """(M, n) -> (M,) without the NaN in each row; NaN where there is nothing else."""
    count = np.isfinite(rows).sum(axis=1)
    ordered, every = np.sort(rows, axis=1), np.arange(len(rows))
    below, above = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, rows.shape[1] - 1)
    return np.asarray(0.5 * (ordered[every, below] + ordered[every, above]))


def _damaged(place: Ints, time: Ints, around: _Around) -> Bools:
    """Rows of one instance -> those whose time cannot be (K,)."""
    out = np.zeros(len(time), np.bool_)
    back = np.flatnonzero(time[:-1] - time[1:] > JUMP_US)
    late = around.later(time[back], place[back])
    early = around.earlier(time[back + 1], place[back + 1])
    out[back[late]] = True
    out[back[early & ~late] + 1] = True
    last = slice(-1, None)  # no row behind it steps back
    ends = around.alone(time[last], place[last]) & around.later(time[last], place[last])
    out[last] |= ends
    return out


def _steps_back(place: Ints, time: Ints) -> Ints:
    """Rows of one instance -> the places before and behind each step back (N, 2)."""
    back = np.flatnonzero(time[:-1] - time[1:] > JUMP_US)
    return np.stack([place[back], place[back + 1]], axis=1)


def _restarts(steps: Ints) -> Ints:
    """Steps back as (before, behind] (N, 2) -> the fewest places that lie in all of them (S,)."""
    found: list[int] = []
    for before, behind in sorted(steps.tolist(), key=lambda step: step[1]):
        if not found or found[-1] <= before:
            found.append(behind)
    return np.asarray(found, np.int64)
