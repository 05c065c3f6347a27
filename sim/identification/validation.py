"""A vessel before and after on time that the fit did not see, under one ruler.

Is a channel predicted at all? A free run must beat saying "zero" on a recording it never saw.

    told on a recording:   RMSE(measured − model) < 0.9 · RMS(measured)

A parameter may fit what it was shown and still say nothing of another day. A channel that no
validation recording confirms is called not identifiable from these data, whatever its intervals.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.prediction.free_runs import FreeRun, free_run, predict
from sim.prediction.inputs import measured_motion
from sim.prediction.scales import MIN_SCALES, Ruler
from sim.prediction.scores import Scores, nrmse, scores
from sim.prediction.segments import GUARD_S, blocks
from sim.trial import Trial

EVERY = 4  # each fourth block is held out
LEAST = 4  # blocks


@dataclass(frozen=True)
class ModelErrors:
    """One vessel on one trial: errors of predictions over the horizon, and of one free run."""

    scores: Scores
    nrmse: float
    free_run: FreeRun | None

    def to_dict(self) -> dict[str, Any]:
        """Scores by channel."""
        out: dict[str, Any] = {
            "nrmse": self.nrmse, "rmse": dict(self.scores.rmse), "mae": dict(self.scores.mae),
            "r2": dict(self.scores.r2), "fit_percent": dict(self.scores.fit_percent),
        }  # fmt: skip
        return out if self.free_run is None else out | {"free_run": self.free_run.to_dict()}


@dataclass(frozen=True)
class Validation:
    """Before and after, and what it was measured on."""

    name: str
    seconds: float
    noise_floor_nrmse: float
    before: ModelErrors
    after: ModelErrors

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "on": self.name, "seconds": self.seconds, "noise_floor_nrmse": self.noise_floor_nrmse,
            "before": self.before.to_dict(), "after": self.after.to_dict(),
        }  # fmt: skip


def held_out(trial: Trial) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    """Rows to fit and rows to judge by, a guard between them; None on a trial too short."""
    cut = blocks(trial.usable, trial.dt)
    if len(cut) < LEAST:
        return None
    fit, judge = trial.usable.copy(), np.zeros(len(trial), np.bool_)
    gap = int(np.ceil(GUARD_S / trial.dt))
    for block in cut[EVERY // 2 :: EVERY]:
        judge[block.start : block.stop] = trial.usable[block.start : block.stop]
        fit[max(block.start - gap, 0) : block.stop + gap] = False
    return fit, judge


def validate(
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


def _validated(trial: Trial, model: Model, ruler: Ruler, alone: bool, later: float) -> ModelErrors:
    _, rows, error = predict(trial, model, ruler, later).predicted_rows()
    return ModelErrors(
        scores(measured_motion(trial)[rows, :6], error),
        nrmse(error, ruler.scales),
        free_run(trial, model, ruler.scales, later) if alone else None,
    )


def with_usable_rows(trial: Trial, rows: NDArray[np.bool_]) -> Trial:
    """The same trial with other rows usable."""
    return replace(trial, usable=trial.usable & rows)


ENOUGH = 0.9  # of what predicting zero leaves
OWN = {"u": "m11, X_u and X_uu", "v": "m22, Y_v and Y_vv", "r": "m33, N_r and N_rr"}
CHANNELS = {"u": ("surge", "m/s", 3), "v": ("sway", "m/s", 4), "r": ("yaw rate", "rad/s", 5)}


def errors(run: FreeRun, channel: str) -> tuple[float, float]:
    """RMSE of a free run on a channel, and that of predicting zero."""
    column = CHANNELS[channel][2]
    measured = run.model[:, column] + run.error[:, column]
    return float(np.sqrt(np.mean(run.error[:, column] ** 2))), float(np.sqrt(np.mean(measured**2)))


def is_confirmed(run: FreeRun, channel: str) -> bool | None:
    """Better than zero by a tenth; None: it hardly moved."""
    if run.diverged or not len(run.error):
        return False
    model, zero = errors(run, channel)
    return None if zero < 0.5 * MIN_SCALES[CHANNELS[channel][2] - 3] else model < ENOUGH * zero


def unconfirmed_channels(validation: Sequence[Validation]) -> tuple[str, ...]:
    """A sentence for each channel that no recording confirms; none without a free run."""
    runs = [v.after.free_run for v in validation]
    said = []
    for channel, (name, unit, _) in CHANNELS.items():
        verdicts = [(run, is_confirmed(run, channel)) for run in runs if run is not None]
        verdicts = [(run, verdict) for run, verdict in verdicts if verdict is not None]
        if verdicts and not any(verdict for _, verdict in verdicts):
            how = _how([run for run, _ in verdicts], channel, unit)
            said.append(f"{name} is {how}: {OWN[channel]} mean nothing beyond the runs fitted")
    return tuple(said)


def _how(runs: Sequence[FreeRun], channel: str, unit: str) -> str:
    whole = [errors(run, channel) for run in runs if len(run.error) and not run.diverged]
    figures = ", ".join(f"{model:.3f} against {zero:.3f} {unit}" for model, zero in whole)
    return (
        "not identifiable from these data: on recordings that the fit did not see the model is no "
        f"better than predicting zero ({figures or 'its free runs leave the track'})"
    )
