"""Tells when the missing force leaves its usual range, and when it is back: in words.

Means over blocks of a few seconds are held against the blocks of the last minutes: median and
spread, so that a few odd blocks do not become the usual. Blocks, since the rows of a filter are
correlated over seconds.
"""

from dataclasses import dataclass, replace

import numpy as np

from gateway.pipelines.path import Shadowing
from gateway.pipelines.rows import Happening
from sim.state import Floats

BLOCK_S = 5.0
REMEMBERED = 60  # blocks: five minutes
NEEDED = 12  # blocks before anything is called unusual
FAR = 6.0  # robust standard deviations; blocks are not Gaussian, and there are thousands a day
AXES = (("X", "ahead", "N"), ("Y", "to starboard", "N"), ("N", "clockwise", "N m"))


@dataclass(frozen=True)
class UsualRange:
    """Means of the blocks so far, and the block that is under way."""

    blocks: Floats  # (B, 3) [N, N, N m]
    total: Floats  # (3,) of the block under way
    count: int = 0
    began: float = -np.inf  # s
    unusual: tuple[bool, bool, bool] = (False, False, False)

    @classmethod
    def start(cls) -> "UsualRange":
        """Nothing seen yet."""
        return cls(np.empty((0, 3)), np.zeros(3))

    def observe(self, out: Shadowing) -> tuple["UsualRange", list[Happening]]:
        """A chunk of the path -> the range after it, and what left or entered it."""
        now, told = self, list[Happening]()
        known = np.isfinite(out.watched.missing).all(axis=1)
        for k in np.flatnonzero(known).tolist():
            if out.time_s[k] - now.began >= BLOCK_S:
                now, said = now._closed(out, k)
                told += said
            now = replace(now, total=now.total + out.watched.missing[k], count=now.count + 1)
        return now, told

    def _closed(self, out: Shadowing, k: int) -> tuple["UsualRange", list[Happening]]:
        """The block ends before row k."""
        fresh = replace(self, total=np.zeros(3), count=0, began=float(out.time_s[k]))
        if self.count == 0:
            return fresh, []
        mean, told = self.total / self.count, list[Happening]()
        unusual = list(self.unusual)
        if len(self.blocks) >= NEEDED:
            middle = np.median(self.blocks, axis=0)
            width = 1.4826 * np.median(np.abs(self.blocks - middle), axis=0)
            width = np.maximum(width, 0.25 * out.watched.missing_std[k])
            for axis in range(3):
                off = bool(abs(mean[axis] - middle[axis]) > FAR * width[axis])
                if off != unusual[axis]:
                    unusual[axis] = off
                    told.append(_say(out, k, axis, off, mean, middle, width))
        blocks = np.vstack([self.blocks, mean])[-REMEMBERED:]
        return replace(fresh, blocks=blocks, unusual=(unusual[0], unusual[1], unusual[2])), told


def _say(
    out: Shadowing, k: int, axis: int, off: bool, mean: Floats, middle: Floats, width: Floats
) -> Happening:
    _, towards, unit = AXES[axis]
    low, high = middle[axis] - FAR * width[axis], middle[axis] + FAR * width[axis]
    usual = f"usually {low:.1f} to {high:.1f} {unit}"
    if off:
        says = f"the model lacks {mean[axis]:.1f} {unit} {towards}, {usual}"
        kind, severity = "residual_unusual", "warning"
    else:
        says = f"what the model lacks {towards} is back to its usual range ({usual})"
        kind, severity = "residual_usual", "info"
    return Happening(int(out.vehicle_time_ns[k]), int(out.receive_time_ns[k]), kind, severity, says)
