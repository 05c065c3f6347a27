"""Free runs of a model over recorded commands, their error in numbers, and what it is measured by.

Many runs, one from every segment's start (`predict`), or one over the longest usable stretch of a
trial (`free_run`, the paper's Table 6). Error: measured − model.

**Scores**, per channel and as one: RMSE, MAE, R², fit per cent, nrmse and its interval.

    R² = 1 − Σe²/Σ(y − ȳ)²      fit = 100 (1 − √(Σe²/Σ(y − ȳ)²))
    nrmse = √( mean over u, v, r of (RMSE_i / scale_i)² )

R² and fit are MATLAB's; all sums run over the predicted rows of all segments.

The interval of an nrmse is a bootstrap over blocks of time, never over samples: errors within a
segment, and of segments that overlap, are not independent. Whole blocks are drawn with replacement;
the interval holds the middle 95 % of the nrmse of the draws, widened by √(n/(n − 1)) for the few
blocks there are.

**Scales**: segments, scales of the errors and the noise floor.

The noise floor is what a perfect model would still show. Started at the estimate it carries the
estimate's error ε₀ along; the row that it is compared with has an error ε_j of its own:

    e_j = ε_j − Φ_j ε₀,     var e_j = R_j + Φ_j P₀ Φ_jᵀ − 2 Φ_j C_j,     C_j = cov(ε₀, ε_j)

A smoother's errors are correlated in time, and the trial holds only P and R. But the error of a
velocity changes at the error of its acceleration, which the trial does hold: a stationary error
of variance p whose rate has variance q has the correlation 1 − t² q / 2p to second order. Taken
on as ρ(t) = exp(−t² q / 2p) this gives C_j = P₀ ρ(t_j), scaled down where R_j < P₀. White errors
are its limit q → ∞. Slow sensor errors are correlated for longer: for them the floor is too high
rather than too low. Source: the Taylor microscale of a random process (Rice 1944).

What a trial states of its noise is assumed and may be too much. An error is a model's own beside
the noise, so that noise is no more than the smallest error that a model has shown
(`shown_floor`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.prediction import commands_around, input_table, measured_motion, runs_from
from sim.prediction.late import reported_before, true_starts
from sim.prediction.segments import (
    STATE,
    CompareSettings,
    Segments,
    longest_stretch,
    nodes_within_limit,
    require_finite,
    segments_of,
    start_transitions,
    start_variance,
)
from sim.state import Eta, Floats, Ints, wrap
from sim.trial import Trial

BOOTSTRAP_DRAWS = 2000
COLUMN = {"u": 3, "v": 4, "r": 5, "x": 0, "y": 1, "psi": 2}  # of (eta, nu); x north, y east


@dataclass(frozen=True)
class Scores:
    """Errors by channel [m/s, rad/s, m, rad]; one that never moved has no R² and no fit."""

    rmse: Mapping[str, float]
    mae: Mapping[str, float]
    r2: Mapping[str, float]
    fit_percent: Mapping[str, float]

    def to_dict(self) -> dict[str, dict[str, float]]:
        """For JSON."""
        return {key: dict(values) for key, values in vars(self).items()}


def scores(measured: Floats, error: Floats) -> Scores:
    """Measured (M, 6) and error (M, 6) of (eta, nu) -> scores by channel."""
    squares = np.sum(error**2, axis=0)
    about_mean = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    moved = {name: i for name, i in COLUMN.items() if about_mean[i] > 0.0}
    return Scores(
        {name: float(np.sqrt(squares[i] / len(error))) for name, i in COLUMN.items()},
        {name: float(np.mean(np.abs(error[:, i]))) for name, i in COLUMN.items()},
        {name: float(1.0 - squares[i] / about_mean[i]) for name, i in moved.items()},
        {name: float(100.0 * (1.0 - np.sqrt(squares[i] / about_mean[i])))
         for name, i in moved.items()},
    )  # fmt: skip


def scaled_squares(error: Floats, scales: Floats) -> Floats:
    """Error (..., 6), scales (3,) of u, v, r -> mean squared error in scales (...)."""
    return np.mean((error[..., 3:] / scales) ** 2, axis=-1)


def nrmse(error: Floats, scales: Floats) -> float:
    """Error (M, 6), scales (3,) of u, v, r -> one number."""
    return float(np.sqrt(np.mean(scaled_squares(error, scales))))


def nrmse_interval(squares: Floats, block: Ints, seed: int) -> tuple[float, float] | None:
    """Squared scaled errors (M,) and their blocks (M,) -> 95 % interval; None below two blocks."""
    _, number = np.unique(block, return_inverse=True)
    total, count = np.bincount(number, squares), np.bincount(number)
    n = len(total)
    if n < 2:
        return None
    draw = np.random.default_rng(seed).integers(0, n, (BOOTSTRAP_DRAWS, n))
    mean = total.sum() / count.sum()
    means = total[draw].sum(axis=1) / count[draw].sum(axis=1)
    means = mean * np.maximum(means / mean, 1e-12) ** np.sqrt(n / (n - 1)) if mean > 0 else means
    low, high = np.quantile(np.sqrt(means), [0.025, 0.975])
    return float(low), float(high)


# Smallest scales of u, v, r [m/s, m/s, rad/s]: a channel that moves less is at rest. Chosen, not
# measured.
MIN_SCALES = np.array([0.05, 0.05, 0.02])


@dataclass(frozen=True)
class Ruler:
    """Segments with their horizons, the scales of the errors and the noise floor.

    segments             horizons already cut where the start state's spread passes its limit
    cut_short            share of the segments whose horizon was cut
    scales    (3,)       of u, v, r [m/s, m/s, rad/s]
    variance  (S, J, 6)  of a perfect model's error at each node; NaN past the uncut horizon
    blocks    (S,)       number of the block of time that the segment starts in
    """

    settings: CompareSettings
    segments: Segments
    cut_short: float
    scales: Floats
    variance: Floats
    blocks: Ints

    @classmethod
    def of(cls, trial: Trial, model: Model, settings: CompareSettings | None = None) -> "Ruler":
        """The ruler of a trial and a vessel; NoUsableTimeError if nothing can be compared."""
        settings = settings or CompareSettings()
        require_finite(trial)
        whole, scales = segments_of(trial, settings), scales_of(trial)
        phi = start_transitions(model, trial, whole)
        spread = start_variance(trial, whole, phi)
        nodes = nodes_within_limit(spread, whole, scales, trial.dt, settings)
        return cls(
            settings,
            replace(whole, nodes=nodes),
            float(np.mean(nodes < whole.nodes)),
            scales,
            perfect_variance(trial, whole, phi, spread),
            segment_blocks(trial, whole, settings.block),
        )

    def subset(self, which: NDArray[np.bool_]) -> "Ruler":
        """The ruler of some of its segments (S,)."""
        own = self.segments
        return replace(
            self, segments=replace(own, rows=own.rows[which], nodes=own.nodes[which]),
            variance=self.variance[which], blocks=self.blocks[which],
        )  # fmt: skip

    def longest_run(self, dt: float) -> float:
        """The longest free run [s] on a grid of `dt` [s].

        Runs are whole nodes: one that is off by less than a node is as long as was asked for.
        """
        longest, node = float(self.segments.steps.max()) * dt, self.segments.stride * dt
        asked = self.settings.horizon
        return asked if abs(longest - asked) < node else longest

    @cached_property
    def noise(self) -> Floats:
        """Errors of u, v, r (3,), root mean square, that a perfect model would show, by what the
        trial states of its noise [m/s, m/s, rad/s].
        """
        return np.asarray(np.sqrt(mean_over_horizon(self.variance[..., 3:], self.segments)))

    @property
    def noise_floor(self) -> float:
        """The nrmse that a perfect model would show."""
        return float(np.sqrt(np.mean((self.noise / self.scales) ** 2)))


# nrmse below which no two models differ in anything that a person would want to know. Chosen.
LEAST_SHOWN_FLOOR = 0.01


MAX_JUDGING_FLOOR = 0.5  # nrmse: beyond it noise hides the motion; chosen, not measured


def shown_floor(stated: float, errors: Iterable[float]) -> float:
    """nrmse that noise alone shows at most: as stated, or less where a model showed less.

    As stated where that hides the motion: an error below it makes no model a good one.
    """
    if stated > MAX_JUDGING_FLOOR:
        return stated
    return min(stated, max(LEAST_SHOWN_FLOOR, min(errors, default=stated)))


def scales_of(trial: Trial) -> Floats:
    """Standard deviation of u, v, r over the usable rows: (3,) [m/s, m/s, rad/s].

    It is `MIN_SCALES` at least, and on a trial without usable rows.
    """
    if not trial.usable.any():
        return MIN_SCALES.copy()
    return np.maximum(trial.nu[trial.usable].std(axis=0), MIN_SCALES)


def segment_blocks(trial: Trial, segments: Segments, length: float) -> Ints:
    """Number of the block of `length` [s] in which each segment starts: (S,).

    On a short trial blocks shrink towards six, but never below the longest horizon: segments of
    different blocks should share as little time as possible.
    """
    start = trial.time[segments.rows]
    horizon = float(segments.steps.max()) * trial.dt
    width = min(length, max((start[-1] - start[0] + horizon) / 6.0, horizon))
    return ((start - start[0]) // width).astype(np.int64)


def perfect_variance(trial: Trial, segments: Segments, phi: Floats, spread: Floats) -> Floats:
    """Variance (S, J+1, 6) of a perfect model's error in (eta, nu), SI units.

    phi (S, J+1, 6, 6); spread (S, J+1, 6): variance that the start state leaves at each node.
    """
    rows = segments.rows[:, None] + segments.stride * np.arange(phi.shape[1])
    variance: Floats = np.einsum("tii->ti", trial.covariance)
    R: Floats = variance[np.minimum(rows, len(trial) - 1), :STATE]
    P = trial.covariance[segments.rows, :STATE, :STATE]
    t = segments.stride * trial.dt * np.arange(phi.shape[1])
    carried = np.einsum("sjik,ski->sji", phi, P, optimize=True)
    own = R[:, :1]
    shared = np.sqrt(np.minimum(np.divide(R, own, out=np.ones_like(R), where=own > 0), 1.0))
    rho = correlation(variance[segments.rows], np.asarray(t)) * shared
    return np.maximum(R + spread - 2.0 * carried * rho, 0.0)


def correlation(variance: Floats, t: Floats) -> Floats:
    """Variances (S, 9) of (eta, nu, nu_dot), lags (J,) [s] -> correlation (S, J, 6) of errors."""
    ground = 0.5 * (variance[:, 3] + variance[:, 4])
    rate = np.column_stack([ground, ground, variance[:, 5:]])
    with np.errstate(divide="ignore", invalid="ignore"):
        exponent = -0.5 * t[None, :, None] ** 2 * (rate / variance[:, :STATE])[:, None, :]
    # errors whose rate is not known are taken for white
    known = (rate > 0.0)[:, None, :] | (t == 0.0)[None, :, None]
    return np.where(known, np.exp(np.nan_to_num(exponent, nan=0.0)), 0.0)


def mean_over_horizon(variance: Floats, segments: Segments) -> Floats:
    """Variance (S, J+1, n) at the nodes -> its mean (n,) over all rows of all segments."""
    weight = np.minimum(segments.nodes[:, None] - np.arange(variance.shape[1]), 1.0)
    weight = np.maximum(np.where(weight == 0.0, 0.5, weight), 0.0)
    weight[:, 0] *= 0.5
    total = np.einsum("sj,sjn->n", weight, np.nan_to_num(variance))
    return np.asarray(total / weight.sum())


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

    def predicted_rows(self, most: int | None = None) -> tuple[Ints, Ints, Floats]:
        """Segment (M,), row of the trial (M,) and error (M, 6) of every predicted row, or of the
        first ones of each segment, so many at `most`.
        """
        after = np.arange(1, self.error.shape[1])[:most]
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
    motion, theta = measured_motion(trial), model.theta[None]
    start = true_starts(model, theta, motion, rows, trial.dt)
    x0 = np.hstack([start, memory_at(model, trial, rows)])
    runs = runs_from(rows, steps, command_offset)
    reports = model.run(x0, runs, input_table(model, trial))[1]
    reported_before(model, theta, reports[:, None], motion, rows, trial.dt)
    return reports


def prediction_error(measured: Floats, rows: Ints, model: Floats) -> Floats:
    """Measured (T, 6), first rows (S,), model (S, H+1, 6) -> measured − model, SI."""
    at = np.minimum(rows[:, None] + np.arange(model.shape[1]), len(measured) - 1)
    error = measured[at] - model
    error[..., Eta.YAW] = wrap(error[..., Eta.YAW])
    return error


def memory_of_each(model: Model, trial: Trial, rows: Ints, theta: Floats) -> Floats:
    """Memory of actuators and effects at rows (S,) as each of theta (K, P) has it: (S, K, nx − 6).

    It follows the measured motion, which what acts on the hull alone does not change.
    """
    if model.state_size == 6:
        return np.empty((len(rows), len(theta), 0))
    driving = np.delete(theta, model.passive_columns, axis=1)
    _, first, which = np.unique(driving, axis=0, return_index=True, return_inverse=True)
    each = [memory_at(replace(model, theta=theta[i]), trial, rows) for i in first]
    return np.stack(each, axis=1)[:, which.ravel()]


def memory_at(model: Model, trial: Trial, rows: Ints) -> Floats:
    """Memory of actuators and effects at rows (S,), run along the measured motion: (S, nx − 6)."""
    memory = np.empty((int(np.max(rows, initial=-1)) + 1, model.state_size - 6))
    if memory.size:
        before, part = commands_around(model, trial)[0][: len(memory)], slice(len(memory))
        model.missing_force(
            measured_motion(trial)[part], trial.time[part], before, before,
            voltage=trial.voltage[part], wind=trial.wind[part], memory=memory,
        )  # fmt: skip
    return memory[rows]


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
