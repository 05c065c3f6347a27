"""Prediction-error identification by multiple shooting.

    minimise over the parameters and the start of every run
        Σ ρ( W (measured − model(start, parameters)) )  +  priors

W whitens the errors in time (`sim.identification.noise`). The starts are taken out of each step
linearly, so that the search sees the parameters alone (variable projection: Golub and Pereyra,
Inverse Problems 19, 2003), and are then moved to where they fit best. Runs are short at first:
from poor parameters a long one leaves the track. Each stage starts from the motion that the one
before found. All runs and all changes of parameters are one call of the compiled model.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sim.identification.noise import (
    Noise,
    RunErrors,
    apply_whitener,
    estimate_noise,
    project_out_starts,
    timing_whitener,
    whitened,
)
from sim.identification.parameters import OFFSETS, ROUNDING, Unknowns
from sim.identification.runs import (
    START_STEP,
    RunRows,
    command_timing_covariance,
    run_rows_of,
    sharpened_commands,
    sharpening_factor,
    thinned,
)
from sim.identification.search import SearchLimits, robust_weights, search, stacked_jacobian
from sim.identification.settings import IdentifySettings
from sim.model import Model, Runs
from sim.prediction.free_runs import memory_at
from sim.prediction.inputs import input_table, measured_motion
from sim.prediction.scales import scales_of
from sim.state import Floats
from sim.trial import Trial

LOST = 100.0  # scales: an error of a run that left the track
ROUNDS = 4  # at the last horizon: starts, noise and parameters in turn
SETTLED = 0.1  # standard deviations, all else known: the rounds end
ENOUGH = 3000  # rows of a voyage that the short horizons look at
NU = slice(3, 6)


@dataclass(frozen=True)
class TrialTrack:
    """A trial as shooting sees it: which rows count, and the motion that starts are taken from."""

    number: int
    trial: Trial
    usable: NDArray[np.bool_]
    track: Floats  # (T, 9) reported motion; velocities are those that the model found


@dataclass(frozen=True)
class RunSet:
    """The runs of one voyage, with all that does not change while the parameters do.

    Rows are compared in means of `every`; n of them in the longest run.

    basis  (S, n, 3, 3) of what a start explains in the whitened residuals
    covariance  (S, 3n, 3n) covariance that the commands' moments may add, mix (S, 3n, 3n) its whitening
    kappa  of commands that are shifted by part of a row (`sim.identification.runs`)
    """

    source: TrialTrack
    model: Model
    rows: RunRows
    every: int
    within: Floats
    memory: Floats
    noise: Noise
    basis: Floats
    timing_covariance: Floats | None = None
    whitener: Floats | None = None
    kappa: float = 0.0


@dataclass(frozen=True)
class FitResult:
    """What shooting found: z (n,), whitened residuals (N,), slopes (N, n), weights (N,), blocks.

    moment  (N,) s of the trial, voyage (N,): where each residual belongs
    """

    z: Floats
    residual: Floats
    jacobian: Floats
    weight: Floats
    time: Floats
    trial_number: NDArray[np.int64]
    noise: tuple[Noise, ...]
    tracks: tuple[TrialTrack, ...]


def trial_tracks(trials: Sequence[Trial], usable: Sequence[NDArray[np.bool_]]) -> list[TrialTrack]:
    """As measured, before any model has found where they begin."""
    return [
        TrialTrack(i, t, rows, measured_motion(t))
        for i, (t, rows) in enumerate(zip(trials, usable, strict=True))
    ]


def fit_by_shooting(
    unknowns: Unknowns,
    trials: Sequence[Trial],
    usable: Sequence[NDArray[np.bool_]],
    settings: IdentifySettings,
    start: Floats | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> FitResult:
    """Parameters from trials; only rows that are `usable` count."""
    z = unknowns.start if start is None else start
    voyages = trial_tracks(trials, usable)
    noise = [_first_guess(trial) for trial in trials]
    last = settings.horizons[-1]
    for horizon in settings.horizons:
        for _ in range(ROUNDS if horizon == last else 1):
            tell(f"{horizon:g} s")
            windows = [
                build_run_set(v, unknowns, z, n, horizon, settings)
                for v, n in zip(voyages, noise, strict=True)
            ]
            before = z
            z, std = _fitted(unknowns, windows, z, settings)
            voyages = [_moved(w, unknowns, z) for w in windows]
            noise = [noise_of_runs(w, unknowns, z) for w in windows]
            if np.all(np.abs(z - before) < SETTLED * std):
                break
    windows = [
        build_run_set(v, unknowns, z, n, last, settings)
        for v, n in zip(voyages, noise, strict=True)
    ]
    return _shot(unknowns, windows, z, settings, tuple(voyages))


def _first_guess(trial: Trial) -> Noise:
    """Before anything is known: a tenth of the motion, half of it from mean to mean."""
    return Noise(0.1 * scales_of(trial), np.full(3, 0.5))


def build_run_set(
    voyage: TrialTrack,
    unknowns: Unknowns,
    z: Floats,
    noise: Noise,
    horizon: float,
    settings: IdentifySettings,
) -> RunSet:
    """Tiles, memory of the actuators and the part of the starts, at parameters z."""
    model = replace(unknowns.model, theta=unknowns.theta(z[None], voyage.number)[0])
    every = max(round(settings.average / voyage.trial.dt), 1)
    tiles = run_rows_of(voyage.trial, voyage.usable, model, horizon, settings.growth, every)
    if horizon < settings.horizons[-1]:
        tiles = thinned(tiles, ENOUGH)
    means = tiles.size // every
    within = (np.arange(int(means.max())) < means[:, None]).astype(float)
    memory = memory_at(model, voyage.trial, tiles.first)
    covariance = command_timing_covariance(
        voyage.trial, model, tiles, every, within.shape[1], voyage.track
    )
    shift = float(unknowns.offset(z[None], OFFSETS[0])[0]) + model.delay
    kappa = sharpening_factor(shift, voyage.trial.dt)
    bare = RunSet(
        voyage, model, tiles, every, within, memory, noise, np.zeros(0), covariance, kappa=kappa
    )
    errors = errors_and_sensitivity(bare, unknowns, z)
    _, basis, _ = project_out_starts(errors, noise)
    return replace(bare, basis=basis, whitener=timing_whitener(errors, noise)[0])


def simulate_runs(
    window: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """Parameters z (K, n), starts moved by `nudge` (K, S, 3) -> reports (K, S, rows, 9)."""
    K, rows = len(z), window.rows.first
    theta = unknowns.theta(z, window.source.number)
    start = np.repeat(window.source.track[rows], K, axis=0)
    if nudge is not None:
        start[:, NU] += np.swapaxes(nudge, 0, 1).reshape(-1, 3)
    x0 = np.hstack(
        [window.model.true_states(start, theta=theta), np.repeat(window.memory, K, axis=0)]
    )
    runs = Runs(
        table=np.zeros(len(start), np.int64),
        start=np.repeat(rows, K),
        steps=np.repeat(window.rows.size - 1, K),
        delay=np.tile(unknowns.offset(z, OFFSETS[0]), len(rows)),
    )
    inputs = sharpened_commands(input_table(window.model, window.source.trial), window.kappa)
    _, reports = window.model.run(x0, runs, inputs, theta=theta)
    return reports.reshape(len(rows), K, -1, 9).swapaxes(0, 1)


def run_errors(
    window: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """The same -> means of measured − model over `every` rows: (K, S, n, 3)."""
    said = simulate_runs(window, unknowns, z, nudge)
    nu = said[..., NU].copy()
    nu[..., :2] -= unknowns.offset(z, OFFSETS[1])[:, None, None, None] * said[..., 6:8]
    trial, rows = window.source.trial, window.rows.first
    jerk = np.gradient(said[..., 6:9], trial.dt, axis=2)
    nu += unknowns.offset(z, ROUNDING)[:, None, None, None] * np.nan_to_num(jerk)
    at = np.minimum(rows[:, None] + np.arange(nu.shape[2]), len(trial) - 1)
    limit = LOST * scales_of(trial)
    error = np.clip(np.nan_to_num(trial.nu[at] - nu, nan=np.inf), -limit, limit)
    means = error.reshape(len(z), len(rows), -1, window.every, 3).mean(axis=3)
    return np.asarray(means * window.within[..., None])


def errors_and_sensitivity(window: RunSet, unknowns: Unknowns, z: Floats) -> RunErrors:
    """Errors at z (n,) and how they hang on the starts."""
    nudge = np.vstack([np.zeros(3), np.diag(START_STEP)])[:, None, :]
    nudge = np.repeat(nudge, len(window.rows.first), axis=1)
    error = run_errors(window, unknowns, np.tile(z, (4, 1)), nudge)
    phi = np.stack([(error[0] - error[i + 1]) / START_STEP[i] for i in range(3)], axis=-1)
    return RunErrors(error[0], phi, window.within, window.timing_covariance)


def projected_residuals(window: RunSet, error: Floats) -> Floats:
    """Errors (K, S, n, 3) -> whitened, without what a start explains: (K, N)."""
    w = apply_whitener(whitened(error, window.noise) * window.within[..., None], window.whitener)
    along = np.einsum("sncl,ksnc->ksl", window.basis, w, optimize=True)
    left = w - np.einsum("sncl,ksl->ksnc", window.basis, along, optimize=True)
    return left[:, window.within > 0].reshape(len(error), -1)


def residuals_of(unknowns: Unknowns, windows: Sequence[RunSet], z: Floats) -> Floats:
    """Parameters z (K, n) -> residuals (K, N), without priors."""
    return np.concatenate(
        [projected_residuals(w, run_errors(w, unknowns, z)) for w in windows], axis=1
    )


def jacobian_of(unknowns: Unknowns, windows: Sequence[RunSet], z: Floats) -> Floats:
    """∂ residuals / ∂ z by differences, away from the nearer limit: (N, n)."""
    of_trials = [(w.source.number, partial(residuals_of, unknowns, [w])) for w in windows]
    return stacked_jacobian(of_trials, unknowns, z)


def _fitted(
    unknowns: Unknowns, windows: Sequence[RunSet], z: Floats, settings: IdentifySettings
) -> tuple[Floats, Floats]:
    """The best z (n,) with starts and noise as they are, and how sure it is (n,)."""
    residuals = partial(residuals_of, unknowns, windows)
    slope = partial(jacobian_of, unknowns, windows)
    found = search(residuals, slope, unknowns, z, SearchLimits(settings.robust, 8, iterative=True))
    told = np.sum(found.jac**2, axis=0)
    return np.asarray(found.x), 1.0 / np.sqrt(np.maximum(told, 1e-300))


def _moved(window: RunSet, unknowns: Unknowns, z: Floats) -> TrialTrack:
    """The voyage with its motion where the model found it: starts of the next stage."""
    _, _, correction = project_out_starts(errors_and_sensitivity(window, unknowns, z), window.noise)
    trial, track = window.source.trial, window.source.track.copy()
    limit = scales_of(trial)
    nudge = np.clip(correction, -limit, limit)[None]
    found = simulate_runs(window, unknowns, z[None], nudge)[0, ..., NU]
    rows = window.rows.first[:, None] + np.arange(found.shape[1])
    within = np.arange(found.shape[1]) < window.rows.size[:, None]
    found, measured = found[within], trial.nu[rows[within]]
    near = np.all(np.abs(found - measured) < limit, axis=1)
    track[rows[within], NU] = np.where(near[:, None], found, measured)
    return replace(window.source, track=track)


def noise_of_runs(window: RunSet, unknowns: Unknowns, z: Floats) -> Noise:
    """The noise that makes what a model with numbers z (n,) leaves most likely."""
    step = window.every * window.source.trial.dt
    return estimate_noise(errors_and_sensitivity(window, unknowns, z), step, window.noise)


def _shot(
    unknowns: Unknowns,
    windows: Sequence[RunSet],
    z: Floats,
    settings: IdentifySettings,
    voyages: tuple[TrialTrack, ...],
) -> FitResult:
    """Residuals, slopes and weights at the end, each with its place in time."""
    residual = residuals_of(unknowns, windows, z[None])[0]
    moment, number = [], []
    for w in windows:
        rows = (w.rows.first[:, None] + np.zeros(w.within.shape[1], int))[w.within > 0]
        moment.append(np.repeat(w.source.trial.time[rows], 3))
        number.append(np.full(3 * len(rows), w.source.number))
    weight = robust_weights(residual, settings.robust)
    return FitResult(
        z, residual, jacobian_of(unknowns, windows, z), weight, np.concatenate(moment),
        np.concatenate(number), tuple(w.noise for w in windows), voyages,
    )  # fmt: skip


def information(
    unknowns: Unknowns,
    trial: Trial,
    z: Floats,
    noise: Noise,
    settings: IdentifySettings,
) -> Floats:
    """What a trial would tell of z at known noise, no outliers: JᵀJ (n, n), without priors."""
    voyage = TrialTrack(0, trial, trial.usable, measured_motion(trial))
    window = build_run_set(voyage, unknowns, z, noise, settings.horizons[-1], settings)
    slope = jacobian_of(unknowns, [window], z)
    return slope.T @ slope
