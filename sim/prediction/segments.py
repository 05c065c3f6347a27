"""How the usable time of a trial is divided: stretches, blocks, and segments for free runs."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.state import Ints
from sim.trial import Trial

# Length of the blocks of time by which held-out tests, bootstraps and leave-one-block-out intervals
# resample a trial [s]. Two to three of the longest free runs (8 to 10 s); chosen, not measured.
BLOCK_S = 25.0
# Time left out between blocks [s]: residuals are autocorrelated (`noise.CORRELATION_TIMES_S`).
GUARD_S = 5.0


class RowRange(NamedTuple):
    """Rows start … stop − 1 of a trial."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


def usable_stretches(usable: NDArray[np.bool_]) -> list[RowRange]:
    """Flags (T,) -> the runs of rows that are all usable, in order."""
    padded = np.concatenate(([0], np.asarray(usable, np.int8), [0]))
    edges = np.flatnonzero(np.diff(padded))
    return [RowRange(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def blocks(
    usable: NDArray[np.bool_], dt: float, length: float = BLOCK_S, guard: float = GUARD_S
) -> list[RowRange]:
    """Usable time cut into blocks of at least `length` [s], at least `guard` [s] apart.

    A stretch shorter than `length` but longer than half of it is a block of its own; what is
    shorter still is left out.
    """
    wanted, gap = max(round(length / dt), 1), int(np.ceil(guard / dt - 1e-9))
    out: list[RowRange] = []
    for stretch in usable_stretches(usable):
        start = max(stretch.start, out[-1].stop + gap) if out else stretch.start
        out += _cut(start, stretch.stop, wanted, gap)
    return out


def _cut(start: int, stop: int, wanted: int, gap: int) -> list[RowRange]:
    """One stretch into as many equal blocks of at least `wanted` rows as fit."""
    room = stop - start
    if room < wanted / 2:
        return []
    count = max((room + gap) // (wanted + gap), 1)
    width = (room - (count - 1) * gap) // count
    return [RowRange(start + i * (width + gap), start + i * (width + gap) + width)
            for i in range(count)]  # fmt: skip


@dataclass(frozen=True)
class CompareSettings:
    """Free runs of `horizon` [s] from a moment every `every` [s].

    A horizon ends early where the spread of its start state, carried along the measured track,
    passes `spread_limit` (root mean square over u, v, r in units of the nrmse scales) or
    `spread_growth` times its value at the start, whichever is larger: below the first the start
    state hardly shows in the error; the second lets a coarse estimate of a steady boat run on.
    No horizon is cut below `shortest` [s]; the spread is looked at every `node` [s].
    """

    horizon: float = 10.0
    every: float = 2.5
    shortest: float = 1.0
    node: float = 0.25
    spread_limit: float = 0.25
    spread_growth: float = 2.0
    block: float = 30.0  # s, of the blocks that intervals are made from
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("horizon", "every", "shortest", "node", "block"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be longer than 0 s, not {getattr(self, name)}")
        if self.horizon < self.shortest:
            raise ValueError(f"horizon {self.horizon} s is below the shortest, {self.shortest} s")


SHORTEST_STRETCH = 2.0  # s of usable time that still give a segment


class NoUsableTimeError(ValueError):
    """The trial has no stretch that a model could be compared over."""


@dataclass(frozen=True)
class Segments:
    """Many moments of a trial from which free runs start.

    rows     (S,)  row of the trial where the segment starts
    nodes    (S,)  its length in nodes
    stride         steps of the trial from node to node
    """

    rows: Ints
    nodes: Ints
    stride: int

    @property
    def steps(self) -> Ints:
        """Lengths (S,) in steps of the trial."""
        return self.nodes * self.stride


def segments_of(trial: Trial, settings: CompareSettings) -> Segments:
    """Segments that lie within one usable stretch each; NoUsableTimeError if there is none.

    A stretch shorter than the horizon gives one segment as long as itself.
    """
    stride = max(round(settings.node / trial.dt), 1)
    node = stride * trial.dt
    longest = max(round(settings.horizon / node), 1)
    apart = max(round(settings.every / node), 1)
    rows, nodes = [], []
    for stretch in usable_stretches(trial.usable):
        room = (len(stretch) - 1) // stride
        if room * node < min(SHORTEST_STRETCH, settings.horizon) - 1e-9:
            continue
        first = np.arange(0, max(room - longest, 0) + 1, apart)
        rows.append(stretch.start + stride * first)
        nodes.append(np.full(len(first), min(room, longest)))
    if not rows:
        raise NoUsableTimeError(
            f"{trial.name}: no usable stretch of {SHORTEST_STRETCH:g} s or more to compare over"
        )
    return Segments(np.concatenate(rows), np.concatenate(nodes), stride)
