"""Tells when the missing force leaves its usual range, and when it is back: in words.

Means over blocks of a few seconds are held against the blocks of the last minutes: median and
spread. Blocks, since the rows of a filter are correlated over seconds. Unusual blocks are not
remembered, so that they do not become the usual; after minutes of nothing else they do, and that
is said too.

What happened on the path, in words: the rows of the event topic.
"""

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from gateway.estimation.filter import FilterRows
from gateway.estimation.names import Flag
from gateway.shadow.inputs import FilterInputs
from gateway.shadow.path import BROKEN, Shadowing, discontinuous
from gateway.shadow.topic_rows import Happening
from sim.state import Floats

BLOCK_S = 5.0
REMEMBERED = 60  # blocks: five minutes
NEEDED = 12  # blocks before anything is called unusual
FAR = 6.0  # robust standard deviations; blocks are not Gaussian, and there are thousands a day
BACK = 3.0  # … within which it is usual again
LEAST = 0.1  # of the missing force's own standard deviation: a calm hour makes nobody nervous
AXES = (("ahead", "N"), ("to starboard", "N"), ("clockwise", "N m"))


@dataclass(frozen=True)
class UsualRange:
    """Means of the blocks so far, and the block that is under way."""

    blocks: Floats  # (B, 3) [N, N, N m]
    total: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of the block under way
    count: int = 0
    began: float = -np.inf  # s
    unusual: tuple[bool, ...] = (False, False, False)
    persisted: int = 0  # unusual blocks in a row

    @classmethod
    def start(cls) -> "UsualRange":
        """Nothing seen yet."""
        return cls(np.empty((0, 3)))

    def observe(self, out: Shadowing) -> tuple["UsualRange", list[Happening]]:
        """A chunk of the path -> the range after it, and what left or entered it."""
        now, told = self, list[Happening]()
        rows = zip(out.time_s.tolist(), out.watched.missing.tolist(), strict=True)
        for k, (time, (X, Y, N)) in enumerate(rows):
            if not isfinite(X + Y + N):
                continue
            if time - now.began >= BLOCK_S:
                now, said = now._closed(out, k)
                told += said
            x, y, n = now.total
            total = (x + X, y + Y, n + N)
            now = UsualRange(
                now.blocks, total, now.count + 1, now.began, now.unusual, now.persisted
            )
        return now, told

    def _closed(self, out: Shadowing, k: int) -> tuple["UsualRange", list[Happening]]:
        """The block ends before row k."""
        fresh = replace(self, total=(0.0, 0.0, 0.0), count=0, began=float(out.time_s[k]))
        if self.count == 0:
            return fresh, []
        mean = np.array(self.total) / self.count
        if len(self.blocks) < NEEDED:
            return replace(fresh, blocks=np.vstack([self.blocks, mean])), []
        middle = np.median(self.blocks, axis=0)
        spread = 1.4826 * np.median(np.abs(self.blocks - middle), axis=0)
        width = np.maximum(spread, LEAST * out.watched.missing_std[k])
        limit = np.where(self.unusual, BACK, FAR) * width
        unusual = tuple((np.abs(mean - middle) > limit).tolist())
        if any(unusual) and self.persisted + 1 >= REMEMBERED:
            says = f"for {REMEMBERED * BLOCK_S / 60.0:.0f} minutes: usual from here on"
            return UsualRange.start(), [_happened(out, k, False, f"unusual forces {says}")]
        told = [
            _happened(out, k, unusual[axis], _words(axis, unusual[axis], mean, middle, FAR * width))
            for axis in range(3)
            if unusual[axis] != self.unusual[axis]
        ]
        if any(unusual):
            return replace(fresh, unusual=unusual, persisted=self.persisted + 1), told
        blocks = np.vstack([self.blocks, mean])[-REMEMBERED:]
        return replace(fresh, blocks=blocks, unusual=unusual, persisted=0), told


def _happened(out: Shadowing, k: int, off: bool, says: str) -> Happening:
    kind, severity = ("residual_unusual", "warning") if off else ("residual_usual", "info")
    return Happening(int(out.vehicle_time_ns[k]), int(out.receive_time_ns[k]), kind, severity, says)


def _words(axis: int, off: bool, mean: Floats, middle: Floats, width: Floats) -> str:
    towards, unit = AXES[axis]
    low, high = middle[axis] - width[axis], middle[axis] + width[axis]
    usual = f"usually {low:.1f} to {high:.1f} {unit}"
    if off:
        return f"the model lacks {mean[axis]:.1f} {unit} {towards}, {usual}"
    return f"what the model lacks {towards} is back to its usual range ({usual})"


@dataclass(frozen=True)
class EventDetector:
    """Knows how things stood after the last row, so that each change is told once."""

    started: bool = False
    fresh: bool = True
    modelled: bool = False
    bound: bool = False

    def observe(
        self, feed: FilterInputs, rows: FilterRows, out: Shadowing
    ) -> tuple["EventDetector", list[Happening]]:
        """A chunk of the path -> how things stand now, and what happened, in order."""
        told: list[Happening] = []
        first = 0 if self.started else int(out.row[0]) + 1 if len(out) else len(rows)
        if not self.started and len(out):
            told.append(_at(out, 0, "started", "info", "the first estimate is there"))
        if (rows.flags & BROKEN).any():
            told += _breaks(feed, rows, first)
        told += self._changes(out, out.fresh, self.fresh, _TELEMETRY)
        told += self._changes(out, out.from_model, self.modelled, _REFERENCE)
        told += self._changes(out, out.bound, self.bound, _LIMITS)
        told.sort(key=lambda h: h.receive_time_ns)
        if not len(out):
            return self, told
        stands = bool(out.fresh[-1]), bool(out.from_model[-1]), bool(out.bound[-1])
        return EventDetector(True, *stands), told

    def _changes(
        self, out: Shadowing, now: NDArray[np.bool_], before: bool, words: "_Words"
    ) -> list[Happening]:
        if now.all() if before else not now.any():
            return []
        changed = np.flatnonzero(np.diff(np.append(before, now).astype(np.int8)) != 0)
        return [_at(out, int(k), *words[bool(now[k])]) for k in changed]


def _breaks(feed: FilterInputs, rows: FilterRows, first: int) -> list[Happening]:
    """Jumps and restarts; before the first estimate there is nothing to interrupt."""
    return [
        Happening(int(feed.vehicle_time_ns[k]), int(feed.receive_time_ns[k]), *words)
        for flags, words in ((discontinuous(feed, rows), _JUMP), (rows.has(Flag.RESTART), _RESTART))
        for k in np.flatnonzero(flags)
        if k >= first
    ]


def _at(out: Shadowing, k: int, kind: str, severity: str, says: str) -> Happening:
    return Happening(int(out.vehicle_time_ns[k]), int(out.receive_time_ns[k]), kind, severity, says)


_Words = dict[bool, tuple[str, str, str]]

_TELEMETRY: _Words = {
    True: ("telemetry_back", "info", "telemetry is fresh again"),
    False: ("telemetry_silent", "warning", "the boat no longer tells its heading and velocity"),
}
_REFERENCE: _Words = {
    True: ("reference_model", "info", "the shadow follows the vessel's own prediction now"),
    False: ("reference_measured", "info", "the shadow follows the measurement now"),
}
_LIMITS: _Words = {
    True: ("limits_bind", "warning", "the plant's thrust limits bind: it cannot follow"),
    False: ("limits_free", "info", "the plant's thrust limits no longer bind"),
}
_JUMP = ("jump", "warning", "the source jumped: a discontinuity, not motion")
_RESTART = ("restart", "warning", "the filter started afresh: long silence or a new clock")
