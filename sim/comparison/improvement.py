"""Which of two vessels is better on a recording, by how much, where not, and when nobody can say.

The interval of the ratio of their errors is from the same blocks of time, drawn anew. Source: Efron
and Tibshirani, An Introduction to the Bootstrap, 1993, ch. 8 (blocks of what is alike in time).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.comparison.compare import (
    ADEQUATE_FLOORS,
    CHANNEL_NAMES,
    CHANNEL_UNITS,
    Comparison,
    Judgement,
)
from sim.prediction.free_runs import BOOTSTRAP_DRAWS, scaled_squares
from sim.state import Floats

MIN_WORSE_RATIO = 1.25  # of the errors of one velocity, in which the better of two files is worse
MIN_SECONDS = 10.0  # of a condition in which an exception is looked for …
MIN_TIME_SHARE = 0.03  # … and its share of the time
WORSE_BY = 1.1  # times the error of the other vessel: an exception
MAX_EXCEPTIONS = 3  # that are named
SOON_S = 0.5  # of a free run, in which an error of its start has hardly grown …
# … and the ratio of the errors there at most (95 %) of what is better for certain. Files 10 to 30 %
# off beside the truth on hulls that are unstable on course: 0.71 and 0.93. A file that is too
# steady beside the truth, "better" by 14 and 11 % over whole runs: 1.00 and 1.00.
MAX_SOON_RATIO = 0.97
MIN_ASTRAY_RATIO = 2.0  # of place and of heading in one free run: chosen, not measured


@dataclass(frozen=True)
class Improvement:
    """The second vessel beside the first on one recording.

    errors  nrmse of the first and of the second
    ci95    of their ratio, over blocks of time; None where there are too few
    noise   both errors are no more than noise
    but     conditions in which the better one is worse, as people say them
    worse   channels in which it errs clearly more, as people say them
    unsure  the free runs are cut short, for errors of their start grow, and in the first half
            second of each, where they have not grown yet, the better one is hardly better
    astray  root mean square error of the place [m] in one free run of the better one, and of the
            other, where that of the better one is much larger, and that of its heading; else None
    """

    log: str
    first: str
    second: str
    errors: tuple[float, float]
    ci95: tuple[float, float] | None
    noise: bool
    but: tuple[str, ...]
    worse: tuple[str, ...] = ()
    unsure: bool = False
    astray: tuple[float, float] | None = None

    @property
    def ratio(self) -> float:
        """The error of the second over that of the first."""
        return self.errors[1] / max(self.errors[0], 1e-12)

    @property
    def clear(self) -> bool:
        """Whether the difference is more than chance."""
        return self._differ and not self.noise

    @property
    def _differ(self) -> bool:
        """Whether the two errors differ on the same blocks, large or small."""
        return self.ci95 is not None and (self.ci95[1] < 1.0 or self.ci95[0] > 1.0)

    @property
    def sentence(self) -> str:
        """What a person wants to know."""
        pair = f"{self.first} and {self.second} on {self.log}"
        if self.noise and not self._differ:
            return f"{pair}: both err by no more than noise, these data cannot tell which is better"
        if self.ci95 is None:  # a single block: however far apart they are, chance is not known
            errors = " and ".join(f"{error:.2f}" for error in self.errors)
            return f"{pair}: the errors are {errors}, from too little time to tell how sure that is"
        if not self._differ:
            return f"{pair}: no clear difference"
        better, worse = (self.second, self.first)[:: 1 if self.ratio < 1.0 else -1]
        falls = sorted(1.0 - r if self.ratio < 1.0 else 1.0 - 1.0 / r for r in self.ci95)
        fall = 1.0 - (self.ratio if self.ratio < 1.0 else 1.0 / self.ratio)
        if self.noise:  # which is in both alike: what is left of their difference is the models'
            return (
                f"{pair}: both err by no more than noise, {better} by {100 * fall:.0f} % less "
                f"({100 * falls[0]:.0f} to {100 * falls[1]:.0f} %)"
            )
        where = f"everywhere but at {', '.join(self.but)}" if self.but else "everywhere"
        more = f"; but it errs by more in {' and in '.join(self.worse)}" if self.worse else ""
        steady = (
            "; but hardly in the first half second of each run: an error of the start grows on "
            "this hull, and on one that is too steady it does not"
        )
        return (
            f"{better} is better than {worse} on {self.log}: the error falls by {100 * fall:.0f} % "
            f"({100 * falls[0]:.0f} to {100 * falls[1]:.0f} %), {where}{more}{steady * self.unsure}"
            f"{self._astray_text}"
        )

    @property
    def _astray_text(self) -> str:
        if self.astray is None:
            return ""
        own, other = (f"{metres:.2g} m" for metres in self.astray)
        return f"; but in one free run its place is off by {own}, that of the other by {other}"

    def to_dict(self) -> dict[str, Any]:
        """One entry of `improvements` in `shadow compare --json`."""
        interval = {} if self.ci95 is None else {"ratio_ci95": list(self.ci95)}
        return {
            "log": self.log, "first": self.first, "second": self.second, "ratio": self.ratio,
            **interval, "clear": self.clear, "but": list(self.but), "says": self.sentence,
            **({"errs_more_in": list(self.worse)} if self.worse else {}),
            **({"unsure": True} if self.unsure else {}),
            **({"place_of_free_run_m": list(self.astray)} if self.astray else {}),
        }  # fmt: skip


def improvements(found: Sequence[Comparison]) -> list[Improvement]:
    """Every further vessel of each recording beside the first one."""
    return [improvement(group[0], other) for group in by_trial(found) for other in group[1:]]


def by_trial(found: Sequence[Comparison]) -> list[list[Comparison]]:
    """Comparisons of one trial together. Two trials may have one name, but never one ruler."""
    groups: dict[tuple[str, int], list[Comparison]] = {}
    for one in found:
        groups.setdefault((one.log, id(one.ruler)), []).append(one)
    return list(groups.values())


def improvement(first: Comparison, second: Comparison) -> Improvement:
    """Two comparisons by one ruler."""
    better, worse = (second, first) if second.nrmse < first.nrmse else (first, second)
    floor = ADEQUATE_FLOORS * first.noise_floor_nrmse
    noise = not any(one.judgement is Judgement.WRONG for one in (first, second))
    but = () if noise else _exceptions(better, worse, floor)
    return Improvement(
        first.log, first.vessel, second.vessel, (first.nrmse, second.nrmse),
        _interval(first, second), noise, but, _channels_that_got_worse(better, worse),
        _is_unsure(better, worse), _astray(better, worse),
    )  # fmt: skip


def _astray(better: Comparison, worse: Comparison) -> tuple[float, float] | None:
    """Places of one free run each, where that of the better one of two goes much further astray:
    a hull that is unstable on course keeps her track only by the right numbers.
    """
    runs = [one.free_run for one in (better, worse)]
    if runs[1].diverged or len(runs[0].error) > len(runs[1].error):
        return None
    own, other = (run.scores.rmse for run in runs)
    places = [math.hypot(rmse["x"], rmse["y"]) for rmse in (own, other)]
    pairs = ((places[0], places[1]), (own["psi"], other["psi"]))
    if any(a < MIN_ASTRAY_RATIO * b for a, b in pairs):
        return None
    return places[0], places[1]


def _channels_that_got_worse(better: Comparison, worse: Comparison) -> tuple[str, ...]:
    """Velocities in which the better of two errs clearly more, and by more than noise."""
    out, noise = list[str](), better.ruler.noise
    for k, (name, (unit, factor)) in enumerate(zip(CHANNEL_NAMES, CHANNEL_UNITS, strict=True)):
        after, before = (float(one.scores.rmse["uvr"[k]]) for one in (better, worse))
        if after > MIN_WORSE_RATIO * max(before, float(noise[k])):
            out.append(f"{name} ({before * factor:.2g} → {after * factor:.2g} {unit})")
    return tuple(out)


def _is_unsure(better: Comparison, worse: Comparison) -> bool:
    """Whether starts whose errors grow may be all that makes one of two better."""
    if not better.cut_text:
        return False
    longest = int(better.ruler.segments.steps.max())  # rows of `horizon_s`
    soon = _interval(worse, better, max(round(longest * SOON_S / better.horizon_s), 1))
    return soon is None or soon[1] >= MAX_SOON_RATIO


def _interval(
    first: Comparison, second: Comparison, most: int | None = None
) -> tuple[float, float] | None:
    """95 % of the ratio of the two errors, blocks of time drawn anew; None below two blocks.

    `most`: of so many rows at the beginning of each free run.
    """
    sums = [_block_means(one, most) for one in (first, second)]
    both = np.isfinite(sums[0]) & np.isfinite(sums[1])
    n = int(both.sum())
    if n < 2:
        return None
    draw = np.random.default_rng(first.ruler.settings.seed).integers(0, n, (BOOTSTRAP_DRAWS, n))
    a, b = (part[both][draw].sum(axis=1) for part in sums)
    low, high = np.quantile(np.sqrt(b / np.maximum(a, 1e-300)), [0.025, 0.975])
    return float(low), float(high)


def _block_means(one: Comparison, most: int | None) -> Floats:
    """Sum of squared scaled errors of each block of the ruler; NaN where nothing was predicted."""
    segment, _, error = one.prediction.predicted_rows(most)
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
