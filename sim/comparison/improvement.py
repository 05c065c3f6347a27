"""Is one vessel better than another on the same recording, by how much, and where is it not.

Both are scored by one ruler on the same blocks of time, so the ratio of their errors is drawn over
those blocks: what both suffer alike (waves, gusts) does not hide the difference.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.comparison.compare import ADEQUATE_FLOORS, Comparison
from sim.prediction.scores import BOOTSTRAP_DRAWS, scaled_squares
from sim.state import Floats

MIN_SECONDS = 10.0  # of a condition in which an exception is looked for …
MIN_TIME_SHARE = 0.03  # … and its share of the time
WORSE_BY = 1.1  # times the error of the other vessel: an exception
MAX_EXCEPTIONS = 3  # that are named


@dataclass(frozen=True)
class Improvement:
    """The second vessel beside the first on one recording.

    ratio   nrmse of the second over that of the first
    ci95    of the ratio, over blocks of time; None where there are too few
    noise   both errors are no more than noise
    but     conditions in which the better one is worse, as people say them
    """

    log: str
    first: str
    second: str
    ratio: float
    ci95: tuple[float, float] | None
    noise: bool
    but: tuple[str, ...]

    @property
    def clear(self) -> bool:
        """Whether the difference is more than chance."""
        if self.noise or self.ci95 is None:
            return False
        return self.ci95[1] < 1.0 or self.ci95[0] > 1.0

    @property
    def sentence(self) -> str:
        """What a person wants to know."""
        if self.noise:
            return (
                f"{self.first} and {self.second} on {self.log}: both err by no more than noise, "
                "these data cannot tell which is better"
            )
        if not self.clear or self.ci95 is None:
            return f"{self.first} and {self.second} on {self.log}: no clear difference"
        better, worse = (self.second, self.first)[:: 1 if self.ratio < 1.0 else -1]
        falls = sorted(1.0 - r if self.ratio < 1.0 else 1.0 - 1.0 / r for r in self.ci95)
        fall = 1.0 - (self.ratio if self.ratio < 1.0 else 1.0 / self.ratio)
        where = f"everywhere but at {', '.join(self.but)}" if self.but else "everywhere"
        return (
            f"{better} is better than {worse} on {self.log}: the error falls by {100 * fall:.0f} % "
            f"({100 * falls[0]:.0f} to {100 * falls[1]:.0f} %), {where}"
        )

    def to_dict(self) -> dict[str, Any]:
        """One entry of `improvements` in `shadow compare --json`."""
        interval = {} if self.ci95 is None else {"ratio_ci95": list(self.ci95)}
        return {
            "log": self.log, "first": self.first, "second": self.second, "ratio": self.ratio,
            **interval, "clear": self.clear, "but": list(self.but), "says": self.sentence,
        }  # fmt: skip


def improvements(found: Sequence[Comparison]) -> list[Improvement]:
    """Every further vessel of each recording beside the first one."""
    by_log: dict[str, list[Comparison]] = {}
    for one in found:
        by_log.setdefault(one.log, []).append(one)
    return [improvement(group[0], other) for group in by_log.values() for other in group[1:]]


def improvement(first: Comparison, second: Comparison) -> Improvement:
    """Two comparisons by one ruler."""
    ratio = second.nrmse / max(first.nrmse, 1e-12)
    better, worse = (second, first) if ratio < 1.0 else (first, second)
    floor = ADEQUATE_FLOORS * first.noise_floor_nrmse
    noise = first.nrmse <= floor and second.nrmse <= floor
    but = () if noise else _exceptions(better, worse, floor)
    return Improvement(
        first.log, first.vessel, second.vessel, ratio, _interval(first, second), noise, but
    )


def _interval(first: Comparison, second: Comparison) -> tuple[float, float] | None:
    """95 % of the ratio of the two errors, blocks of time drawn anew; None below two blocks."""
    sums = [_block_means(one) for one in (first, second)]
    both = np.isfinite(sums[0]) & np.isfinite(sums[1])
    n = int(both.sum())
    if n < 2:
        return None
    draw = np.random.default_rng(first.ruler.settings.seed).integers(0, n, (BOOTSTRAP_DRAWS, n))
    a, b = (part[both][draw].sum(axis=1) for part in sums)
    low, high = np.quantile(np.sqrt(b / np.maximum(a, 1e-300)), [0.025, 0.975])
    return float(low), float(high)


def _block_means(one: Comparison) -> Floats:
    """Sum of squared scaled errors of each block of the ruler; NaN where nothing was predicted."""
    segment, _, error = one.prediction.predicted_rows()
    block = one.ruler.blocks[segment]
    size = int(np.max(one.ruler.blocks)) + 1
    squares = np.bincount(block, scaled_squares(error, one.ruler.scales), size)
    return np.where(np.bincount(block, minlength=size) > 0, squares, np.nan)


def _exceptions(better: Comparison, worse: Comparison, floor: float) -> tuple[str, ...]:
    """Conditions in which the better one errs clearly more than the other, the largest first."""
    others = {(b.by, b.start, b.end): b for b in worse.where}
    found = []
    for one in better.where:
        other = others.get((one.by, one.start, one.end))
        if other is None or one.seconds < MIN_SECONDS or one.time_share < MIN_TIME_SHARE:
            continue
        error = better.nrmse * np.sqrt(one.share / one.time_share)
        before = worse.nrmse * np.sqrt(other.share / max(other.time_share, 1e-12))
        if error > WORSE_BY * before and error > floor:
            found.append((one.share, one.sentence.partition(":")[0]))
    return tuple(name for _, name in sorted(found, reverse=True)[:MAX_EXCEPTIONS])
