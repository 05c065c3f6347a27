"""Usable time as free runs that share no row, and the errors of a model over them.

An error of the start grows on a hull that is unstable on course. Where it would grow beyond a limit
the run is halved, and halved again: no time is lost, and no run leaves the track. Errors are
compared in means over several rows; they are bounded, and finite whatever the parameters.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.identification.command_timing import sharpened_commands
from sim.identification.noise import Noise, RunErrors
from sim.identification.parameters import OFFSETS, ROUNDING, Unknowns
from sim.model import Model, Runs
from sim.prediction.free_runs import memory_at
from sim.prediction.inputs import input_table, measured_motion
from sim.prediction.scales import scales_of
from sim.prediction.segments import VELOCITY_STEP, shifted_velocities, usable_stretches
from sim.state import Floats, Ints
from sim.trial import Trial

# Chosen, not measured:
MIN_MEANS = 3  # means in a run: three numbers are spent on its start
LARGEST_ERROR_SCALES = 100.0  # an error beyond this counts as this: the run left the track
NU = slice(3, 6)  # of a report


class RunRows(NamedTuple):
    """Free runs over rows first … first + size − 1 of a trial, each (S,)."""

    first: Ints
    size: Ints

    @classmethod
    def of(
        cls,
        trial: Trial,
        usable: NDArray[np.bool_],
        model: Model,
        length: float,
        growth: float,
        every: int,
    ) -> "RunRows":
        """Runs of `length` [s], shorter where a start's error would grow by more than `growth`.

        All hold a multiple of `every` rows.
        """
        runs = cls.divided(usable, max(round(length / trial.dt / every), MIN_MEANS), every)
        while True:
            long = runs.size >= 2 * MIN_MEANS * every
            long &= start_error_growth(trial, model, runs) > growth
            if not long.any():
                return runs
            runs = runs.halved(long, every)

    @classmethod
    def divided(cls, usable: NDArray[np.bool_], means: int, every: int) -> "RunRows":
        """Stretches into runs of about `means` times `every` rows; a short rest is left out."""
        first: list[int] = []
        size: list[int] = []
        for stretch in usable_stretches(usable):
            room = len(stretch) // every
            if room < MIN_MEANS:
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

    def every(self, step: int) -> "RunRows":
        """Every so many of the runs."""
        return RunRows(self.first[::step], self.size[::step])


def start_error_growth(trial: Trial, model: Model, runs: RunRows) -> Floats:
    """Largest growth of an error of u, v, r over each run: (S,); inf where a run diverges."""
    if not len(runs.first):
        return np.zeros(0)
    motion = measured_motion(trial)
    nu = shifted_velocities(model, trial, motion, runs.first, runs.size - 1)
    gain = np.abs(nu[:, 1:] - nu[:, :1]) / VELOCITY_STEP[None, :, None, None]
    within = np.arange(nu.shape[2]) < runs.size[:, None]
    lost = within & ~np.isfinite(nu).all(axis=(1, 3))
    gain = np.where(within[:, None, :, None], gain, 0.0)
    return np.where(lost.any(axis=1), np.inf, np.nan_to_num(gain, nan=0.0).max(axis=(1, 2, 3)))


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

    @classmethod
    def bare(
        cls, source: TrialTrack, model: Model, rows: RunRows, every: int, noise: Noise
    ) -> "RunSet":
        """Before any whitening."""
        means = rows.size // every
        within = (np.arange(int(means.max(initial=1))) < means[:, None]).astype(float)
        memory = memory_at(model, source.trial, rows.first)
        return cls(source, model, rows, every, within, memory, noise, np.zeros(0))

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
        steps=np.repeat(run_set.rows.size - 1, K),
        delay=np.tile(unknowns.offset(z, OFFSETS[0]), len(rows)),
    )
    inputs = sharpened_commands(input_table(run_set.model, run_set.source.trial), run_set.kappa)
    _, reports = run_set.model.run(x0, runs, inputs, theta=theta)
    return reports.reshape(len(rows), K, -1, 9).swapaxes(0, 1)


def run_errors(
    run_set: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """The same -> means of measured − model over `every` rows: (K, S, n, 3)."""
    rows = run_set.rows.first
    if not len(rows):
        return np.zeros((len(z), *run_set.within.shape, 3))
    reported = simulate_runs(run_set, unknowns, z, nudge)
    nu = reported[..., NU].copy()
    nu[..., :2] -= unknowns.offset(z, OFFSETS[1])[:, None, None, None] * reported[..., 6:8]
    trial = run_set.source.trial
    jerk = np.gradient(reported[..., 6:9], trial.dt, axis=2)
    nu += unknowns.offset(z, ROUNDING)[:, None, None, None] * np.nan_to_num(jerk)
    at = np.minimum(rows[:, None] + np.arange(nu.shape[2]), len(trial) - 1)
    limit = LARGEST_ERROR_SCALES * scales_of(trial)
    error = np.clip(np.nan_to_num(trial.nu[at] - nu, nan=np.inf), -limit, limit)
    means = error.reshape(len(z), len(rows), -1, run_set.every, 3).mean(axis=3)
    return np.asarray(means * run_set.within[..., None])


def errors_and_sensitivity(run_set: RunSet, unknowns: Unknowns, z: Floats) -> RunErrors:
    """Errors at z (n,) and their derivatives by the starts."""
    nudge = np.vstack([np.zeros(3), np.diag(VELOCITY_STEP)])[:, None, :]
    nudge = np.repeat(nudge, len(run_set.rows.first), axis=1)
    error = run_errors(run_set, unknowns, np.tile(z, (4, 1)), nudge)
    phi = np.stack([(error[0] - error[i + 1]) / VELOCITY_STEP[i] for i in range(3)], axis=-1)
    return RunErrors(error[0], phi, run_set.within, run_set.timing_covariance)
