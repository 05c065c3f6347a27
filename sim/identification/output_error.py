"""Output-error identification: what predicts best in free runs from the first sample.

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

from sim.identification.noise import Noise
from sim.identification.parameters import Unknowns
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
from sim.prediction.scales import scales_of
from sim.state import Floats, Progress

# Chosen, not measured:
LENGTHS_S = (5.0, 15.0, 45.0, 150.0)  # of the runs, stage by stage
ROUNDS = 3  # at the last length: parameters and σ in turn
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
    for length, factor in [*growing, *[(LENGTHS_S[-1], np.ones(3))] * ROUNDS]:
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
