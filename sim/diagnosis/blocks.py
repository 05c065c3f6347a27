"""Usable time as stretches, and as blocks with a guard between them for held-out tests."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

GUARD = 5.0  # s between blocks: residuals are autocorrelated


class Rows(NamedTuple):
    """Rows start … stop − 1 of a trial."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


def stretches(usable: NDArray[np.bool_]) -> list[Rows]:
    """Flags (T,) -> the runs of rows that are all usable, in order."""
    padded = np.concatenate(([0], np.asarray(usable, np.int8), [0]))
    edges = np.flatnonzero(np.diff(padded))
    return [Rows(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def blocks(
    usable: NDArray[np.bool_], dt: float, length: float = 25.0, guard: float = GUARD
) -> list[Rows]:
    """Usable time cut into blocks of at least `length` [s], at least `guard` [s] apart.

    A stretch shorter than `length` but longer than half of it is a block of its own; what is
    shorter still is left out.
    """
    wanted, gap = max(round(length / dt), 1), int(np.ceil(guard / dt - 1e-9))
    out: list[Rows] = []
    for stretch in stretches(usable):
        start = max(stretch.start, out[-1].stop + gap) if out else stretch.start
        out += _cut(start, stretch.stop, wanted, gap)
    return out


def _cut(start: int, stop: int, wanted: int, gap: int) -> list[Rows]:
    """One stretch into as many equal blocks of at least `wanted` rows as fit."""
    room = stop - start
    if room < wanted / 2:
        return []
    count = max((room + gap) // (wanted + gap), 1)
    width = (room - (count - 1) * gap) // count
    return [Rows(start + i * (width + gap), start + i * (width + gap) + width)
            for i in range(count)]  # fmt: skip
