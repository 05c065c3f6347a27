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

from sim.state import Ints

CREDIBLE_US = 1 << 52  # 142 years
JUMP_US = 10_000_000  # as the boat's clock has it (`clock.JUMP`)
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

    def sides(self, place: int) -> list[tuple[float, float]]:
        """Earliest and latest time that agrees with the rows before a place, and with those behind.

        A side without rows is left out.
        """
        k = int(np.searchsorted(self.place, place))
        before, behind = self.time[max(k - AROUND, 0) : k], self.time[k + 1 : k + 1 + AROUND]
        return [_agreeing(rows) for rows in (before, behind) if len(rows)]

    def beyond_all(self, time: int, place: int) -> bool:
        """Whether hardly a row of the whole log is as late, and those around this one are not."""
        as_late = len(self.sorted) - int(np.searchsorted(self.sorted, time - JUMP_US))
        k = int(np.searchsorted(self.place, place))
        alone = as_late <= FEWEST <= max(k, len(self.place) - k - 1)
        return alone and all(time > latest for _, latest in self.sides(place))


def _agreeing(time: Ints) -> tuple[float, float]:
    """Times (K,) -> where another one may be: few rows in a minute reach further."""
    middle = float(np.median(time))
    width = JUMP_US + SPREADS * float(np.median(np.abs(time - middle)))
    return middle - width, middle + width


def _damaged(place: Ints, time: Ints, around: _Around) -> Bools:
    """Rows of one instance -> those whose time cannot be (K,)."""
    out = np.zeros(len(time), np.bool_)
    for k in np.flatnonzero(time[:-1] - time[1:] > JUMP_US).tolist():
        if all(time[k] > latest for _, latest in around.sides(place[k])):
            out[k] = True
        elif all(time[k + 1] < earliest for earliest, _ in around.sides(place[k + 1])):
            out[k + 1] = True
    if len(time) and around.beyond_all(time[-1], place[-1]):  # no row behind it steps back
        out[-1] = True
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
