"""Identification by free runs: what predicts best when it is left alone from the first sample.

    minimise over the parameters   Σ ρ( (measured − model left alone) / σ )  +  priors

Runs begin at the measured state and grow from seconds to whole stretches. σ of u, v, r is what the
fit leaves, so a channel that the model cannot tell does not pull at those that it can. There may be
more than one minimum, so the search is made twice, the second time with surge and yaw rate first,
and the likelier end is taken. Errors of a run hang together over seconds: each counts once per
correlation time. Where a model is not the whole truth, shooting fits what changes quickly and this
what lasts; for a model that is to run freely this is the measure. A hull that is unstable on course
leaves its track whatever the parameters: that one wants shooting. Source: Ljung, System
Identification, 2nd ed. 1999, §3.3, §7.2 (output error).
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.identification.noise import Noise
from sim.identification.parameters import Unknowns
from sim.identification.runs import divided
from sim.identification.search import SearchLimits, search, stacked_jacobian
from sim.identification.settings import IdentifySettings
from sim.identification.shooting import FitResult, RunSet, TrialTrack, run_errors, trial_tracks
from sim.model import Model
from sim.prediction.free_runs import memory_at
from sim.prediction.scales import scales_of
from sim.state import Floats
from sim.trial import Trial

LENGTHS_S = (5.0, 15.0, 45.0, 150.0)  # of the runs, stage by stage
ROUNDS = 3  # at the last: parameters and σ in turn
FIRST = (np.ones(3), np.array([1.0, 30.0, 1.0]))  # of σ: all channels at once, or sway last
LARGEST = 3.0  # scales: an error beyond that says only that the run left its track
LONGEST_S = 5.0  # that errors are taken to hang together: intervals see longer ones by blocks
SMALLEST = np.array([1e-4, 1e-4, 1e-5])  # m/s, m/s, rad/s


class Size(NamedTuple):
    """Of the errors: σ (3,), and how many rows one independent error stands for."""

    sigma: Floats
    rows: float


def fit_by_output_error(
    unknowns: Unknowns,
    trials: Sequence[Trial],
    usable: Sequence[NDArray[np.bool_]],
    settings: IdentifySettings,
    start: Floats | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> FitResult:
    """Parameters from trials; only rows that are `usable` count."""
    z = unknowns.start if start is None else start
    voyages = tuple(trial_tracks(trials, usable))
    ways = FIRST if start is None else FIRST[:1]
    tried = [_staged(unknowns, voyages, settings, z, way, start is None, tell) for way in ways]
    best = min(tried, key=lambda t: _cost(unknowns, t[0], t[1]))
    return _shot(unknowns, best[0], _size(unknowns, *best), best[1], settings, voyages)


def _staged(
    unknowns: Unknowns,
    voyages: Sequence[TrialTrack],
    settings: IdentifySettings,
    z: Floats,
    way: Floats,
    fresh: bool,
    tell: Callable[[str], None],
) -> tuple[list[RunSet], Floats]:
    """Longer and longer runs; σ is `way` times as large until the last stage."""
    windows: list[RunSet] = []
    for length in LENGTHS_S if fresh else ():
        tell(f"{length:g} s")
        windows = [_window(v, unknowns, z, length, settings) for v in voyages]
        size = _size(unknowns, windows, z)
        z = _fitted(unknowns, windows, size._replace(sigma=size.sigma * way), z, settings)
    for _ in range(ROUNDS):
        tell(f"{LENGTHS_S[-1]:g} s")
        windows = [_window(v, unknowns, z, LENGTHS_S[-1], settings) for v in voyages]
        z = _fitted(unknowns, windows, _size(unknowns, windows, z), z, settings)
    return windows, z


def _cost(unknowns: Unknowns, windows: Sequence[RunSet], z: Floats) -> float:
    """−2 log likelihood of white errors of unknown σ, each counted as it is independent."""
    size = _size(unknowns, windows, z)
    count = sum(float(w.within.sum()) for w in windows) / size.rows
    return float(2.0 * count * np.log(size.sigma).sum() + np.sum(unknowns.prior(z) ** 2))


def _window(
    voyage: TrialTrack, unknowns: Unknowns, z: Floats, length: float, settings: IdentifySettings
) -> RunSet:
    """Runs of one voyage, of about that length [s]."""
    model = Model(
        unknowns.model.vessel, unknowns.model.kernel, unknowns.model.names,
        unknowns.theta(z[None], voyage.number)[0],
    )  # fmt: skip
    every = max(round(settings.average / voyage.trial.dt), 1)
    tiles = divided(voyage.usable, max(round(length / voyage.trial.dt / every), 3), every)
    means = tiles.size // every
    within = (np.arange(int(means.max(initial=1))) < means[:, None]).astype(float)
    memory = memory_at(model, voyage.trial, tiles.first)
    noise = Noise(np.ones(3), np.zeros(3))
    return RunSet(voyage, model, tiles, every, within, memory, noise, np.zeros(0))


def _errors(window: RunSet, unknowns: Unknowns, z: Floats) -> Floats:
    """Errors (K, N, 3) of all means, run by run, at parameters z (K, n)."""
    if not len(window.rows.first):
        return np.zeros((len(z), 0, 3))
    limit = LARGEST * scales_of(window.source.trial)
    errors = run_errors(window, unknowns, z)[:, window.within > 0]
    return np.asarray(np.clip(errors, -limit, limit))


def _scaled(unknowns: Unknowns, windows: Sequence[RunSet], size: Size, z: Floats) -> Floats:
    """z (K, n) -> residuals (K, 3 N), one per independent error on the average."""
    errors = np.concatenate([_errors(w, unknowns, z) for w in windows], axis=1)
    return (errors / (size.sigma * np.sqrt(size.rows))).reshape(len(z), -1)


def _slope(unknowns: Unknowns, windows: Sequence[RunSet], size: Size, z: Floats) -> Floats:
    """∂ residuals / ∂ z by differences, away from the nearer limit: (3 N, n)."""
    of_trials = [(w.source.number, partial(_scaled, unknowns, [w], size)) for w in windows]
    return stacked_jacobian(of_trials, unknowns, z)


def _fitted(
    unknowns: Unknowns, windows: Sequence[RunSet], size: Size, z: Floats, s: IdentifySettings
) -> Floats:
    """The best z (n,) at σ as it is."""
    residuals = partial(_scaled, unknowns, windows, size)
    slope = partial(_slope, unknowns, windows, size)
    # one independent error is spread over `rows` residuals: what is robust must be so for those
    ends = SearchLimits(s.robust / np.sqrt(size.rows), 15, change=1e-5)
    return np.asarray(search(residuals, slope, unknowns, z, ends).x)


def _size(unknowns: Unknowns, windows: Sequence[RunSet], z: Floats) -> Size:
    """σ of each channel, and the correlation time of the slowest in rows."""
    errors = [_errors(w, unknowns, z[None])[0] for w in windows]
    sigma = np.maximum(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)), SMALLEST)
    unit = [e / sigma for e in errors if len(e) > 1]
    alike = np.sum([np.sum(e[1:] * e[:-1], axis=0) for e in unit], axis=0)
    rho = np.clip(alike / np.sum([np.sum(e[1:] ** 2, axis=0) for e in unit], axis=0), 0.0, 0.99)
    step = windows[0].every * windows[0].source.trial.dt
    return Size(sigma, float(min(np.max((1.0 + rho) / (1.0 - rho)), LONGEST_S / step)))


def _shot(
    unknowns: Unknowns,
    windows: Sequence[RunSet],
    size: Size,
    z: Floats,
    settings: IdentifySettings,
    voyages: tuple[TrialTrack, ...],
) -> FitResult:
    """Residuals, slopes and weights at the end, each with its place in time."""
    residual = _scaled(unknowns, windows, size, z[None])[0]
    moment, number = [], []
    for w in windows:
        step = w.every * w.source.trial.dt
        at = w.source.trial.time[w.rows.first][:, None] + step * np.arange(w.within.shape[1])
        moment.append(np.repeat(at[w.within > 0], 3))
        number.append(np.full(len(moment[-1]), w.source.number))
    weight = 1.0 / np.sqrt(1.0 + residual**2 * size.rows / settings.robust**2)
    return FitResult(
        z, residual, _slope(unknowns, windows, size, z), weight, np.concatenate(moment),
        np.concatenate(number), tuple(Noise(size.sigma, np.zeros(3)) for _ in windows), voyages,
    )  # fmt: skip
