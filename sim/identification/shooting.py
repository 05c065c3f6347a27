"""Prediction-error identification by multiple shooting.

    minimise over the parameters and the start of every run
        Σ ρ( W (measured − model(start, parameters)) )  +  priors

W whitens the errors in time (`sim.identification.noise`). The starts are projected out of each step
linearly, so that the search has the parameters alone (variable projection: Golub and Pereyra,
Inverse Problems 19, 2003), and are then moved to where they fit best. Runs are short at first: from
poor parameters a long one leaves the track. Each stage starts from the motion that the one before
found. All runs and all changes of parameters are one call of the compiled model. A trial without a
run long enough adds no residual; NoUsableTimeError where no trial has one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult

from sim.identification import IdentifySettings
from sim.identification.at_rest import track_std
from sim.identification.innovations import chain_of
from sim.identification.noise import (
    Noise,
    RunErrors,
    apply_whitener,
    command_timing_covariance,
    project_out_starts,
    sharpening_factor,
    timing_whitener,
    whitened,
)
from sim.identification.parameters import OFFSETS, Unknowns
from sim.identification.runs import (
    MIN_MEANS,
    MIN_MEANS_TIED,
    NU,
    RUNS_TOGETHER,
    RunRows,
    RunSet,
    TrialTrack,
    errors_and_sensitivity,
    errors_of_trials,
    run_errors,
    simulate_runs,
)
from sim.identification.search import (
    SearchLimits,
    residuals_and_jacobian,
    robust_weights,
    search,
)
from sim.prediction import measured_motion
from sim.prediction.free_runs import scales_of
from sim.prediction.segments import NoUsableTimeError
from sim.state import Floats, Progress
from sim.trial import Trial

# Chosen, not measured:
ROUNDS = 4  # at the last horizon: starts, noise and parameters in turn
SETTLED_STD = 0.1  # standard deviations, all else known: a smaller change ends the rounds
SHORT_HORIZON_ROWS = 3000  # of a trial that the horizons before the last one use
TIED_GROWTH = 2.5  # of an error of the start, over a run that a filter ties to the one before
SEARCH_STEPS = 8  # of the search in each round


class FitInputs(NamedTuple):
    """Inputs of a fit; `usable`: rows (T,) of each trial that count, else the trial's own."""

    unknowns: Unknowns
    trials: Sequence[Trial]
    settings: IdentifySettings
    usable: Sequence[NDArray[np.bool_]] | None = None

    def tracks(self) -> list[TrialTrack]:
        """The trials as measured."""
        usable = [t.usable for t in self.trials] if self.usable is None else self.usable
        pairs = zip(self.trials, usable, strict=True)
        return [TrialTrack(i, t, rows, measured_motion(t)) for i, (t, rows) in enumerate(pairs)]


@dataclass(frozen=True)
class FitResult:
    """z (n,), whitened residuals (N,), their Jacobian (N, n) and weights (N,).

    time  (N,) s of the trial, and trial_number (N,): where each residual belongs
    """

    z: Floats
    residual: Floats
    jacobian: Floats
    weight: Floats
    time: Floats
    trial_number: NDArray[np.int64]
    noise: tuple[Noise, ...]
    tracks: tuple[TrialTrack, ...]


def fit_by_shooting(
    inputs: FitInputs, start: Floats | None = None, progress: Progress = lambda _: None
) -> FitResult:
    """Parameters from trials, from z (n,) or else from those of the vessel."""
    unknowns, settings = inputs.unknowns, inputs.settings
    z = unknowns.start if start is None else start
    tracks = inputs.tracks()
    noise = [_first_noise(trial, settings) for trial in inputs.trials]
    last = settings.horizons[-1]

    def run_sets(horizon: float) -> list[RunSet]:
        pairs = zip(tracks, noise, strict=True)
        return [build_run_set(t, unknowns, z, n, horizon, settings) for t, n in pairs]

    for horizon in settings.horizons:
        for _ in range(ROUNDS if horizon == last else 1):
            progress(f"{horizon:g} s")
            runs, before = require_runs(run_sets(horizon)), z
            limits = SearchLimits(settings.robust, SEARCH_STEPS, iterative=True)
            found = best_parameters(unknowns, runs, z, limits)
            z, information = np.asarray(found.x), np.sum(found.jac**2, axis=0)
            tracks = [_moved(w, unknowns, z) for w in runs]
            noise = [noise_of_runs(w, unknowns, z) for w in runs]
            std = 1.0 / np.sqrt(np.maximum(information, 1e-300))
            if np.all(np.abs(z - before) < SETTLED_STD * std):
                break
    runs = run_sets(last)
    residual = residuals_of(unknowns, runs, z[None])[0]
    weight = robust_weights(residual, settings.robust)
    return fit_result(z, residual, jacobian_of(unknowns, runs, z), weight, runs, tracks)


def _first_noise(trial: Trial, settings: IdentifySettings) -> Noise:
    """Before any fit: what the trial states, or a tenth of what it moves."""
    sigma = track_std(trial) if settings.tied else 0.1 * scales_of(trial)
    return Noise(sigma, np.full(3, 0.5))


def require_runs(run_sets: list[RunSet]) -> list[RunSet]:
    """The runs of all trials; NoUsableTimeError where no trial holds one."""
    if not any(len(w.rows.first) for w in run_sets):
        longest = MIN_MEANS * max((w.mean_s for w in run_sets), default=0.0)
        raise NoUsableTimeError(f"no usable stretch of {longest:.1f} s or more to fit")
    return run_sets


def build_run_set(
    source: TrialTrack,
    unknowns: Unknowns,
    z: Floats,
    noise: Noise,
    horizon: float,
    settings: IdentifySettings,
) -> RunSet:
    """Runs of about `horizon` [s] and their whitening, at parameters z (n,)."""
    trial = source.trial
    model = replace(unknowns.model, theta=unknowns.theta(z[None], source.number)[0])
    every = max(round(settings.average / trial.dt), 1)
    least = MIN_MEANS_TIED if settings.tied else MIN_MEANS
    growth = TIED_GROWTH if settings.tied else settings.growth
    rows = RunRows.of(trial, source.usable, model, horizon, growth, every, least)
    if horizon < settings.horizons[-1]:
        step = max(round(int(rows.size.sum()) / SHORT_HORIZON_ROWS), 1)
        rows = rows.subset(rows.every(step, RUNS_TOGETHER if settings.tied else 1))
    bare = RunSet.bare(source, model, rows, every, noise, settings.tied)
    shift = float(unknowns.offset(z[None], OFFSETS[0])[0]) + model.delay
    means = bare.within.shape[1] + settings.tied  # of tied runs also their end
    bare = replace(
        bare,
        timing_covariance=command_timing_covariance(
            trial, model, rows.first, every, means, source.track
        ),
        kappa=sharpening_factor(shift, trial.dt),
    )
    return whitened_run_set(bare, errors_and_sensitivity(bare, unknowns, z), noise)


def whitened_run_set(run_set: RunSet, errors: RunErrors, noise: Noise) -> RunSet:
    """The runs under a noise, given their errors."""
    if run_set.follows is not None:
        chain = chain_of(errors, noise, run_set.follows, run_set.track_std, run_set.mean_s)
        white = replace(run_set, noise=noise, chain=chain)
        return _coloured(white, errors.error) if run_set.is_coloured else white
    _, basis, _ = project_out_starts(errors, noise)
    return replace(run_set, noise=noise, basis=basis, whitener=timing_whitener(errors, noise)[0])


def projected_residuals(run_set: RunSet, error: Floats) -> Floats:
    """Errors (K, S, n, 3) -> whitened, without what a start explains: (K, N).

    Of tied runs, errors and gaps (K, S, n + 1, 3) -> whitened innovations (K, N).
    """
    if run_set.chain is not None:
        innovations = run_set.chain.whitened(error).reshape(len(error), -1, 3)
        return innovations.take(run_set.counted, axis=1).reshape(len(error), -1)
    white = whitened(error, run_set.noise) * run_set.within[..., None]
    w = apply_whitener(white, run_set.whitener)
    along = np.einsum("sncl,ksnc->ksl", run_set.basis, w, optimize=True)
    left = w - np.einsum("sncl,ksl->ksnc", run_set.basis, along, optimize=True)
    return left[:, run_set.within > 0].reshape(len(error), -1)


Whitening = Callable[[RunSet, Floats], Floats]  # errors (K, S, n, 3) -> residuals (K, N)


def residuals_of(
    unknowns: Unknowns, run_sets: Sequence[RunSet], z: Floats,
    whitening: Whitening = projected_residuals,
) -> Floats:  # fmt: skip
    """Parameters z (K, n) -> residuals (K, N), without priors."""
    each = residuals_of_trials(unknowns, run_sets, [z] * len(run_sets), whitening)
    return np.concatenate(each, axis=1)


def residuals_of_trials(
    unknowns: Unknowns, run_sets: Sequence[RunSet], z: Sequence[Floats],
    whitening: Whitening = projected_residuals,
) -> list[Floats]:  # fmt: skip
    """Parameters z (K, n) of each trial -> residuals (K, N) of each."""
    errors = errors_of_trials(run_sets, unknowns, z)
    return [whitening(w, e) for w, e in zip(run_sets, errors, strict=True)]


def jacobian_of(
    unknowns: Unknowns, run_sets: Sequence[RunSet], z: Floats,
    whitening: Whitening = projected_residuals,
) -> Floats:  # fmt: skip
    """∂ residuals / ∂ z at z (n,) by differences, away from the nearer limit: (N, n)."""
    _, jacobian = residuals_and_jacobian(
        lambda each: residuals_of_trials(unknowns, run_sets, each, whitening),
        [w.source.number for w in run_sets], unknowns, z,
    )  # fmt: skip
    return jacobian


def best_parameters(
    unknowns: Unknowns, run_sets: Sequence[RunSet], z: Floats, limits: SearchLimits,
    whitening: Whitening = projected_residuals,
) -> OptimizeResult:  # fmt: skip
    """The search from z (n,) with runs, starts and noise held."""
    return search(
        lambda z: residuals_of(unknowns, run_sets, z, whitening),
        lambda z: jacobian_of(unknowns, run_sets, z, whitening),
        unknowns, z, limits,
    )  # fmt: skip


def _moved(run_set: RunSet, unknowns: Unknowns, z: Floats) -> TrialTrack:
    """The track with the motion that the model found: starts of the next stage."""
    rows = run_set.rows
    if not len(rows.first) or run_set.follows is not None:
        return run_set.source
    _, _, correction = project_out_starts(
        errors_and_sensitivity(run_set, unknowns, z), run_set.noise
    )
    trial, track = run_set.source.trial, run_set.source.track.copy()
    limit = scales_of(trial)
    nudge = np.clip(correction, -limit, limit)[None]
    modelled = simulate_runs(run_set, unknowns, z[None], nudge)[0, ..., NU]
    after = np.arange(modelled.shape[1])
    within = after < rows.size[:, None]
    at = (rows.first[:, None] + after)[within]
    modelled, measured = modelled[within], trial.nu[at]
    near = np.all(np.abs(modelled - measured) < limit, axis=1)
    track[at, NU] = np.where(near[:, None], modelled, measured)
    return replace(run_set.source, track=track)


def noise_of_runs(run_set: RunSet, unknowns: Unknowns, z: Floats) -> Noise:
    """The most likely noise of what a model with parameters z (n,) leaves."""
    if not len(run_set.rows.first):
        return run_set.noise
    errors = errors_and_sensitivity(run_set, unknowns, z)
    return run_set.noise_of(errors)


def deviance_of_runs(run_set: RunSet, unknowns: Unknowns, z: Floats) -> float:
    """−2 log likelihood of what a model with parameters z (n,) leaves, under its own noise."""
    if not len(run_set.rows.first):
        return 0.0
    return run_set.deviance_of(errors_and_sensitivity(run_set, unknowns, z))


def coloured_runs(run_set: RunSet, unknowns: Unknowns, z: Floats) -> RunSet:
    """Tied runs under the colour of what a model with parameters z (n,) leaves of them."""
    if run_set.chain is None or not len(run_set.rows.first):
        return run_set
    return _coloured(run_set, run_errors(run_set, unknowns, z[None])[0])


def _coloured(run_set: RunSet, error: Floats) -> RunSet:
    """Tied runs under the colour of errors and gaps (S, n + 1, 3)."""
    assert run_set.chain is not None
    white = replace(run_set, chain=replace(run_set.chain, colour=None))
    left = projected_residuals(white, error[None]).reshape(-1, 3)
    return replace(run_set, chain=run_set.chain.coloured(left, run_set.mean_s))


def fit_result(
    z: Floats, residual: Floats, jacobian: Floats, weight: Floats,
    run_sets: Sequence[RunSet], tracks: Sequence[TrialTrack], at_mean: bool = False,
) -> FitResult:  # fmt: skip
    """Residuals with their places in time: the start of their run, or of their mean (`at_mean`)."""
    time, number = [], []
    for w in run_sets:
        after = float(at_mean) * w.mean_s * np.arange(w.within.shape[1])
        begin = w.source.trial.time[w.rows.first][:, None]
        time.append(np.repeat((begin + after)[w.within > 0], 3))
        number.append(np.full(len(time[-1]), w.source.number))
    return FitResult(
        z, residual, jacobian, weight, np.concatenate(time), np.concatenate(number),
        tuple(w.noise for w in run_sets), tuple(tracks),
    )  # fmt: skip


def information(
    unknowns: Unknowns, trial: Trial, z: Floats, noise: Noise, settings: IdentifySettings
) -> Floats:
    """Information on z in a trial at known noise, without outliers or priors: JᵀJ (n, n)."""
    source = TrialTrack(0, trial, trial.usable, measured_motion(trial))
    run_set = build_run_set(source, unknowns, z, noise, settings.horizons[-1], settings)
    jacobian = jacobian_of(unknowns, [run_set], z)
    return jacobian.T @ jacobian
