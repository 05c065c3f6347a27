"""Free runs from every segment's start, and their error: measured − model.

One free run over the longest usable stretch of a trial (the paper's Table 6).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.prediction.inputs import (
    delayed_commands,
    input_table,
    measured_motion,
    runs_from,
    vessel_commands,
)
from sim.prediction.scales import Ruler
from sim.prediction.scores import Scores, scores
from sim.prediction.segments import usable_stretches
from sim.state import Eta, Floats, Ints, wrap
from sim.trial import Trial

WORST = 100.0  # scales (or 10 km): an error beyond this is a run that left the track


class DivergedError(ValueError):
    """A model that no prediction can be made with."""


@dataclass(frozen=True)
class Prediction:
    """Motion in many free runs, and how far the boat was from it.

    rows      (S,)        row of the trial where the run starts
    steps     (S,)        its length
    model     (S, H+1, 6) eta, nu as the vessel's sensors would report them; NaN past the end
    error     (S, H+1, 6) measured − model, yaw in [−π, π); NaN past the end
    diverged  (S,)        the run left the track: its error was held at the largest that counts
    """

    rows: Ints
    steps: Ints
    model: Floats
    error: Floats
    diverged: NDArray[np.bool_]

    def predicted_rows(self) -> tuple[Ints, Ints, Floats]:
        """Segment (M,), row of the trial (M,) and error (M, 6) of every predicted row."""
        after = np.arange(1, self.error.shape[1])
        segment, j = np.nonzero(after <= self.steps[:, None])
        return segment, self.rows[segment] + after[j], self.error[segment, after[j]]


def predict(trial: Trial, model: Model, ruler: Ruler, later: float = 0.0) -> Prediction:
    """One batched call from all segments' starts on the recorded commands, voltage and wind.

    Commands act `later` [s] than the trial tells them.
    """
    rows, steps = ruler.segments.rows, ruler.segments.steps
    motion = measured_motion(trial)
    x0 = np.hstack([model.true_states(motion[rows]), memory_at(model, trial, rows)])
    _, reports = model.run(x0, runs_from(rows, steps, later), input_table(model, trial))
    said = reports[..., :6]
    error = error_of(motion[:, :6], rows, said)
    within = np.arange(error.shape[1]) <= steps[:, None]
    largest = np.concatenate([[1e4, 1e4, np.pi], WORST * ruler.scales])
    lost = np.asarray(within & ~np.all(np.abs(error) <= largest, axis=2), np.bool_)
    # a run that has ended: no error is larger
    gone = np.asarray(~np.all(np.isfinite(error), axis=2), np.bool_)
    held = np.where(gone[..., None], largest, np.clip(error, -largest, largest))
    if len(rows) and gone[:, 1].all():
        raise DivergedError(
            f"{model.vessel.name} diverges at once from every start: check its numbers"
        )
    return Prediction(
        rows,
        steps,
        said,
        np.where(within[..., None], held, np.nan),
        np.asarray(lost.any(axis=1), np.bool_),
    )


def error_of(measured: Floats, rows: Ints, model: Floats) -> Floats:
    """Measured (T, 6), first rows (S,), model (S, H+1, 6) -> measured − model, SI."""
    at = np.minimum(rows[:, None] + np.arange(model.shape[1]), len(measured) - 1)
    error = measured[at] - model
    error[..., Eta.YAW] = wrap(error[..., Eta.YAW])
    return error


def memory_at(model: Model, trial: Trial, rows: Ints) -> Floats:
    """Memory of actuators and effects at rows (S,), run along the measured motion: (S, nx − 6)."""
    memory = np.full((len(rows), model.state_size - 6), np.nan)
    if memory.shape[1] == 0:
        return memory
    commands = delayed_commands(vessel_commands(model, trial), trial.dt, model.delay)
    before = np.vstack([commands[:1], commands[:-1]])
    motion, carry, done = measured_motion(trial), model.initial_carry(), 0
    for i in np.argsort(rows):
        part = slice(done, int(rows[i]) + 1)
        if part.stop > part.start:
            model.missing_force(
                motion[part], trial.time[part], before[part], before[part],
                voltage=trial.voltage[part], wind=trial.wind[part], carry=carry,
            )  # fmt: skip
            done = part.stop
        memory[i] = carry[6:-1]
    return memory


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

    def to_dict(self) -> dict[str, Any]:
        """Scores by channel; `diverged` stands there only where it is so."""
        out: dict[str, Any] = {
            "rmse": dict(self.scores.rmse), "mae": dict(self.scores.mae), "r2": dict(self.scores.r2)
        }  # fmt: skip
        return out | {"diverged": True} if self.diverged else out


def free_run(trial: Trial, model: Model, scales: Floats, later: float = 0.0) -> FreeRun:
    """From the first sample of the longest usable stretch to its end; `later` as in `predict`."""
    stretch = max(usable_stretches(trial.usable), key=len)
    rows = np.array([stretch.start])
    motion = measured_motion(trial)
    x0 = np.hstack([model.true_states(motion[rows]), memory_at(model, trial, rows)])
    runs = runs_from(rows, np.array([len(stretch) - 1]), later)
    _, reports = model.run(x0, runs, input_table(model, trial))
    said = reports[0, :, :6]
    error = error_of(motion[:, :6], rows, said[None])[0]
    lost = ~np.all(np.abs(error[:, 3:]) <= WORST * scales, axis=1) | ~np.isfinite(error).all(axis=1)
    end = int(np.argmax(lost)) if lost.any() else len(error)
    measured = motion[stretch.start : stretch.start + end, :6]
    return FreeRun(
        stretch.start, said[:end], error[:end], bool(lost.any()), scores(measured, error[:end])
    )
