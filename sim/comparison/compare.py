"""How far each model is from the measurement, beside the noise floor, and in which regimes."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from sim.comparison.independence import Independence, independence
from sim.comparison.regimes import Regime, regimes_of
from sim.comparison.where import Bin, ErrorMap, Place, error_bins, error_map, worst_place
from sim.model import Model
from sim.prediction.free_runs import FreeRun, Prediction, free_run, predict, shared_ruler
from sim.prediction.inputs import measured_motion
from sim.prediction.missing_force import MissingForce, missing_force
from sim.prediction.scales import Ruler
from sim.prediction.scores import Scores, nrmse, nrmse_interval, scaled_squares, scores
from sim.prediction.segments import CompareSettings
from sim.trial import Trial, data_frame

ADEQUATE_FLOORS = 1.2  # noise floors: an nrmse below is no failure; chosen, not measured
MAX_JUDGING_FLOOR = 0.5  # noise floors: beyond it noise hides the motion; chosen, not measured
MIN_EXCESS = 0.02  # share of the squared error beyond the share of time, to be named; chosen


class Judgement(StrEnum):
    """What an error beside its noise floor says of a model."""

    ADEQUATE = "adequate"
    WRONG = "wrong"
    UNJUDGED = "unjudged"


def judge(error: float, floor: float) -> Judgement:
    """An nrmse beside the nrmse of noise alone; where noise hides the motion, neither is said."""
    if not (math.isfinite(error) and math.isfinite(floor)):
        return Judgement.UNJUDGED
    if error > ADEQUATE_FLOORS * floor:
        return Judgement.WRONG
    return Judgement.ADEQUATE if floor <= MAX_JUDGING_FLOOR else Judgement.UNJUDGED


@dataclass(frozen=True)
class Comparison:
    """One trial and one vessel under the ruler of their comparison.

    seconds     usable time of the trial
    nrmse_ci95  from blocks of time; None on a trial of a single block
    independence  of errors over one step from the commands; None where that was not asked
                  or the trial is too short
    notices     what looks wrong with the recording or the vessel's channels, a sentence each
    where       all bins, those with the most error beyond their share of time first
    refit       parameters of the voyage, for either fold of the blocks from the other
    """

    log: str
    vessel: str
    seconds: float
    ruler: Ruler
    scores: Scores
    nrmse: float
    nrmse_ci95: tuple[float, float] | None
    noise_floor_nrmse: float
    free_run: FreeRun
    where: tuple[Bin, ...]
    error_map: ErrorMap
    prediction: Prediction
    missing: MissingForce
    notices: tuple[str, ...] = ()
    independence: Independence | None = None
    refit: tuple[Mapping[str, float], ...] = ()

    @property
    def judgement(self) -> Judgement:
        """Whether the model is wrong, as far as these data can judge it."""
        return judge(self.nrmse, self.noise_floor_nrmse)

    def worst(self, count: int = 5) -> tuple[Bin, ...]:
        """The bins that hold clearly more error than time, most excess first.

        None where the whole error is no more than noise, or where noise hides the motion.
        """
        if self.judgement is not Judgement.WRONG:
            return ()
        return tuple(b for b in self.where if b.excess > MIN_EXCESS)[:count]

    @property
    def place(self) -> Place | None:
        """The square of the map that holds clearly more error than time; None where none does."""
        wrong = self.judgement is Judgement.WRONG
        place = worst_place(self.error_map) if wrong else None
        return place if place is not None and place.excess > MIN_EXCESS else None

    def to_pandas(self) -> Any:
        """One row per bin of every regime: range, shares of error and of time, errors."""
        return data_frame([b.to_row() for b in self.where])

    def to_dict(self) -> dict[str, Any]:
        """One entry of `shadow compare --json`: strict JSON, no nulls, no NaN."""
        return {
            "log": self.log,
            "seconds": self.seconds,
            "vessel": self.vessel,
            "horizon_s": self.ruler.settings.horizon,
            "cut_short": self.ruler.cut_short,
            **self.scores.to_dict(),
            "nrmse": self.nrmse,
            "noise_floor_nrmse": self.noise_floor_nrmse,
            "free_run": self.free_run.to_dict(),
            "where": [b.to_dict() for b in self.where],
            **({"place": self.place.to_dict()} if self.place else {}),
            **({"independence": self.independence.to_dict()} if self.independence else {}),
            **({"notices": list(self.notices)} if self.notices else {}),
            **({"refit": [dict(values) for values in self.refit]} if self.refit else {}),
        }


def compare(
    trial: Trial,
    models: Sequence[Model],
    settings: CompareSettings | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Comparison]:
    """All models on one trial, by one ruler that does not depend on their order.

    NoUsableTimeError where no stretch can be compared over, DivergedError where a model leaves
    every segment at once.
    """
    ruler = shared_ruler(trial, models, settings)
    out = []
    for model in models:
        progress(model.vessel.name)
        found = comparison_of(
            trial, model.vessel.name, ruler, regimes_of(trial, model), predict(trial, model, ruler),
            missing_force(trial, model), free_run(trial, model, ruler.scales),
        )  # fmt: skip
        out.append(replace(found, independence=independence(trial, model)))
    return out


def comparison_of(
    trial: Trial, vessel: str, ruler: Ruler, regimes: tuple[Regime, ...], prediction: Prediction,
    force: MissingForce, longest: FreeRun,
) -> Comparison:  # fmt: skip
    """What a vessel predicts, scored against the trial; `longest`: its run over a whole stretch."""
    segment, rows, error = prediction.predicted_rows()
    squares = scaled_squares(error, ruler.scales)
    return Comparison(
        log=trial.name,
        vessel=vessel,
        seconds=float(trial.usable.sum()) * trial.dt,
        ruler=ruler,
        scores=scores(measured_motion(trial)[rows, :6], error),
        nrmse=nrmse(error, ruler.scales),
        nrmse_ci95=nrmse_interval(squares, ruler.blocks[segment], ruler.settings.seed),
        noise_floor_nrmse=ruler.noise_floor,
        free_run=longest,
        where=error_bins(trial, regimes, prediction, force, ruler.scales),
        error_map=error_map(trial, prediction, ruler.scales),
        prediction=prediction,
        missing=force,
    )
