"""How far each model is from the measurement, beside the noise floor, and where."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sim.comparison.independence import Independence, independence
from sim.comparison.regimes import Regime, regimes_of
from sim.comparison.where import Bin, Place, Track, track, where, worst_place
from sim.model import Model
from sim.prediction.free_runs import FreeRun, Prediction, free_run, predict
from sim.prediction.inputs import motion_of
from sim.prediction.missing_force import MissingForce, missing_force
from sim.prediction.scales import Ruler
from sim.prediction.scores import Scores, nrmse, nrmse_interval, scaled_squares, scores
from sim.prediction.segments import CompareSettings
from sim.tables import data_frame
from sim.trial import Trial

NEAR_FLOOR = 1.2  # an nrmse below this many noise floors is no failure
WORTH_SAYING = 0.02  # share of the squared error beyond the share of the time


@dataclass(frozen=True)
class Comparison:
    """One trial and one vessel under the ruler of their comparison.

    seconds     usable time of the trial
    nrmse_ci95  from blocks of time; None on a trial of a single block
    independence  of errors over one step from the commands; None where that was not asked
                  or the trial is too short
    notices     what looks wrong with the recording or the vessel's channels, a sentence each
    where       all bins, those with the most error beyond their share of time first
    refit       numbers of the day, for either half of the blocks from the other
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
    track: Track
    prediction: Prediction
    missing: MissingForce
    notices: tuple[str, ...] = ()
    independence: Independence | None = None
    refit: tuple[Mapping[str, float], ...] = ()

    def worst(self, count: int = 5) -> tuple[Bin, ...]:
        """The bins that hold clearly more error than time, most excess first.

        None where the whole error is no more than noise.
        """
        if self.nrmse <= NEAR_FLOOR * self.noise_floor_nrmse:
            return ()
        return tuple(b for b in self.where if b.excess > WORTH_SAYING)[:count]

    @property
    def place(self) -> Place | None:
        """The spot on the map that holds clearly more error than time; None where none does."""
        if self.nrmse <= NEAR_FLOOR * self.noise_floor_nrmse:
            return None
        place = worst_place(self.track)
        return place if place is not None and place.excess > WORTH_SAYING else None

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
            "rmse": dict(self.scores.rmse),
            "mae": dict(self.scores.mae),
            "r2": dict(self.scores.r2),
            "fit_percent": dict(self.scores.fit_percent),
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
    progress: Callable[[str], None] | None = None,
) -> list[Comparison]:
    """All models on one trial, the first giving the ruler; NoUsableTimeError if so."""
    ruler, regimes = Ruler.of(trial, models[0], settings), regimes_of(trial, models[0])
    out = []
    for model in models:
        if progress:
            progress(model.vessel.name)
        out.append(compared(trial, model, ruler, regimes))
    return out


def compared(trial: Trial, model: Model, ruler: Ruler, regimes: tuple[Regime, ...]) -> Comparison:
    """One model under a ruler that is there already."""
    prediction, force = predict(trial, model, ruler), missing_force(trial, model)
    alone = free_run(trial, model, ruler.scales)
    found = judged(trial, model.vessel.name, ruler, regimes, prediction, force, alone)
    return replace(found, independence=independence(trial, model))


def judged(
    trial: Trial, vessel: str, ruler: Ruler, regimes: tuple[Regime, ...], prediction: Prediction,
    force: MissingForce, alone: FreeRun,
) -> Comparison:  # fmt: skip
    """What a vessel predicts, held against the trial."""
    segment, rows, error = prediction.along()
    squares = scaled_squares(error, ruler.scales)
    return Comparison(
        log=trial.name,
        vessel=vessel,
        seconds=float(trial.usable.sum()) * trial.dt,
        ruler=ruler,
        scores=scores(motion_of(trial)[rows, :6], error),
        nrmse=nrmse(error, ruler.scales),
        nrmse_ci95=nrmse_interval(squares, ruler.blocks[segment], ruler.settings.seed),
        noise_floor_nrmse=ruler.noise_floor,
        free_run=alone,
        where=where(trial, regimes, prediction, force, ruler.scales),
        track=track(trial, prediction, ruler.scales),
        prediction=prediction,
        missing=force,
    )
