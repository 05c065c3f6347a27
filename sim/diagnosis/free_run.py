"""One free run over the longest usable stretch of a trial (the paper's Table 6)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.diagnosis.blocks import stretches
from sim.diagnosis.inputs import inputs_of, motion_of, runs_from
from sim.diagnosis.prediction import WORST, error_of, memory_at
from sim.diagnosis.scores import Scores, scores
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial


@dataclass(frozen=True)
class FreeRun:
    """The model left alone: from `start` (row) over as many rows as it stayed within reach.

    model     (R, 6)  eta, nu as reported
    error     (R, 6)  measured − model
    diverged  it left the track (an unstable hull does): the rows end, and the scores stop, there
    """

    start: int
    model: Floats
    error: Floats
    diverged: bool
    scores: Scores

    def as_dict(self) -> dict[str, Any]:
        """Scores by channel; `diverged` stands there only where it is so."""
        out: dict[str, Any] = {
            "rmse": dict(self.scores.rmse), "mae": dict(self.scores.mae), "r2": dict(self.scores.r2)
        }  # fmt: skip
        return out | {"diverged": True} if self.diverged else out


def free_run(trial: Trial, model: Model, scales: Floats, later: float = 0.0) -> FreeRun:
    """From the first sample of the longest usable stretch to its end; `later` as in `predict`."""
    stretch = max(stretches(trial.usable), key=len)
    rows = np.array([stretch.start])
    motion = motion_of(trial)
    x0 = np.hstack([model.true_states(motion[rows]), memory_at(model, trial, rows)])
    runs = runs_from(rows, np.array([len(stretch) - 1]), later)
    _, reports = model.run(x0, runs, inputs_of(model, trial))
    said = reports[0, :, :6]
    error = error_of(motion[:, :6], rows, said[None])[0]
    lost = ~np.all(np.abs(error[:, 3:]) <= WORST * scales, axis=1) | ~np.isfinite(error).all(axis=1)
    end = int(np.argmax(lost)) if lost.any() else len(error)
    measured = motion[stretch.start : stretch.start + end, :6]
    return FreeRun(
        stretch.start, said[:end], error[:end], bool(lost.any()), scores(measured, error[:end])
    )
