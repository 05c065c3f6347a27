"""What a fit is worth on blocks of time that it did not see.

Each fourth block is held out in turn, 5 s to either side of it with it. The fit without them is
one damped Gauss–Newton step from the fit with them; the model then really runs over the blocks. A
gain is a ratio of squared errors per block: thousands of samples make everything significant, so
what counts is how large it is, and how alike from block to block.

The error of a vessel on held-out time, in the numbers that `compare` prints.

Free runs of 10 s under the ruler of the vessel as it was given: segments, scales and horizons are
the same for every step of a ladder. Each block of time is predicted with the numbers of the fit
that did not see it.

How probable each explanation is: stacking of held-out blocks, drawn again and again.

    w = E over π of softmax( ln p + G Σ_b π_b s_b ),     π ~ Dirichlet(1, …, 1),     s_b = −½ Σ e²

s_b is the held-out log score of block b. Drawing blocks anew (pseudo-BMA+: Yao, Vehtari, Simpson
and Gelman, Bayesian Analysis 13, 2018) keeps one lucky block from deciding. Errors within a block
hang together more than the whitening says: `RELIEF` is how many rows count as one.

p is what was believed before. The best of thirty effects, each from several starts, wins a little
where nothing is missing (up to 5 nats on the tuning set's complete models, where effects that are
there win 16 and more): an effect has to win `DOUBT` to be as probable as that nothing is missing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis.fit import Fit
from sim.diagnosis.thresholds import RELIEF
from sim.model import Model
from sim.prediction.free_runs import predict
from sim.prediction.scales import Ruler
from sim.prediction.scores import nrmse_interval, scaled_squares
from sim.prediction.segments import CompareSettings, NoUsableTimeError
from sim.state import Floats, Ints
from sim.trial import Trial

CLIP = 6.0  # standard deviations: no single row decides a block
FEWEST = 4  # blocks that a t value means anything over


class Gain(NamedTuple):
    """Of one fit over another, on held-out time.

    ratio   of the squared errors, before / after
    log     mean over the blocks of the log of that ratio
    t       of that mean
    nats    of log likelihood, as if `RELIEF` rows were one
    lost    of the nats, per nat won in other blocks
    """

    ratio: float
    log: float
    t: float
    nats: float
    lost: float


def unseen(fit: Fit) -> Floats:
    """Residuals (N,) of each block as a fit without it leaves them."""
    out = fit.residual.copy()
    for k, (_, judge) in enumerate(fit.ground.folds()):
        out[judge] = fit.refits.residual[k, judge]
    return out


def per_block(residual: Floats, block: NDArray[np.int64]) -> Floats:
    """Sum of squares of each block (G,), no row beyond its clip."""
    return np.asarray(np.bincount(block, np.clip(residual, -CLIP, CLIP) ** 2), np.float64)


def gain(before: Floats, after: Floats, block: NDArray[np.int64]) -> Gain:
    """Residuals (N,) of two fits -> what the second is worth."""
    a, b = per_block(before, block), per_block(after, block)
    log = np.log(np.maximum(a, 1e-9) / np.maximum(b, 1e-9))
    spread = float(log.std(ddof=1)) if len(log) >= FEWEST else np.inf
    t = float(log.mean() / max(spread / np.sqrt(len(log)), 1e-9))
    won = 0.5 * (a - b) / RELIEF
    up, down = float(np.maximum(won, 0.0).sum()), float(np.maximum(-won, 0.0).sum())
    return Gain(float(a.sum() / b.sum()), float(log.mean()), t, up - down, down / max(up, 1e-9))


@dataclass(frozen=True)
class HeldOut:
    """nrmse with its 95 % interval (None on a single block)."""

    nrmse: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class HeldOutScorer:
    """The rulers of all trials, from the vessel as it was given."""

    trials: tuple[Trial, ...]
    rulers: tuple[Ruler | None, ...]

    @classmethod
    def of(cls, trials: Sequence[Trial], first: Model) -> "HeldOutScorer":
        """A trial without a stretch to compare over has no ruler and no say."""
        return cls(tuple(trials), tuple(_ruler(t, first) for t in trials))

    @property
    def floor(self) -> float:
        """nrmse that a perfect model would show."""
        squares = [r.noise_floor**2 for r in self.rulers if r is not None]
        return float(np.sqrt(np.mean(squares))) if squares else 0.0

    def plain(self, model: Model) -> HeldOut:
        """A vessel that was not fitted: all of its time is held out."""
        return _pooled([self._squares(i, [model]) for i in range(len(self.trials))])

    def fitted(self, fit: Fit) -> HeldOut:
        """A fit, each block by the fit without it."""
        model = fit.unknowns.model
        return _pooled([
            self._squares(
                i, [replace(model, theta=theta) for theta in fit.unknowns.theta(fit.refits.z, i)],
                fit.ground.fold_at(i, self.trials[i].time),
            )
            for i in range(len(self.trials))
        ])  # fmt: skip

    def _squares(
        self, trial: int, models: Sequence[Model], fold: Ints | None = None
    ) -> tuple[Floats, Floats]:
        """Scaled squared errors (M,) and a label of the block of each (M,)."""
        ruler = self.rulers[trial]
        if ruler is None:
            return np.zeros(0), np.zeros(0)
        squares, labels = [], []
        for k, model in enumerate(models):
            mine = ruler if fold is None else ruler.subset(fold[ruler.segments.rows] == k)
            if not len(mine.segments.rows):
                continue
            segment, _, error = predict(self.trials[trial], model, mine).predicted_rows()
            squares.append(scaled_squares(error, ruler.scales))
            labels.append(1e6 * trial + mine.blocks[segment])
        return np.concatenate(squares), np.concatenate(labels)


def _ruler(trial: Trial, first: Model) -> Ruler | None:
    try:
        return Ruler.of(trial, first, CompareSettings())
    except NoUsableTimeError:
        return None


def _pooled(parts: Sequence[tuple[Floats, Floats]]) -> HeldOut:
    squares = np.concatenate([s for s, _ in parts])
    labels = np.unique(np.concatenate([b for _, b in parts]), return_inverse=True)[1]
    return HeldOut(float(np.sqrt(squares.mean())), nrmse_interval(squares, labels, 1))


DRAWS = 1000
DOUBT = 8.0  # nats


def probabilities(blocks: Floats, seed: int = 1) -> Floats:
    """Held-out squared errors (M, G) by block, nothing added first -> probabilities (M,)."""
    score = -0.5 * blocks / RELIEF
    count = blocks.shape[1]
    draw = np.random.default_rng(seed).dirichlet(np.ones(count), DRAWS)
    total = count * draw @ score.T
    total[:, 1:] -= DOUBT
    total -= total.max(axis=1, keepdims=True)
    weight = np.exp(total)
    return np.asarray((weight / weight.sum(axis=1, keepdims=True)).mean(axis=0))
