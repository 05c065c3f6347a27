"""Free runs of a model over recorded commands, and their error: measured − model.

Many runs, one from every segment's start (`predict`), or one over the longest usable stretch of a
trial (`free_run`, the paper's Table 6).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.prediction.inputs import commands_around, input_table, measured_motion, runs_from
from sim.prediction.scales import Ruler
from sim.prediction.scores import Scores, nrmse, scores
from sim.prediction.segments import CompareSettings, longest_stretch
from sim.state import Eta, Floats, Ints, wrap
from sim.trial import Trial

# Largest error that counts, in scales of u, v, r: a run beyond it has diverged. Chosen, not
# measured.
LARGEST_SCALED_ERROR = 100.0
LARGEST_POSE_ERROR = (1e4, 1e4, np.pi)  # the same of the pose [m, m, rad]


class DivergedError(ValueError):
    """A model that no prediction can be made with."""


@dataclass(frozen=True)
class Prediction:
    """Motion in many free runs, and how far the boat was from it.

    rows      (S,)        row of the trial where the run starts
    steps     (S,)        its length
    model     (S, H+1, 6) eta, nu as the vessel's sensors would report them; NaN past the end
    error     (S, H+1, 6) measured − model, yaw in [−π, π); NaN past the end
    diverged  (S,)        the run diverged: its error is held at the largest that counts
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


def predict(trial: Trial, model: Model, ruler: Ruler, command_offset: float = 0.0) -> Prediction:
    """One batched call from all segments' starts on the recorded commands, voltage and wind.

    Commands act `command_offset` [s] later than recorded. DivergedError where no run lasts a step.
    """
    rows, steps = ruler.segments.rows, ruler.segments.steps
    reported = free_reports(trial, model, rows, steps, command_offset)[..., :6]
    error = prediction_error(measured_motion(trial)[:, :6], rows, reported)
    within = np.arange(error.shape[1]) <= steps[:, None]
    largest = np.concatenate([LARGEST_POSE_ERROR, LARGEST_SCALED_ERROR * ruler.scales])
    lost = np.asarray(within & ~np.all(np.abs(error) <= largest, axis=2), np.bool_)
    # a run that has ended has the largest error there is
    ended = np.asarray(~np.all(np.isfinite(error), axis=2), np.bool_)
    counted = np.where(ended[..., None], largest, np.clip(error, -largest, largest))
    if len(rows) and ended[:, 1].all():
        raise _diverged(model)
    return Prediction(
        rows,
        steps,
        reported,
        np.where(within[..., None], counted, np.nan),
        np.asarray(lost.any(axis=1), np.bool_),
    )


def shared_ruler(
    trial: Trial, models: Sequence[Model], settings: CompareSettings | None = None
) -> Ruler:
    """One for several vessels in whatever order: that of the one which predicts best by its own.

    An error of the start fades on one vessel and grows on another: horizons and noise floor depend
    on whose growth is taken, and the best vessel's comes nearest to the boat's.
    """
    rulers = [Ruler.of(trial, model, settings) for model in models]
    if len(rulers) == 1:
        return rulers[0]
    own = [_own_error(trial, *pair) for pair in zip(models, rulers, strict=True)]
    return rulers[own.index(min(own))]


def _own_error(trial: Trial, model: Model, ruler: Ruler) -> tuple[float, float]:
    """nrmse of a model by its ruler, infinite where it has none, then the ruler's noise floor."""
    try:
        error = nrmse(predict(trial, model, ruler).predicted_rows()[2], ruler.scales)
    except DivergedError:
        error = np.inf
    return error, ruler.noise_floor


def free_reports(
    trial: Trial, model: Model, rows: Ints, steps: Ints, command_offset: float = 0.0
) -> Floats:
    """Free runs from the measured state at rows (S,) -> reports (S, H+1, 9), NaN past the end."""
    start = model.true_states(measured_motion(trial)[rows])
    x0 = np.hstack([start, memory_at(model, trial, rows)])
    return model.run(x0, runs_from(rows, steps, command_offset), input_table(model, trial))[1]


def prediction_error(measured: Floats, rows: Ints, model: Floats) -> Floats:
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
    before, _ = commands_around(model, trial)
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
    """One free run from row `start` over as many rows as it stayed within reach.

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
        """Scores by channel; `diverged` is there only where it is so."""
        out: dict[str, Any] = self.scores.to_dict()
        del out["fit_percent"]
        return out | {"diverged": True} if self.diverged else out


def free_run(trial: Trial, model: Model, scales: Floats, command_offset: float = 0.0) -> FreeRun:
    """One free run over the longest usable stretch, at most until it diverges."""
    stretch = longest_stretch(trial)
    rows, steps = np.array([stretch.start]), np.array([len(stretch) - 1])
    reported = free_reports(trial, model, rows, steps, command_offset)[0, :, :6]
    motion = measured_motion(trial)[:, :6]
    error = prediction_error(motion, rows, reported[None])[0]
    near = np.all(np.abs(error[:, 3:]) <= LARGEST_SCALED_ERROR * scales, axis=1)
    lost = ~near | ~np.isfinite(error).all(axis=1)
    end = int(np.argmax(lost)) if lost.any() else len(error)
    if end == 0:
        raise _diverged(model)
    measured = motion[stretch.start : stretch.start + end]
    return FreeRun(
        stretch.start, reported[:end], error[:end], bool(lost.any()), scores(measured, error[:end])
    )


def _diverged(model: Model) -> DivergedError:
    return DivergedError(
        f"{model.vessel.name} diverges at once from every start: check its numbers"
    )
