"""What the best model still leaves, and what it hangs on: place, time, heading, thrust …

Groups of pushes that the model does not know (`sim.diagnosis.force_terms`) are regressed on what
the fit leaves, together with its own numbers, on blocks of time that the regression did not see. A
group that foretells them names what the catalogue does not hold. In the runs, and not in the
missing force itself: that holds the noise of the very velocities that the terms are made of, and
always seems to depend on them. Sparse regression on physical terms: Brunton, Proctor and Kutz, PNAS
113, 2016; by groups, because terms of one group stand in for each other.

The noise is that of the most promising group. Estimated from what the fit leaves, it takes the very
thing that is looked for as a slow error of the sensors, and forgives it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from sim.diagnosis.fit import ROBUST, Fit, Rows
from sim.diagnosis.force_terms import OWN, SAYS, moved_by
from sim.diagnosis.heldout import CLIP, Gain, gain
from sim.identification.noise import (
    MIN_SIGMA,
    Noise,
    RunErrors,
    estimate_noise,
)
from sim.identification.runs import RunSet, errors_and_sensitivity, run_errors
from sim.identification.search import robust_weights, stacked_jacobian
from sim.identification.shooting import projected_residuals, whitened_run_set
from sim.state import Floats

RIDGE = 3.0  # in whitened rows: how much a term must say before it is listened to
AXES = ("surge", "sway", "yaw")
SOON = 0.5  # s, after which noise that forgives nothing slow is forgotten
NORMAL = 0.6745  # median of |x| over its standard deviation
ROUNDS = 9  # of the noise, at most: each looks at its neighbours on a grid


@dataclass(frozen=True)
class Dependence:
    """One group of terms, what it is worth on unseen time, and the axes that it acts on."""

    on: str
    gain: Gain
    axes: tuple[str, ...]

    @property
    def share(self) -> float:
        """Of the squared errors of the best model, on unseen time, that the group foretells."""
        return 1.0 - 1.0 / self.gain.ratio

    @property
    def says(self) -> str:
        """In words."""
        axes = " and ".join(filter(None, [", ".join(self.axes[:-1]), *self.axes[-1:]]))
        return f"what is missing in {axes} depends on {SAYS[self.on]}"


def dependences(fit: Fit) -> list[Dependence]:
    """Every group and what it foretells, the strongest first."""
    trials = [_Trial.of(fit, w) for w in fit.ground.seen_by(fit.unknowns, fit.z)]
    noises = [t.window.noise for t in trials], [t.blunt() for t in trials]
    looks = [_White.of(fit, trials, noise) for noise in noises]
    first = max(looks, key=lambda look: look.best.gain.nats)
    return _White.of(fit, trials, first.noise_without(first.best.on)).dependences


@dataclass(frozen=True)
class _Trial:
    """Errors of one trial's runs and all that would change them, before any whitening.

    slope  (S, n, 3, m) of the fit's numbers; moved (S, n, 3, K) by the terms of each group
    """

    window: RunSet
    errors: RunErrors
    slope: Floats
    moved: Mapping[str, Floats]

    @classmethod
    def of(cls, fit: Fit, window: RunSet) -> "_Trial":
        errors, unknowns = errors_and_sensitivity(window, fit.unknowns, fit.z), fit.unknowns

        def flat(z: Floats) -> Floats:
            return run_errors(window, unknowns, z).reshape(len(z), -1)

        slope = stacked_jacobian([(window.source.number, flat)], unknowns, fit.z)
        slope = slope.reshape(*errors.error.shape, -1)
        return cls(window, errors, slope, moved_by(fit, window))

    def blunt(self) -> Noise:
        """Noise that forgives nothing slow: as large as the errors, and soon forgotten."""
        inside = self.errors.error[self.errors.within > 0]
        size = np.median(np.abs(inside), axis=0) / NORMAL
        rho = np.full(3, np.exp(-self.step / SOON))
        return Noise(np.maximum(size, MIN_SIGMA), rho, self.window.noise.command_timing)

    @property
    def step(self) -> float:
        """Seconds from mean to mean."""
        return self.window.mean_s

    def under(self, noise: Noise) -> RunSet:
        """The window with another noise."""
        return whitened_run_set(self.window, self.errors, noise)

    def noise_without(self, gone: Floats) -> Noise:
        """The noise that makes what is left most likely once (S, n, 3) is explained."""
        left, noise = self.errors._replace(error=self.errors.error - gone), self.window.noise
        for _ in range(ROUNDS):
            before, noise = noise, estimate_noise(left, self.step, noise)
            if np.array_equal(before.rho, noise.rho):
                break
        return noise


@dataclass(frozen=True)
class _White:
    """All trials whitened: residual (N,), weight (N,), slope (N, m), terms (N, K) of each group."""

    fit: Fit
    trials: Sequence[_Trial]
    residual: Floats
    weight: Floats
    slope: Floats
    terms: Mapping[str, Floats]

    @classmethod
    def of(cls, fit: Fit, trials: Sequence[_Trial], noise: Sequence[Noise]) -> "_White":
        windows = [t.under(n) for t, n in zip(trials, noise, strict=True)]
        pairs = list(zip(windows, trials, strict=True))
        residual = np.concatenate(
            [projected_residuals(w, t.errors.error[None])[0] for w, t in pairs]
        )
        terms = {}
        for on in trials[0].moved:
            each = [_rows(w, t.moved[on]) for w, t in pairs]
            terms[on] = block_diag(*each) if on in OWN else np.concatenate(each)
        return cls(
            fit, trials, residual, robust_weights(residual, ROBUST),
            np.concatenate([_rows(w, t.slope) for w, t in pairs]), terms,
        )  # fmt: skip

    @property
    def best(self) -> Dependence:
        """The group that foretells most."""
        return self.dependences[0]

    @cached_property
    def dependences(self) -> list[Dependence]:
        """What each group foretells of time that its regression did not see, the best first."""
        before = self._foretold(self.slope[:, :0])
        found = []
        for on, terms in self.terms.items():
            after = self._foretold(terms)
            worth = gain(before, after, self.fit.ground.block)
            found.append(Dependence(on, worth, _axes(before, after)))
        return sorted(found, key=lambda d: -d.gain.nats)

    def noise_without(self, on: str) -> list[Noise]:
        """Noise of each trial as the fit with the terms of a group leaves it."""
        found, at, out = self._regressed(self.terms[on])[self.slope.shape[1] :], 0, []
        for trial in self.trials:
            moved = trial.moved[on]
            mine = found[at : at + moved.shape[-1]] if on in OWN else found
            at += moved.shape[-1]
            out.append(trial.noise_without(moved @ mine))
        return out

    def _foretold(self, terms: Floats) -> Floats:
        """What a fit with terms (N, K) leaves of the blocks that it did not see: (N,)."""
        out, both = self.residual.copy(), np.hstack([self.slope, terms])
        for seen, judge in self.fit.ground.folds():
            found = self._regressed(terms, seen)
            out[judge] -= np.asarray(both[judge] @ found)
        return out

    def _regressed(self, terms: Floats, rows: Rows = slice(None)) -> Floats:
        """Changes of the fit's numbers, and sizes of the terms: (m + K,)."""
        unknowns, m = self.fit.unknowns, self.slope.shape[1]
        A, w = np.hstack([self.slope, terms])[rows], self.weight[rows]
        P = np.array([u.prior for u in unknowns.each]) ** -2.0
        size = np.mean(terms**2, axis=0)
        H = A.T @ (w[:, None] * A) + np.diag(np.append(P, RIDGE * np.maximum(size, 1e-24)))
        s = A.T @ (w * self.residual[rows])
        s[:m] += P * (self.fit.z - unknowns.start)
        return np.asarray(np.linalg.lstsq(H, s, rcond=1e-12)[0])


def _rows(window: RunSet, means: Floats) -> Floats:
    """Means (S, n, 3, K) as residuals: (N, K)."""
    return np.ascontiguousarray(projected_residuals(window, np.moveaxis(means, -1, 0)).T)


def _axes(before: Floats, after: Floats) -> tuple[str, ...]:
    """The axes on which a group helps."""
    was, left = (np.clip(r.reshape(-1, 3), -CLIP, CLIP) for r in (before, after))
    won = np.sum(was**2 - left**2, axis=0)
    helped = won > 0.2 * max(float(won.max()), 1e-9)
    return tuple(AXES[i] for i in range(3) if helped[i])
