"""A vessel before and after on time that the fit did not see, under one ruler."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.diagnosis.blocks import GUARD, blocks
from sim.diagnosis.free_run import FreeRun, free_run
from sim.diagnosis.inputs import motion_of
from sim.diagnosis.prediction import predict
from sim.diagnosis.ruler import Ruler
from sim.diagnosis.scores import Scores, nrmse, scores
from sim.model import Model
from sim.trial import Trial

EVERY = 4  # each fourth block is held out
LENGTH = 25.0  # s
LEAST = 4  # blocks


@dataclass(frozen=True)
class Validated:
    """One vessel on one trial: errors of predictions over the horizon, and of one free run."""

    scores: Scores
    nrmse: float
    free_run: FreeRun | None

    def as_dict(self) -> dict[str, Any]:
        """Scores by channel."""
        out: dict[str, Any] = {
            "nrmse": self.nrmse, "rmse": dict(self.scores.rmse), "mae": dict(self.scores.mae),
            "r2": dict(self.scores.r2), "fit_percent": dict(self.scores.fit_percent),
        }  # fmt: skip
        return out if self.free_run is None else out | {"free_run": self.free_run.as_dict()}


@dataclass(frozen=True)
class Validation:
    """Before and after, and what it was measured on."""

    name: str
    seconds: float
    noise_floor_nrmse: float
    before: Validated
    after: Validated

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "on": self.name, "seconds": self.seconds, "noise_floor_nrmse": self.noise_floor_nrmse,
            "before": self.before.as_dict(), "after": self.after.as_dict(),
        }  # fmt: skip


def held_out(trial: Trial) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Rows to fit and rows to judge by, a guard between them; None on a trial too short."""
    cut = blocks(trial.usable, trial.dt, LENGTH)
    if len(cut) < LEAST:
        return None
    fit, judge = trial.usable.copy(), np.zeros(len(trial), np.bool_)
    gap = int(np.ceil(GUARD / trial.dt))
    for block in cut[EVERY // 2 :: EVERY]:
        judge[block.start : block.stop] = trial.usable[block.start : block.stop]
        fit[max(block.start - gap, 0) : block.stop + gap] = False
    return fit, judge


def validated(
    trial: Trial, before: Model, after: Model, name: str, alone: bool = True, later: float = 0.0
) -> Validation:
    """Both models on the usable rows; `alone`: with a free run from the first sample too.

    How much `later` [s] commands act than they are told is how the recording was made, and no merit
    of either model: both are told.
    """
    ruler = Ruler.of(trial, before)
    both = [_validated(trial, model, ruler, alone, later) for model in (before, after)]
    seconds = float(trial.usable.sum()) * trial.dt
    return Validation(name, seconds, ruler.noise_floor, both[0], both[1])


def _validated(trial: Trial, model: Model, ruler: Ruler, alone: bool, later: float) -> Validated:
    _, rows, error = predict(trial, model, ruler, later).along()
    return Validated(
        scores(motion_of(trial)[rows, :6], error),
        nrmse(error, ruler.scales),
        free_run(trial, model, ruler.scales, later) if alone else None,
    )


def judged_on(trial: Trial, rows: NDArray[np.bool_]) -> Trial:
    """The same trial with other rows usable."""
    return replace(trial, usable=trial.usable & rows)
