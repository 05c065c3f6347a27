"""The error of a vessel on held-out time, in the numbers that `compare` prints.

Free runs of 10 s under the ruler of the vessel as it was given: segments, scales and horizons are
the same for every step of a ladder. Each block of time is predicted with the numbers of the fit
that did not see it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.diagnosis.fit import Fit
from sim.diagnosis.interval import nrmse_interval
from sim.diagnosis.prediction import predict
from sim.diagnosis.ruler import Ruler
from sim.diagnosis.scores import scaled_squares
from sim.diagnosis.segments import NoUsableTimeError
from sim.diagnosis.settings import CompareSettings
from sim.model import Model
from sim.state import Floats, Ints
from sim.trial import Trial


@dataclass(frozen=True)
class HeldOut:
    """nrmse with its 95 % interval (None on a single block)."""

    nrmse: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class Judge:
    """The rulers of all trials, from the vessel as it was given."""

    trials: tuple[Trial, ...]
    rulers: tuple[Ruler | None, ...]

    @classmethod
    def of(cls, trials: Sequence[Trial], first: Model) -> "Judge":
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
            mine = ruler if fold is None else ruler.only(fold[ruler.segments.rows] == k)
            if not len(mine.segments.rows):
                continue
            segment, _, error = predict(self.trials[trial], model, mine).along()
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
