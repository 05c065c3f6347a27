"""Tells when the missing force leaves its usual range, and when it is back: in words.

Means over blocks of a few seconds are held against the blocks of the last minutes: median and
spread. Blocks, since the rows of a filter are correlated over seconds. Unusual blocks are not
remembered, so that they do not become the usual; after minutes of nothing else they do, and that
is said too.
"""

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from gateway.pipelines.path import Shadowing
from gateway.pipelines.rows import Happening
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
