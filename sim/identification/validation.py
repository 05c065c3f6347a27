"""A vessel before and after a fit, on time that the fit did not see, with the same ruler.

A channel is confirmed on a recording where a free run of the model beats the prediction "zero":

    RMSE(measured − model) < 0.9 · RMS(measured)

A parameter may fit the data that it came from and be wrong on another day. A channel that no
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
from sim.prediction.segments import GUARD_S, time_blocks
from sim.trial import Trial

# Chosen, not measured:
HELD_OUT_EVERY = 4  # each fourth block is held out
MIN_BLOCKS = 4
CONFIRMED_SHARE = 0.9  # of the error of predicting zero
AT_REST_SHARE = 0.5  # of the smallest scale: a channel that moves less confirms nothing
CHANNELS = {
    "u": ("surge", "m/s", 3, "m11, X_u and X_uu"),
    "v": ("sway", "m/s", 4, "m22, Y_v and Y_vv"),
    "r": ("yaw rate", "rad/s", 5, "m33, N_r and N_rr"),
}  # name, unit, column of (eta, nu), and the channel's own parameters


@dataclass(frozen=True)
class ModelErrors:
    """One vessel on one trial: errors of predictions over the horizon, and of one free run."""

    scores: Scores
    nrmse: float
    free_run: FreeRun | None

    def to_dict(self) -> dict[str, Any]:
        """Scores by channel."""
        out: dict[str, Any] = {"nrmse": self.nrmse, **self.scores.to_dict()}
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
    """Rows to fit and rows to validate on, a guard between; None on a trial too short."""
    blocks = time_blocks(trial.usable, trial.dt)
    if len(blocks) < MIN_BLOCKS:
        return None
    fit, validation = trial.usable.copy(), np.zeros(len(trial), np.bool_)
    gap = int(np.ceil(GUARD_S / trial.dt))
    for block in blocks[HELD_OUT_EVERY // 2 :: HELD_OUT_EVERY]:
        validation[block.start : block.stop] = trial.usable[block.start : block.stop]
        fit[max(block.start - gap, 0) : block.stop + gap] = False
    return fit, validation


def validate(
    trial: Trial,
    before: Model,
    after: Model,
    command_offset: float,
    rows: NDArray[np.bool_] | None = None,
) -> Validation:
    """Both models on the usable rows, or on the held-out `rows` of them, then without a free run.

    By how much `command_offset` [s] commands act later than recorded is a property of the
    recording, and no merit of either model: both are given it.
    """
    name = trial.name if rows is None else f"{trial.name}, blocks held out"
    trial = trial if rows is None else replace(trial, usable=trial.usable & rows)
    ruler = Ruler.of(trial, before)
    errors = []
    for model in (before, after):
        _, at, error = predict(trial, model, ruler, command_offset).predicted_rows()
        free = free_run(trial, model, ruler.scales, command_offset) if rows is None else None
        measured = measured_motion(trial)[at, :6]
        errors.append(ModelErrors(scores(measured, error), nrmse(error, ruler.scales), free))
    return Validation(name, float(trial.usable.sum()) * trial.dt, ruler.noise_floor, *errors)


def free_run_errors(run: FreeRun, channel: str) -> tuple[float, float]:
    """RMSE of a free run on a channel, and that of predicting zero."""
    error = run.error[:, CHANNELS[channel][2]]
    measured = run.model[:, CHANNELS[channel][2]] + error
    return float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean(measured**2)))


def is_confirmed(run: FreeRun, channel: str) -> bool | None:
    """Better than zero by a tenth; None: it hardly moved."""
    if run.diverged:
        return False
    model, zero = free_run_errors(run, channel)
    at_rest = zero < AT_REST_SHARE * MIN_SCALES[CHANNELS[channel][2] - 3]
    return None if at_rest else model < CONFIRMED_SHARE * zero


def unconfirmed_channels(validation: Sequence[Validation]) -> tuple[str, ...]:
    """A sentence for each channel that no recording confirms; none without a free run."""
    runs = [v.after.free_run for v in validation if v.after.free_run is not None]
    out = []
    for channel, (name, unit, _, parameters) in CHANNELS.items():
        confirmed = [(run, is_confirmed(run, channel)) for run in runs]
        moved = [run for run, sure in confirmed if sure is not None]
        if moved and not any(sure for _, sure in confirmed):
            pairs = [free_run_errors(run, channel) for run in moved if not run.diverged]
            figures = ", ".join(f"{model:.3f} against {zero:.3f} {unit}" for model, zero in pairs)
            out.append(
                f"{name} is not identifiable from these data: on recordings that the fit did not "
                "see the model is no better than predicting zero "
                f"({figures or 'its free runs leave the track'}): "
                f"{parameters} mean nothing beyond the runs fitted"
            )
    return tuple(out)
