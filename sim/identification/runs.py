"""Usable time as free runs that share no row, and the errors of a model over them.

An error of the start grows on a hull that is unstable on course. Where it would grow beyond a limit
along the measured track the run is halved, and halved again: no time is lost, and no run leaves the
track. Growth is not that of free runs: two of them leave an unstable equilibrium at once, settle in
the same spin and never part. Errors are compared in means over several rows; they are bounded, and
finite whatever the parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from sim.identification.at_rest import track_std
from sim.identification.innovations import (
    Chain,
    chain_of,
    estimate_chain_noise,
    follows_of,
)
from sim.identification.noise import (
    Noise,
    RunErrors,
    estimate_noise,
    restricted_deviance,
    sharpened_commands,
)
from sim.identification.parameters import OFFSETS, ROUNDING, Unknowns
from sim.model import InputTable, Model, Runs
from sim.prediction import input_table, measured_motion
from sim.prediction.free_runs import memory_of_each, scales_of
from sim.prediction.late import reported_before, true_starts
from sim.prediction.segments import VELOCITY_STEP, transitions, usable_stretches
from sim.state import Floats, Ints
from sim.trial import Trial

# Chosen, not measured:
MIN_MEANS = 3  # means in a run: three numbers are spent on its start …
MIN_MEANS_TIED = 2  # … or none, where a filter ties it to the run before
RUNS_TOGETHER = 12  # that stay tied to each other when some of the runs are left out
LARGEST_ERROR_SCALES = 100.0  # an error beyond this counts as this: the run left the track
MAX_RUNS_AT_ONCE = 3000  # of several trials in one call of the model: bounds the memory it takes
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
        """The same time, some of its runs cut in two."""
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

    @cached_property
    def reported(self) -> Floats:
        """The motion as it was reported (T, 9)."""
        return measured_motion(self.trial)


@dataclass(frozen=True)
class RunSet:
    """The runs of one trial, with all that does not change while the parameters do.

    Rows are compared in means of `every`; n of them in the longest run.

    within  (S, n) means that count, as 0 and 1
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
        follows = follows_of(rows.first, rows.size) if tied else None
        return cls(source, model, rows, every, within, noise, np.zeros(0), follows=follows)

    def subset(self, step: int) -> "RunSet":
        """Every so many of its runs; where they are tied, every so many groups of neighbours."""
        which = self.rows.every(step, 1 if self.follows is None else RUNS_TOGETHER)
        rows = self.rows.subset(which)
        whitener = None if self.whitener is None else self.whitener[which]
        some = replace(
            self, rows=rows, within=self.within[which],
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
        return estimate_chain_noise(errors, self.follows, self.track_std, self.mean_s)[0]

    def deviance_of(self, errors: RunErrors) -> float:
        """−2 log likelihood of errors of these runs under the noise that they show, but for a
        constant; of tied runs with command timing as it is.
        """
        if self.follows is None:
            return restricted_deviance(errors, self.noise_of(errors))
        held = (self.noise.command_timing,)
        noise, deviance = estimate_chain_noise(
            errors, self.follows, self.track_std, self.mean_s, held
        )
        if not self.is_coloured:
            return deviance
        chain = chain_of(errors, noise, self.follows, self.track_std, self.mean_s)
        white = chain.whitened(errors.error[None])[0].reshape(-1, 3)[self.counted]
        return deviance + chain.won_by_colour(white, self.mean_s)

    @property
    def is_coloured(self) -> bool:
        """Whether its residuals are under a colour."""
        return self.chain is not None and self.chain.colour is not None

    @property
    def track_std(self) -> Floats:
        """Of the measured u, v, r, as the trial states it: (3,)."""
        return track_std(self.source.trial)

    @cached_property
    def scales(self) -> Floats:
        """Of the trial's u, v, r: (3,)."""
        return scales_of(self.source.trial)

    @cached_property
    def counted(self) -> Ints:
        """Places of the means that count, run after run, among all S n of them."""
        return np.flatnonzero(self.within)

    @cached_property
    def inputs(self) -> InputTable:
        """Inputs that drive the model over the trial."""
        return sharpened_commands(input_table(self.model, self.source.trial), self.kappa)

    @property
    def steps(self) -> Ints:
        """Steps of each run (S,): to its last row, or on to the start of the run that follows."""
        size = self.rows.size
        return size - 1 if self.follows is None else size - 1 + self.follows.astype(np.int64)

    @property
    def mean_s(self) -> float:
        """Seconds from mean to mean."""
        return self.every * self.source.trial.dt


def simulate_runs(
    run_set: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """Parameters z (K, n), starts moved by `nudge` (K, S, 3) -> reports (K, S, rows, 9)."""
    (reports,) = _reports_together([run_set], unknowns, [z], nudge)
    return reports.swapaxes(0, 1)


def _reports_together(
    run_sets: Sequence[RunSet], unknowns: Unknowns, z: Sequence[Floats], nudge: Floats | None = None
) -> list[Floats]:
    """Of each trial at its own z (K, n) -> reports (S, K, rows, 9): one call of the model."""
    model, starts, thetas, runs = run_sets[0].model, [], [], []
    for i, (w, own) in enumerate(zip(run_sets, z, strict=True)):
        K, rows = len(own), w.rows.first
        theta = unknowns.theta(own, w.source.number)
        reported = w.source.reported
        moved = np.repeat(w.source.track[rows] - reported[rows], K, axis=0)
        if nudge is not None:
            moved[:, NU] += np.swapaxes(nudge, 0, 1).reshape(-1, 3)
        x0 = true_starts(model, theta, reported, rows, w.source.trial.dt, moved)
        memory = memory_of_each(model, w.source.trial, rows, theta)
        starts.append(np.hstack([x0, memory.reshape(len(x0), -1)]))
        # one vector for each of K runs in turn serves all of a trial alone
        thetas.append(theta if len(run_sets) == 1 else np.tile(theta, (len(rows), 1)))
        delay = np.tile(unknowns.offset(own, OFFSETS[0]), len(rows))
        table = np.full(len(x0), i)
        runs.append(Runs(table, np.repeat(rows, K), np.repeat(w.steps, K), delay))
    together = Runs(*map(np.concatenate, zip(*(vars(r).values() for r in runs), strict=True)))
    inputs = InputTable.stacked(tuple(w.inputs for w in run_sets))
    _, reports = model.run(np.concatenate(starts), together, inputs, theta=np.concatenate(thetas))
    out, done = list[Floats](), 0
    for w, start in zip(run_sets, starts, strict=True):
        part = reports[done : done + len(start), : int(w.steps.max(initial=0)) + 1]
        own = part.reshape(len(w.rows.first), -1, *part.shape[1:])
        theta = thetas[len(out)][: own.shape[1]]
        reported_before(model, theta, own, w.source.reported, w.rows.first, w.source.trial.dt)
        out.append(own)
        done += len(start)
    return out


def run_errors(
    run_set: RunSet, unknowns: Unknowns, z: Floats, nudge: Floats | None = None
) -> Floats:
    """Errors of runs as means of measured − model over `every` rows: (K, S, n, 3).

    Tied runs have one more, the last: measured start of the next run − end of this one, where it
    follows.
    """
    if not len(run_set.rows.first):
        return _no_errors(run_set, z)
    (reports,) = _reports_together([run_set], unknowns, [z], nudge)
    return _errors_of(run_set, unknowns, z, reports)


def errors_of_trials(
    run_sets: Sequence[RunSet], unknowns: Unknowns, z: Sequence[Floats]
) -> list[Floats]:
    """`run_errors` of several trials, each at its own z (K, n), in few calls of the model."""
    out = [_no_errors(w, own) for w, own in zip(run_sets, z, strict=True)]
    for some in _groups(run_sets, z):
        sets, own = [run_sets[i] for i in some], [z[i] for i in some]
        for i, reports in zip(some, _reports_together(sets, unknowns, own), strict=True):
            out[i] = _errors_of(run_sets[i], unknowns, z[i], reports)
    return out


def _no_errors(run_set: RunSet, z: Floats) -> Floats:
    """Errors of a trial without runs: empty, in the shape of the errors of others."""
    n = run_set.within.shape[1] + (run_set.follows is not None)
    return np.zeros((len(z), len(run_set.rows.first), n, 3))


def _groups(run_sets: Sequence[RunSet], z: Sequence[Floats]) -> list[list[int]]:
    """Numbers of the trials with runs that go together: of one time step, and not too many runs."""
    groups: list[list[int]] = []
    size = 0
    for i, (w, own) in enumerate(zip(run_sets, z, strict=True)):
        runs = len(own) * len(w.rows.first)
        if not runs:
            continue
        dt = w.source.trial.dt
        if (
            not groups
            or size + runs > MAX_RUNS_AT_ONCE
            or run_sets[groups[-1][0]].source.trial.dt != dt
        ):
            groups.append([])
            size = 0
        groups[-1].append(i)
        size += runs
    return groups


def _errors_of(run_set: RunSet, unknowns: Unknowns, z: Floats, reports: Floats) -> Floats:
    """Reports (S, K, rows, 9) -> errors (K, S, n, 3), of tied runs (K, S, n + 1, 3)."""
    trial, tied = run_set.source.trial, run_set.follows is not None
    out = _no_errors(run_set, z)
    _mean_errors(
        reports, trial.nu, run_set.source.track[:, NU], run_set.rows.first, run_set.rows.size,
        run_set.every, unknowns.offset(z, OFFSETS[1]), unknowns.offset(z, ROUNDING), trial.dt,
        LARGEST_ERROR_SCALES * run_set.scales, run_set.steps, tied, out,
    )  # fmt: skip
    return out


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mean_errors(  # type: ignore[no-untyped-def]
    reports, nu, track, first, size, every, late, rounding, dt, limit, steps, tied, out
):
    """Errors (S, K, rows) of what is reported `late` [s] and rounded, in means; with the gaps."""
    S, K, rows, _ = reports.shape
    for s in range(S):
        for k in range(K):
            own = reports[s, k]
            for i in range(size[s]):
                at = min(first[s] + i, len(nu) - 1)
                a, b = max(i - 1, 0), min(i + 1, rows - 1)
                for c in range(3):
                    value = own[i, 3 + c]
                    if c < 2:
                        value -= late[k] * own[i, 6 + c]
                    jerk = (own[b, 6 + c] - own[a, 6 + c]) / ((b - a) * dt)
                    if np.isfinite(jerk):
                        value += rounding[k] * jerk
                    error = nu[at, c] - value
                    error = min(max(error, -limit[c]), limit[c]) if error == error else limit[c]
                    out[k, s, i // every, c] += error / every
            if tied and steps[s] >= size[s]:
                at = min(first[s] + size[s], len(nu) - 1)
                for c in range(3):
                    gap = track[at, c] - own[steps[s], 3 + c]
                    gap = min(max(gap, -limit[c]), limit[c]) if gap == gap else limit[c]
                    out[k, s, out.shape[2] - 1, c] = gap


def errors_and_sensitivity(run_set: RunSet, unknowns: Unknowns, z: Floats) -> RunErrors:
    """Errors at z (n,) and their derivatives by the starts."""
    nudge = np.vstack([np.zeros(3), np.diag(VELOCITY_STEP)])[:, None, :]
    nudge = np.repeat(nudge, len(run_set.rows.first), axis=1)
    error = run_errors(run_set, unknowns, np.tile(z, (4, 1)), nudge)
    phi = np.stack([(error[0] - error[i + 1]) / VELOCITY_STEP[i] for i in range(3)], axis=-1)
    return RunErrors(error[0], phi, run_set.within, run_set.timing_covariance)
