"""How far each model is from the measurement, beside the noise floor, and in which regimes.

Is one vessel better than another on the same recording, by how much, and where is it not? Both are
scored by one ruler on the same blocks of time, so the ratio of their errors is drawn over those
blocks: what both suffer alike (waves, gusts) does not hide the difference.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from sim.comparison import (
    DEGREES,
    Bin,
    ErrorMap,
    Place,
    Regime,
    error_bins,
    error_map,
    regimes_of,
    worst_place,
)
from sim.comparison.independence import Independence, independence
from sim.model import Model
from sim.prediction import MissingForce, measured_motion, missing_force
from sim.prediction.free_runs import (
    MAX_JUDGING_FLOOR,
    FreeRun,
    Prediction,
    Ruler,
    Scores,
    free_run,
    nrmse,
    nrmse_interval,
    predict,
    scaled_squares,
    scores,
    shared_ruler,
    shown_floor,
)
from sim.prediction.segments import CompareSettings
from sim.state import Floats
from sim.trial import Trial, data_frame

ADEQUATE_FLOORS = 1.2  # noise floors: an nrmse below is no failure; chosen, not measured
TOLD_CUT = 0.1  # share of the runs that are cut short, from which on it is told; chosen
MIN_EXCESS = 0.02  # share of the squared error beyond the share of time, to be named; chosen
DRIVES_VOLTAGE = ("throttle", "speed")
OWN_EXCESS = 1.5  # times the excess of those: the voltage tells something itself; chosen


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


# A channel errs more than noise from so many times its own noise on, and of turning also from this
# share of how much the boat turns: gyros are better than any model. 26 complete models of other
# physics (`benchmarks.hidden`, second set) showed 0.73 to 1.03 times the noise of u and v, 0.7 to
# 2.1 of r; a thrust that is 10 % off shows 2.4 and 3.6 of u on two recordings.
MIN_TIMES_NOISE = np.array([1.5, 1.5, 3.0])
MIN_SHARE_OF_MOTION = np.array([0.0, 0.0, 0.1])
CHANNEL_NAMES = ("surge", "sway", "turning")
CHANNEL_UNITS = (("m/s", 1.0), ("m/s", 1.0), ("°/s", DEGREES))


@dataclass(frozen=True)
class Standing:
    """An nrmse beside that of noise alone.

    runs_away  the floor is so high because the vessel carries the noise of a start away within its
            horizon, not because the recording is noisy
    louder  channels whose own error is more than their own noise, and how many times that; where
            one hardly moves its noise alone may hide the others in the nrmse
    """

    error: float
    floor: float
    louder: Mapping[str, float] = field(default_factory=dict)
    runs_away: bool = False

    @property
    def by_channel(self) -> bool:
        """Whether a channel alone is wrong, all together being no more than noise."""
        return bool(self.louder) and judge(self.error, self.floor) is Judgement.ADEQUATE

    @property
    def judgement(self) -> Judgement:
        """What that says of a model."""
        return Judgement.WRONG if self.by_channel else judge(self.error, self.floor)


def louder_channels(ruler: Ruler, rmse: Floats) -> dict[str, float]:
    """Errors (3,) of u, v, r -> of those that stand above their noise how many times it."""
    times = rmse / np.maximum(ruler.noise, 1e-12)
    above = (times > MIN_TIMES_NOISE) & (rmse > MIN_SHARE_OF_MOTION * ruler.scales)
    return {name: float(x) for name, x, is_so in zip(CHANNEL_NAMES, times, above, strict=True)
            if is_so}  # fmt: skip


@dataclass(frozen=True)
class Comparison:
    """One trial and one vessel under the ruler of their comparison.

    seconds     usable time of the trial
    horizon_s   the longest free run [s]: no longer than asked for, nor than a stretch of the trial
    nrmse_ci95  from blocks of time; None on a trial of a single block
    measured_noise  of u, v, r as the trial states it, in standard deviations of the motion
    noise_floor_nrmse  what noise alone shows at most (`sim.prediction.free_runs.shown_floor`)
    independence  of errors over one step from the commands; None where that was not asked
                  or the trial is too short
    notices     what looks wrong with the recording or the vessel's channels, a sentence each
    where       all bins, those with the most error beyond their share of time first
    refit       parameters of the voyage, for either fold of the blocks from the other
    """

    log: str
    vessel: str
    seconds: float
    horizon_s: float
    ruler: Ruler
    scores: Scores
    nrmse: float
    nrmse_ci95: tuple[float, float] | None
    noise_floor_nrmse: float
    measured_noise: float
    free_run: FreeRun
    where: tuple[Bin, ...]
    error_map: ErrorMap
    prediction: Prediction
    missing: MissingForce
    notices: tuple[str, ...] = ()
    independence: Independence | None = None
    refit: tuple[Mapping[str, float], ...] = ()

    @property
    def standing(self) -> Standing:
        """The error beside what noise alone would show."""
        rmse = np.array([self.scores.rmse[name] for name in ("u", "v", "r")])
        far = self.noise_floor_nrmse > MAX_JUDGING_FLOOR >= self.measured_noise
        louder = louder_channels(self.ruler, rmse)
        return Standing(self.nrmse, self.noise_floor_nrmse, louder, runs_away=far)

    @property
    def horizon(self) -> str:
        """The longest free run, to a tenth of a second: "10 s"."""
        return f"{round(self.horizon_s, 1):g} s"

    @property
    def cut_text(self) -> str:
        """Which share of the free runs is cut short; empty where that is less than a tenth."""
        if self.ruler.cut_short < TOLD_CUT:
            return ""
        return (
            f"on {self.log} {100.0 * self.ruler.cut_short:.0f} % of the free runs end early: an "
            "error at their start grows on this hull until it hides what the model errs by"
        )

    @property
    def judgement(self) -> Judgement:
        """Whether the model is wrong, as far as these data can judge it."""
        return self.standing.judgement

    def worst(self, count: int = 5) -> tuple[Bin, ...]:
        """The bins that hold clearly more error than time, most excess first.

        None where the whole error is no more than noise, or where noise hides the motion. A battery
        sags under throttle: its bins are none of their own where those of throttle or speed tell as
        much.
        """
        if self.judgement is not Judgement.WRONG:
            return ()
        told = [b for b in self.where if b.excess > MIN_EXCESS]
        driven = max((b.excess for b in told if b.by in DRIVES_VOLTAGE), default=0.0)
        return tuple(b for b in told if b.by != "voltage" or b.excess > OWN_EXCESS * driven)[:count]

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
            "horizon_s": self.horizon_s,
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
    return with_shown_floor(out)


def with_shown_floor(found: Sequence[Comparison]) -> list[Comparison]:
    """The same of one trial and ruler, their floor no higher than the smallest error of them."""
    floor = shown_floor(found[0].ruler.noise_floor, [one.nrmse for one in found]) if found else 0.0
    return [replace(one, noise_floor_nrmse=floor) for one in found]


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
        horizon_s=ruler.longest_run(trial.dt),
        ruler=ruler,
        scores=scores(measured_motion(trial)[rows, :6], error),
        nrmse=nrmse(error, ruler.scales),
        nrmse_ci95=nrmse_interval(squares, ruler.blocks[segment], ruler.settings.seed),
        noise_floor_nrmse=ruler.noise_floor,
        measured_noise=_measured_noise(trial, ruler.scales),
        free_run=longest,
        where=error_bins(trial, regimes, prediction, force, ruler.scales, ruler.noise),
        error_map=error_map(trial, prediction, ruler.scales),
        prediction=prediction,
        missing=force,
    )


def _measured_noise(trial: Trial, scales: Floats) -> float:
    """Noise of the measured u, v, r over usable time, as an nrmse."""
    variance = np.einsum("tii->ti", trial.covariance)[trial.usable, 3:6]
    return float(np.sqrt(np.mean(variance / scales**2)))
