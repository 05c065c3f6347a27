"""Estimators beside multiple shooting: refined instrumental variables, and output error.

**Instrumental variables**: least squares that noise does not bias, and a cross-check by it.

    Φ(ν̇, ν) δ = τ + e        Z = Φ(ν̇_s, ν_s)        δ = (Zᵀ W Φ)⁻¹ Zᵀ W τ

ν_s is what the model itself does on the recorded commands: free of the errors of sensors, so that
Zᵀ e is zero in the mean where Φᵀ e is not. It runs freely from a measured start, and counts only
when that start is forgotten. The model is that of the estimate before, again and again. W whitens
a first-order process per axis. One more column, −τ̇, is for commands that come late. Intervals
leave out one block of time at a time. Sources: Young, Recursive Estimation and Time-Series
Analysis, 2nd ed. 2011, ch. 7; Janot, Vandanjon and Gautier, IEEE Transactions on Control Systems
Technology 22(1), 2014 (the same regressor form, for robots).

The cross-check compares these nine with those of shooting. Shooting trusts the model over seconds,
instruments trust it for what it is told only. Where their intervals lie apart, something is in the
data that the model lacks, and neither number holds. Intervals are widened so that all nine
comparisons hold in 95 of 100 cases (Bonferroni).

**Output error**: what predicts best in free runs from the first sample.

    minimise over the parameters   Σ ρ( (measured − free run) / σ )  +  priors

Runs begin at the measured state and grow from seconds to whole stretches. σ of u, v, r is what the
fit leaves, so a channel that the model cannot predict does not pull at those that it can. There may
be more than one minimum, so the search is made twice, the second time with surge and yaw rate
first, and the likelier end is taken. Errors of a run are correlated over seconds: each counts once
per correlation time. Where a model is not the whole truth, shooting fits what changes quickly and
this what lasts; for a model that is to run freely this is the measure. A hull that is unstable on
course leaves its track whatever the parameters: that one needs shooting. Source: Ljung, System
Identification, 2nd ed. 1999, §3.3, §7.2 (output error).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from sim.effects.catalogue import explaining
from sim.effects.effect import Symptom
from sim.identification import BASE
from sim.identification.intervals import Estimate
from sim.identification.noise import Noise
from sim.identification.parameters import Unknowns
from sim.identification.regression import DELTA_SIGN, Regression, base_values, regressor
from sim.identification.runs import MIN_MEANS, RunRows, RunSet, TrialTrack, run_errors
from sim.identification.search import SearchLimits
from sim.identification.shooting import (
    FitInputs,
    FitResult,
    best_parameters,
    fit_result,
    jacobian_of,
    require_runs,
    residuals_of,
)
from sim.model import Model
from sim.prediction import commands_around, forces_along
from sim.prediction.free_runs import free_reports, scales_of
from sim.prediction.segments import BLOCK_S, NoUsableTimeError, usable_stretches
from sim.state import Floats, Progress
from sim.trial import Trial

# Chosen, not measured:
FORGOTTEN_S = 4.0  # after which a start's error no longer counts
RUN_S = 12.0
MEAN_S = 0.4  # rows are compared in means over so long: what is faster, a smoother has rounded
ROUNDS = 4  # estimates, each on instruments of the one before
SETTLED_STD = 0.02  # standard deviations: a smaller change ends the rounds
MIN_BLOCKS = 3
SHORTEST_BLOCK_S = 5.0  # blocks shrink towards six in a trial, but not below
LARGEST_SCALES = 3.0  # beyond the largest motion: an instrument there has left the track
MAX_CONDITION = 1e15  # of Zᵀ W Φ: beyond it the parameters are not determined
MAX_RHO = 0.9  # of the noise from mean to mean
MIN_INERTIA = 0.1  # of the vessel's own: an instrument's model needs a positive one
MIN_DISAGREEMENT = 0.03  # of the value: a smaller difference is none
WIDER = float(ndtri(1.0 - 0.025 / len(BASE)) / ndtri(0.975))  # Bonferroni
TOO_LITTLE = "instrumental variables need three blocks of 5 s, each 4 s after a gap, with motion"
LOOK_AT = {
    "m": f"how late and how slowly the motors answer ({explaining(Symptom.LATE_COMMANDS)})",
    "X": "thrust against command, wind and current",
    "Y": "current, heading offset and what pushes sideways",
    "N": "thrust that is not the same on both sides, and moments of wind",
}


class RegressionRows(NamedTuple):
    """Means of one stretch: Φ and Z (M, 3, 10), τ (M, 3), block (M,)."""

    phi: Floats
    tau: Floats
    z: Floats
    block: NDArray[np.int64]


def fit_by_instruments(trials: Sequence[Trial], model: Model) -> Regression:
    """The nine parameters from all usable rows, started from those of the model.

    NoUsableTimeError where the rows do not determine all nine.
    """
    value, std, count, early = base_values(model), np.zeros(len(BASE)), 0, True
    for _ in range(ROUNDS):
        before, now = value, _with(model, value)
        rows = [r for i, t in enumerate(trials) for r in _rows(t, now, i, early)]
        if not rows:
            raise NoUsableTimeError(TOO_LITTLE)
        try:
            delta, std, count = _solved(rows)
        except np.linalg.LinAlgError:  # one block alone determines a parameter
            raise NoUsableTimeError(TOO_LITTLE) from None
        if not np.isfinite(std).all():
            raise NoUsableTimeError(TOO_LITTLE)
        value, early = delta[: len(BASE)] * DELTA_SIGN, bool(delta[-1] > 0.0)
        if np.all(np.abs(value - before) < SETTLED_STD * std):
            break
    return Regression.of(value, std, float(stdtrit(count - 1, 0.975)))


def _with(model: Model, value: Floats) -> Model:
    """The model with these nine, each with a sign that a vessel can have."""
    inertia = np.maximum(value, MIN_INERTIA * base_values(model))
    kept = np.where(DELTA_SIGN > 0.0, inertia, np.minimum(value, 0.0))
    theta = model.theta.copy()
    theta[[model.names.index(name) for name in BASE]] = kept
    return replace(model, theta=theta)


def _rows(trial: Trial, model: Model, number: int, early: bool) -> list[RegressionRows]:
    """The stretches of one trial, with instruments of this model."""
    simulated, known = _simulated(trial, model)
    _, tau = forces_along(trial, model, *commands_around(model, trial))
    late = _late_force(tau, trial.dt, early)[..., None]
    phi = np.concatenate([_over_intervals(trial.nu, trial.dt), late], axis=2)
    z = np.concatenate([_over_intervals(simulated, trial.dt), late], axis=2)
    every = max(round(MEAN_S / trial.dt), 1)
    width = max(min(BLOCK_S, float(trial.usable.sum()) * trial.dt / 6.0), SHORTEST_BLOCK_S)
    out = []
    whole = known & np.append(known[1:], False)
    for stretch in usable_stretches(trial.usable & whole):
        n = len(stretch) // every * every
        if n == 0:
            continue
        rows = slice(stretch.start, stretch.start + n)
        time = trial.time[rows].reshape(-1, every)[:, 0]
        label = number * 10**6 + (time // width).astype(np.int64)
        means = [x[rows].reshape(-1, every, *x.shape[1:]).mean(axis=1) for x in (phi, tau, z)]
        out.append(RegressionRows(means[0], means[1], means[2], label))
    return out


def _late_force(tau: Floats, dt: float, early: bool) -> Floats:
    """−τ̇ (T, 3): towards the next interval where the boat moves before a command is recorded, as
    with commands that hold from message to message (`early`); else from the one before."""
    change = np.diff(tau, axis=0) / dt
    none = np.zeros((1, tau.shape[1]))
    return -np.vstack([change, none] if early else [none, change])


def _over_intervals(nu: Floats, dt: float) -> Floats:
    """ν (T, 3) at the rows -> Φ (T, 3, 9) over the interval after each, with ν's change for ν̇."""
    after = np.vstack([nu[1:], nu[-1:]])
    return regressor(0.5 * (nu + after), (after - nu) / dt)


def _simulated(trial: Trial, model: Model) -> tuple[Floats, NDArray[np.bool_]]:
    """ν_s (T, 3) of free runs that have forgotten their starts, and the rows (T,) that have one."""
    out, known = np.zeros((len(trial), 3)), np.zeros(len(trial), np.bool_)
    skip, length = (round(s / trial.dt) for s in (FORGOTTEN_S, RUN_S))
    pairs = [
        (row, min(row + length, stretch.stop) - 1 - row)
        for stretch in usable_stretches(trial.usable)
        for row in range(stretch.start, stretch.stop - skip, length - skip)
    ]
    first, steps = np.array(pairs, np.int64).reshape(-1, 2).T
    if not len(first):
        return out, known
    reports = free_reports(trial, model, first, steps)
    limit = LARGEST_SCALES * scales_of(trial) + np.abs(trial.nu[trial.usable]).max(axis=0)
    for row, n, nu in zip(first, steps, reports[..., 3:6], strict=True):
        part = nu[skip : n + 1]
        near = np.all(np.abs(np.nan_to_num(part, nan=np.inf)) <= limit, axis=1)
        near = np.logical_and.accumulate(near)
        at = slice(row + skip, row + n + 1)
        out[at], known[at] = np.where(near[:, None], part, 0.0), near
    return out, known


def _solved(rows: Sequence[RegressionRows]) -> tuple[Floats, Floats, int]:
    """δ (10,), standard deviations of nine from blocks left out, and how many blocks."""
    delta, rho, sigma = _sums(rows, np.zeros(3), np.ones(3))[0], np.zeros(3), np.ones(3)
    for _ in range(2):
        rho, sigma = _noise(rows, delta)
        delta, A, b = _sums(rows, rho, sigma)
    count = len(A)
    if count < MIN_BLOCKS or not np.linalg.cond(A.sum(axis=0)) <= MAX_CONDITION:
        return delta, np.full(len(BASE), np.inf), count
    without = np.linalg.solve(A.sum(axis=0) - A, (b.sum(axis=0) - b)[..., None])[..., 0]
    spread = np.sqrt((count - 1) * np.var(without, axis=0))
    return delta, spread[: len(BASE)], count


def _sums(
    rows: Sequence[RegressionRows], rho: Floats, sigma: Floats
) -> tuple[Floats, Floats, Floats]:
    """δ (10,), and Zᵀ W Φ (G, 10, 10), Zᵀ W τ (G, 10) of each block."""
    each: dict[int, tuple[Floats, Floats]] = {}
    for r in rows:
        phi, z = (_white(x, rho[:, None], sigma[:, None]) for x in (r.phi, r.z))
        tau = _white(r.tau, rho, sigma)
        for g in np.unique(r.block):
            k = r.block == g
            A, b = np.einsum("tai,taj->ij", z[k], phi[k]), np.einsum("tai,ta->i", z[k], tau[k])
            was = each.get(int(g), (0.0, 0.0))
            each[int(g)] = was[0] + A, was[1] + b
    A, b = (np.stack(part) for part in zip(*each.values(), strict=True))
    return np.linalg.pinv(A.sum(axis=0)) @ b.sum(axis=0), A, b


def _white(x: Floats, rho: Floats, sigma: Floats) -> Floats:
    out = x / sigma
    out[1:] = (x[1:] - rho * x[:-1]) / sigma
    out[0] = x[0] * np.sqrt(1.0 - rho**2) / sigma
    return out


def _noise(rows: Sequence[RegressionRows], delta: Floats) -> tuple[Floats, Floats]:
    """ρ (3,) from mean to mean and σ (3,) of the innovations of τ − Φ δ."""
    error = [r.tau - r.phi @ delta for r in rows]
    now = np.concatenate([e[1:] for e in error])
    if not len(now):  # no stretch has two means
        return np.zeros(3), np.ones(3)
    before = np.concatenate([e[:-1] for e in error])
    rho = np.sum(now * before, axis=0) / np.maximum(np.sum(before**2, axis=0), 1e-300)
    rho = np.clip(rho, -MAX_RHO, MAX_RHO)
    return rho, np.maximum(np.std(now - rho * before, axis=0), 1e-9)


def cross_check_by_instruments(
    trials: Sequence[Trial], model: Model, estimates: Sequence[Estimate]
) -> tuple[str, ...]:
    """A sentence for each base parameter whose two intervals lie apart; none where all agree.

    `model` holds the fitted parameters. Vessels with effects are not compared: their forces are not
    linear in the nine.
    """
    fitted = {e.name: e for e in estimates if e.name in BASE and e.identifiable}
    if model.vessel.effects or len(estimates) != len(BASE) or not fitted:
        return ()
    try:
        other = fit_by_instruments(trials, model)
    except NoUsableTimeError:
        return ()
    out = []
    for i, name in enumerate(BASE):
        if name not in fitted:
            continue
        e, low, high = fitted[name], float(other.low[i]), float(other.high[i])
        reach = WIDER * 0.5 * (e.ci95[1] - e.ci95[0] + high - low)
        if abs(e.value - other.value[i]) > max(reach, MIN_DISAGREEMENT * abs(e.value)):
            out.append(
                f"{name}: instrumental variables say {low:.4g} … {high:.4g} {e.unit}, which lies "
                f"outside {e.ci95[0]:.4g} … {e.ci95[1]:.4g}: look at {LOOK_AT[name[0]]}"
            )
    return tuple(out)


# Chosen, not measured:
LENGTHS_S = (5.0, 15.0, 45.0, 150.0)  # of the runs, stage by stage
LAST_ROUNDS = 3  # at the last length: parameters and σ in turn
FIRST_WEIGHTS = (np.ones(3), np.array([1.0, 30.0, 1.0]))  # of σ: all channels at once, sway last
LARGEST_ERROR_SCALES = 3.0  # a larger error says only that the run left its track
MAX_CORRELATION_S = 5.0  # errors correlated for longer show in intervals, from blocks of time
MIN_ERROR = np.array([1e-4, 1e-4, 1e-5])  # smallest σ of u, v, r [m/s, m/s, rad/s]
SEARCH_STEPS = 15


class ErrorSize(NamedTuple):
    """σ (3,) of the errors, and how many rows one independent error stands for."""

    sigma: Floats
    rows: float

    def whitening(self, run_set: RunSet, error: Floats) -> Floats:
        """Errors (K, S, n, 3) -> residuals (K, 3 N), one per independent error on the average."""
        bounded = _bounded(run_set, error)
        return (bounded / (self.sigma * np.sqrt(self.rows))).reshape(len(error), -1)


def fit_by_output_error(
    inputs: FitInputs, start: Floats | None = None, progress: Progress = lambda _: None
) -> FitResult:
    """Parameters from trials, from z (n,) or else, with longer and longer runs, the vessel's."""
    unknowns = inputs.unknowns
    tracks = inputs.tracks()
    weights = FIRST_WEIGHTS if start is None else FIRST_WEIGHTS[:1]
    ends = [_staged(inputs, tracks, start, weight, progress) for weight in weights]
    runs, z = min(ends, key=lambda end: _cost(unknowns, *end))
    size = _error_size(unknowns, runs, z)
    residual = residuals_of(unknowns, runs, z[None], size.whitening)[0]
    weight = 1.0 / np.sqrt(1.0 + residual**2 * size.rows / inputs.settings.robust**2)
    runs = [replace(w, noise=Noise(size.sigma, np.zeros(3))) for w in runs]
    jacobian = jacobian_of(unknowns, runs, z, size.whitening)
    return fit_result(z, residual, jacobian, weight, runs, tracks, at_mean=True)


def _staged(
    inputs: FitInputs,
    tracks: Sequence[TrialTrack],
    start: Floats | None,
    weight: Floats,
    progress: Progress,
) -> tuple[list[RunSet], Floats]:
    """Runs of the last length and z (n,); σ is `weight` times as large until the last stage."""
    unknowns, robust = inputs.unknowns, inputs.settings.robust
    z = unknowns.start if start is None else start
    growing = [(length, weight) for length in LENGTHS_S] if start is None else []
    for length, factor in [*growing, *[(LENGTHS_S[-1], np.ones(3))] * LAST_ROUNDS]:
        progress(f"{length:g} s")
        runs = require_runs([_run_set(t, inputs, z, length) for t in tracks])
        size = _error_size(unknowns, runs, z)
        size = size._replace(sigma=size.sigma * factor)
        # one independent error is spread over `rows` residuals: what is robust must be so for those
        limits = SearchLimits(robust / np.sqrt(size.rows), SEARCH_STEPS, change=1e-5)
        z = np.asarray(best_parameters(unknowns, runs, z, limits, size.whitening).x)
    return runs, z


def _cost(unknowns: Unknowns, run_sets: Sequence[RunSet], z: Floats) -> float:
    """−2 log likelihood of white errors of unknown σ, each counted as it is independent."""
    size = _error_size(unknowns, run_sets, z)
    count = sum(float(w.within.sum()) for w in run_sets) / size.rows
    return float(2.0 * count * np.log(size.sigma).sum() + np.sum(unknowns.prior_residuals(z) ** 2))


def _run_set(source: TrialTrack, inputs: FitInputs, z: Floats, length: float) -> RunSet:
    """Runs of one trial, of about that length [s]."""
    unknowns, dt = inputs.unknowns, source.trial.dt
    model = replace(unknowns.model, theta=unknowns.theta(z[None], source.number)[0])
    every = max(round(inputs.settings.average / dt), 1)
    rows = RunRows.divided(source.usable, max(round(length / dt / every), MIN_MEANS), every)
    return RunSet.bare(source, model, rows, every, Noise(np.ones(3), np.zeros(3)))


def _bounded(run_set: RunSet, error: Floats) -> Floats:
    """Errors (K, S, n, 3) -> (K, N, 3) of the means that count, no larger than what counts."""
    limit = LARGEST_ERROR_SCALES * scales_of(run_set.source.trial)
    return np.clip(error[:, run_set.within > 0], -limit, limit)


def _error_size(unknowns: Unknowns, run_sets: Sequence[RunSet], z: Floats) -> ErrorSize:
    """σ of each channel, and the correlation time of the slowest in rows; white where all is 0."""
    errors = [_bounded(w, run_errors(w, unknowns, z[None]))[0] for w in run_sets]
    sigma = np.maximum(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)), MIN_ERROR)
    unit = [e / sigma for e in errors if len(e) > 1]
    alike = np.sum([np.sum(e[1:] * e[:-1], axis=0) for e in unit], axis=0)
    squares = np.sum([np.sum(e[1:] ** 2, axis=0) for e in unit], axis=0)
    rho = np.divide(alike, squares, out=np.zeros(3), where=squares > 0.0)
    rho = np.clip(rho, 0.0, 0.99)
    step = run_sets[0].mean_s
    return ErrorSize(sigma, float(min(np.max((1.0 + rho) / (1.0 - rho)), MAX_CORRELATION_S / step)))
