"""Usable time as free runs that share no row, and the errors of a model over them.

An error of the start grows on a hull that is unstable on course. Where it would grow beyond a limit
along the measured track the run is halved, and halved again: no time is lost, and no run leaves the
track. Growth is not that of free runs: two of them leave an unstable equilibrium at once, settle in
the same spin and never part. Errors are compared in means over several rows; they are bounded, and
finite whatever the parameters.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.identification.command_timing import sharpened_commands
from sim.identification.innovations import (
    Chain,
    chain_of,
    estimate_chain_noise,
    follows_of,
    track_std,
)
from sim.identification.noise import Noise, RunErrors, estimate_noise, restricted_deviance
from sim.identification.parameters import OFFSETS, ROUNDING, Unknowns
from sim.model import Model, Runs
from sim.prediction.free_runs import memory_at
from sim.prediction.inputs import input_table
from sim.prediction.scales import scales_of
from sim.prediction.segments import VELOCITY_STEP, transitions, usable_stretches
from sim.state import Floats, Ints
from sim.trial import Trial

# Chosen, not measured:
MIN_MEANS = 3  # means in a run: three numbers are spent on its start …
MIN_MEANS_TIED = 2  # … or none, where a filter ties it to the run before
RUNS_TOGETHER = 12  # that stay tied to each other when some of the runs are left out
LARGEST_ERROR_SCALES = 100.0  # an error beyond this counts as this: the run left the track
NU = slice(3, 6)  # of a report


class RunRows(NamedTuple):
    """Free runs over rows first … first + size − 1 of a trial, each (S,)."""

    first: Ints
    size: Ints

    @classmethod
    def of(
        cls, trial: Trial, usable: NDArray[np.bool_], model: Model, length: float, growth: float,
        every: int, least: int = MIN_MEANS,
    ) -> "RunRows":  # fmt: skip
        """Runs of `length` [s], shorter where a start's error would grow by more than `growth`.

        All hold a multiple of `every` rows, and `least` times as many at least.
        """
        means = max(round(length / trial.dt / every), least)
        runs = cls.divided(usable, means, every, least)
        per_mean = _mean_transitions(trial, model, every)
        while True:
            long = runs.size >= 2 * least * every
            long &= start_error_growth(per_mean, runs, every) > growth
            if not long.any():
                return runs
            runs = runs.halved(long, every)

    @classmethod
    def divided(
        cls, usable: NDArray[np.bool_], means: int, every: int, least: int = MIN_MEANS
    ) -> "RunRows":
        """Stretches into runs of about `means` times `every` rows; a short rest is left out."""
        first: list[int] = []
        size: list[int] = []
        for stretch in usable_stretches(usable):
            room = len(stretch) // every
            if room < least:
                continue
            edges = np.linspace(0, room, max(round(room / means), 1) + 1)
            whole = stretch.start + every * np.round(edges).astype(int)
            first += whole[:-1].tolist()
            size += np.diff(whole).tolist()
        return cls(np.array(first, np.int64), np.array(size, np.int64))

    def halved(self, which: NDArray[np.bool_], every: int) -> "RunRows":
        """The same time with some runs in two."""
        half = self.size // (2 * every) * every
        first = np.concatenate([self.first, (self.first + half)[which]])
        size = np.concatenate([np.where(which, half, self.size), (self.size - half)[which]])
        order = np.argsort(first)
        return RunRows(first[order], size[order])

    def every(self, step: int, together: int = 1) -> Ints:
        """Numbers of every so many of the runs, so many neighbours together."""
        number = np.arange(len(self.first))
        return number[number // together % step == 0]

    def subset(self, which: Ints) -> "RunRows":
        """Some of the runs."""
        return RunRows(self.first[which], self.size[which])


def _mean_transitions(trial: Trial, model: Model, every: int) -> Floats:
    """∂ velocity after `every` rows / ∂ velocity along the measured track: (T, 3, 3).

    NaN where the model diverges or the trial ends.
    """
    rows = np.arange(len(trial) - every)
    rows = rows[:: max(every // 2, 1)]  # a run begins anywhere: the nearest row before it counts
    A = np.full((len(trial), 3, 3), np.nan)
    if len(rows):
        nearest = np.minimum(np.arange(len(trial)) // max(every // 2, 1), len(rows) - 1)
        A = transitions(model, trial, rows, every)[:, 3:, 3:][nearest]
    return A


def start_error_growth(per_mean: Floats, runs: RunRows, every: int) -> Floats:
    """Largest growth of an error of u, v, r over each run: (S,); inf where the model diverges.

    per_mean  (T, 3, 3) from `_mean_transitions`
    """
    count = runs.size // every
    phi = np.tile(np.eye(3), (len(count), 1, 1))
    most = np.ones(len(count))
    for j in range(int(count.max(initial=0)) - 1):
        going = np.flatnonzero(count - 1 > j)
        at = np.minimum(runs.first[going] + j * every, len(per_mean) - 1)
        phi[going] = np.nan_to_num(per_mean[at], nan=1e9) @ phi[going]
        most[going] = np.maximum(most[going], np.abs(phi[going]).max(axis=(1, 2)))
    return most


@dataclass(frozen=True)
class TrialTrack:
    """A trial, which of its rows count (T,), and the motion that runs start from.

    track  (T, 9) as reported; velocities are those of the model, once a fit has moved the starts
    """

    number: int
    trial: Trial
    usable: NDArray[np.bool_]
    track: Floats


@dataclass(frozen=True)
class RunSet:
    """The runs of one trial, with all that does not change while the parameters do.

    Rows are compared in means of `every`; n of them in the longest run.

    within  (S, n) means that count, as 0 and 1
    memory  (S, nx − 6) of actuators and effects at the starts
    basis   (S, n, 3, 3) of what a start explains in the whitened residuals
    timing_covariance  (S, 3n, 3n) that command timing may add; whitener (S, 3n, 3n) of it
    kappa   sharpening of commands that are shifted by part of a row
    follows (S,) whether a run is tied to the next, as 0 and 1; None where each starts freely
    chain   the filter that ties them
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
    follows: Floats | None = None
    chain: Chain | None = None

    @classmethod
    def bare(
        cls, source: TrialTrack, model: Model, rows: RunRows, every: int, noise: Noise,
        tied: bool = False,
    ) -> "RunSet":  # fmt: skip
        """Before any whitening; `tied`: by a filter, see `sim.identification.innovations`."""
        means = rows.size // every
        within = (np.arange(int(means.max(initial=1))) < means[:, None]).astype(float)
        memory = memory_at(model, source.trial, rows.first)
        follows = follows_of(rows.first, rows.size) if tied else None
        return cls(source, model, rows, every, within, memory, noise, np.zeros(0), follows=follows)

    def subset(self, step: int) -> "RunSet":
        """Every so many of its runs; where they are tied, every so many groups of neighbours."""
        which = self.rows.every(step, 1 if self.follows is None else RUNS_TOGETHER)
        rows = self.rows.subset(which)
        whitener = None if self.whitener is None else self.whitener[which]
        some = replace(
            self, rows=rows, within=self.within[which], memory=self.memory[which],
            basis=self.basis[which] if self.chain is None else self.basis, whitener=whitener,
        )  # fmt: skip
        if self.chain is None:
            return some
        follows = follows_of(rows.first, rows.size)
        return replace(some, follows=follows, chain=self.chain.subset(which, follows))

    def noise_of(self, errors: RunErrors) -> Noise:
        """The noise under which errors of these runs are most likely."""
        if self.follows is None:
            return estimate_noise(errors, self.mean_s, self.noise)
        return estimate_chain_noise(errors, self.follows, self.track_std, self.mean_s)

    def deviance_of(self, errors: RunErrors) -> float:
        """−2 log likelihood of errors of these runs under the noise that they show, but for a
        constant; of tied runs with command timing as it is.
        """
        if self.follows is None:
            return restricted_deviance(errors, self.noise_of(errors))
        held = (self.noise.command_timing,)
        noise = estimate_chain_noise(errors, self.follows, self.track_std, self.mean_s, held)
        return chain_of(errors, noise, self.follows, self.track_std, self.mean_s).deviance

    @property
    def track_std(self) -> Floats:
        """Of the measured u, v, r, as the trial states it: (3,)."""
        return track_std(self.source.trial)

    @property
    def mean_s(self) -> float:
        """Seconds from mean to mean."""
        return self.every * self.source.trial.dt


def simulate_runs(
    run_set: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """Parameters z (K, n), starts moved by `nudge` (K, S, 3) -> reports (K, S, rows, 9)."""
    K, rows = len(z), run_set.rows.first
    theta = unknowns.theta(z, run_set.source.number)
    start = np.repeat(run_set.source.track[rows], K, axis=0)
    if nudge is not None:
        start[:, NU] += np.swapaxes(nudge, 0, 1).reshape(-1, 3)
    x0 = np.hstack(
        [run_set.model.true_states(start, theta=theta), np.repeat(run_set.memory, K, axis=0)]
    )
    runs = Runs(
        table=np.zeros(len(start), np.int64),
        start=np.repeat(rows, K),
        steps=np.repeat(_steps(run_set), K),
        delay=np.tile(unknowns.offset(z, OFFSETS[0]), len(rows)),
    )
    inputs = sharpened_commands(input_table(run_set.model, run_set.source.trial), run_set.kappa)
    _, reports = run_set.model.run(x0, runs, inputs, theta=theta)
    return reports.reshape(len(rows), K, -1, 9).swapaxes(0, 1)


def _steps(run_set: RunSet) -> Ints:
    """Steps of each run (S,): to its last row, or on to the start of the run that follows."""
    size = run_set.rows.size
    return size - 1 if run_set.follows is None else size - 1 + run_set.follows.astype(np.int64)


def run_errors(
    run_set: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """The same -> means of measured − model over `every` rows: (K, S, n, 3).

    Tied runs have one more, the last: measured start of the next run − end of this one, where it
    follows.
    """
    rows, n = run_set.rows.first, run_set.within.shape[1]
    if not len(rows):
        return np.zeros((len(z), 0, n + (run_set.follows is not None), 3))
    reported = simulate_runs(run_set, unknowns, z, nudge)
    nu = reported[..., NU].copy()
    nu[..., :2] -= unknowns.offset(z, OFFSETS[1])[:, None, None, None] * reported[..., 6:8]
    trial = run_set.source.trial
    jerk = np.gradient(reported[..., 6:9], trial.dt, axis=2)
    nu += unknowns.offset(z, ROUNDING)[:, None, None, None] * np.nan_to_num(jerk)
    nu = nu[:, :, : n * run_set.every]
    at = np.minimum(rows[:, None] + np.arange(nu.shape[2]), len(trial) - 1)
    limit = LARGEST_ERROR_SCALES * scales_of(trial)
    error = np.clip(np.nan_to_num(trial.nu[at] - nu, nan=np.inf), -limit, limit)
    means = error.reshape(len(z), len(rows), -1, run_set.every, 3).mean(axis=3)
    means = np.asarray(means * run_set.within[..., None])
    if run_set.follows is None:
        return means
    end = np.arange(len(rows)), run_set.rows.size - 1 + run_set.follows.astype(np.int64)
    following = np.minimum(rows + run_set.rows.size, len(trial) - 1)
    gap = run_set.source.track[following, NU] - reported[:, end[0], end[1]][..., NU]
    gap = np.clip(np.nan_to_num(gap, nan=np.inf), -limit, limit) * run_set.follows[:, None]
    return np.concatenate([means, gap[:, :, None]], axis=2)


def errors_and_sensitivity(run_set: RunSet, unknowns: Unknowns, z: Floats) -> RunErrors:
    """Errors at z (n,) and their derivatives by the starts."""
    nudge = np.vstack([np.zeros(3), np.diag(VELOCITY_STEP)])[:, None, :]
    nudge = np.repeat(nudge, len(run_set.rows.first), axis=1)
    error = run_errors(run_set, unknowns, np.tile(z, (4, 1)), nudge)
    phi = np.stack([(error[0] - error[i + 1]) / VELOCITY_STEP[i] for i in range(3)], axis=-1)
    return RunErrors(error[0], phi, run_set.within, run_set.timing_covariance)
