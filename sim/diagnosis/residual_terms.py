"""What the best model still leaves, and what it depends on: place, time, heading, thrust …

Groups of forces that the model does not know (`sim.diagnosis.force_terms`) are regressed on what
the fit leaves, together with its own numbers, on blocks of time that the regression did not see. A
group that predicts them names what the catalogue does not hold. Some groups can be made a constant
push, at one heading and one speed most of them: beside such a push a group is told only where it
predicts what the push cannot. In the runs, and not in the missing force itself: that holds the
noise of the very velocities that the terms are made of, and always seems to depend on them. Sparse
regression on physical terms: Brunton, Proctor and Kutz, PNAS 113, 2016; by groups, because terms of
one group stand in for each other.

The noise is that of the most promising group. Estimated from what the fit leaves, it takes the very
thing that is looked for as a slow error of the sensors, and forgives it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from sim.diagnosis import thresholds
from sim.diagnosis.fit import Fit, Rows
from sim.diagnosis.force_terms import ALWAYS, GROUPS, PER_TRIAL, error_responses
from sim.diagnosis.heldout import Gain, gain
from sim.identification.noise import MIN_SIGMA, Noise, RunErrors, estimate_noise
from sim.identification.runs import RunSet, errors_and_sensitivity, run_errors
from sim.identification.search import residuals_and_jacobian, robust_weights
from sim.identification.shooting import projected_residuals, whitened_run_set
from sim.prediction import missing_force_only
from sim.prediction.segments import usable_stretches
from sim.state import Floats

AXES = ("surge", "sway", "yaw")
SEGMENT_S = 25.0  # of each spectrum that is averaged (Welch, IEEE Trans. AU 15, 1967)
FREQUENCIES_HZ = 0.15 * 2.0 ** (np.arange(12) / 4.0)  # where a hump is looked for
MEDIAN_OF_ABSOLUTE = 0.6745  # of a normal variable, over its standard deviation
# What a group has to add to a constant push, to be told beside it. On a drift at one heading and
# one speed both groups added 9 nats to 1200: so much the ridge leaves of the push.
MIN_NATS_BESIDE_A_PUSH, MIN_SHARE_BESIDE_A_PUSH = 5.0, 0.03  # nats; of what the push predicts


@dataclass(frozen=True)
class Dependence:
    """One group of terms, what it is worth on held-out time, and the axes that it acts on.

    beside_push  nats that it adds to what a constant push predicts; 0 of that push
    """

    on: str
    gain: Gain
    axes: tuple[str, ...]
    beside_push: float

    @property
    def share(self) -> float:
        """Of the squared errors of the best model, on held-out time, that the group predicts."""
        return 1.0 - 1.0 / self.gain.ratio

    @property
    def description(self) -> str:
        """In words."""
        axes = " and ".join(filter(None, [", ".join(self.axes[:-1]), *self.axes[-1:]]))
        return f"what is missing in {axes} depends on {GROUPS[self.on]}"


def dependences(fit: Fit) -> list[Dependence]:
    """Every group and what it predicts, the strongest first."""
    trials = [_TrialErrors.of(fit, r) for r in fit.problem.run_sets_for(fit.unknowns, fit.z)]
    noises = [t.runs.noise for t in trials], [t.short_noise() for t in trials]
    looks = [_WhitenedTerms.of(fit, trials, noise) for noise in noises]
    first = max(looks, key=lambda look: look.dependences[0].gain.nats)
    noise = first.noise_without(first.dependences[0].on)
    return _WhitenedTerms.of(fit, trials, noise).dependences


def without_repeats(told: Sequence[Dependence]) -> list[Dependence]:
    """Where a constant push is told, without the groups that are little but that push."""
    push = next((d.gain.nats for d in told if d.on == ALWAYS), None)
    if push is None:
        return list(told)
    least = max(MIN_NATS_BESIDE_A_PUSH, MIN_SHARE_BESIDE_A_PUSH * push)
    return [d for d in told if d.on == ALWAYS or d.beside_push > least]


@dataclass(frozen=True)
class _TrialErrors:
    """Errors of one trial's runs and all that would change them, before any whitening.

    jacobian  (S, n, 3, m) of the fit's numbers; responses (S, n, 3, K) to the terms of each group
    """

    runs: RunSet
    errors: RunErrors
    jacobian: Floats
    responses: Mapping[str, Floats]

    @classmethod
    def of(cls, fit: Fit, runs: RunSet) -> "_TrialErrors":
        errors, unknowns = errors_and_sensitivity(runs, fit.unknowns, fit.z), fit.unknowns

        def flat(each: Sequence[Floats]) -> list[Floats]:
            return [run_errors(runs, unknowns, z).reshape(len(z), -1) for z in each]

        _, jacobian = residuals_and_jacobian(flat, [runs.source.number], unknowns, fit.z)
        jacobian = jacobian.reshape(*errors.error.shape, -1)
        return cls(runs, errors, jacobian, error_responses(fit, runs))

    def short_noise(self) -> Noise:
        """Noise that forgives nothing slow: as large as the errors, and soon forgotten.

        Innovations forgive nothing slow as they are.
        """
        if self.runs.follows is not None:
            return self.runs.noise
        inside = self.errors.error[self.errors.within > 0]
        size = np.median(np.abs(inside), axis=0) / MEDIAN_OF_ABSOLUTE
        rho = np.full(3, np.exp(-self.runs.mean_s / thresholds.SHORT_MEMORY_S))
        return Noise(np.maximum(size, MIN_SIGMA), rho, self.runs.noise.command_timing)

    def noise_without(self, explained: Floats) -> Noise:
        """The noise that makes what is left most likely once (S, n, 3) is explained."""
        left, noise = self.errors._replace(error=self.errors.error - explained), self.runs.noise
        if self.runs.follows is not None:
            return self.runs.noise_of(left)
        for _ in range(thresholds.MAX_RESIDUAL_NOISE_ROUNDS):
            before, noise = noise, estimate_noise(left, self.runs.mean_s, noise)
            if np.array_equal(before.rho, noise.rho):
                break
        return noise


@dataclass(frozen=True)
class _WhitenedTerms:
    """All trials whitened: residual, weight (N,), jacobian (N, m), terms (N, K) of each group."""

    fit: Fit
    trials: Sequence[_TrialErrors]
    residual: Floats
    weight: Floats
    jacobian: Floats
    terms: Mapping[str, Floats]

    @classmethod
    def of(
        cls, fit: Fit, trials: Sequence[_TrialErrors], noise: Sequence[Noise]
    ) -> "_WhitenedTerms":
        each = zip(trials, noise, strict=True)
        pairs = [(whitened_run_set(t.runs, t.errors, n), t) for t, n in each]
        errors = [projected_residuals(runs, t.errors.error[None])[0] for runs, t in pairs]
        residual, terms = np.concatenate(errors), {}
        for on in trials[0].responses:
            parts = [_whitened(runs, t.responses[on]) for runs, t in pairs]
            terms[on] = block_diag(*parts) if on in PER_TRIAL else np.concatenate(parts)
        jacobian = np.concatenate([_whitened(runs, t.jacobian) for runs, t in pairs])
        weight = robust_weights(residual, thresholds.ROBUST_SIGMAS)
        return cls(fit, trials, residual, weight, jacobian, terms)

    @cached_property
    def dependences(self) -> list[Dependence]:
        """What each group predicts of time that its regression did not see, the best first."""
        before, push = self._heldout_residual(self.jacobian[:, :0]), self.terms[ALWAYS]
        pushed, block = self._heldout_residual(push), self.fit.problem.block
        found = []
        for on, terms in self.terms.items():
            after, both = self._heldout_residual(terms), pushed
            if on != ALWAYS:
                both = self._heldout_residual(np.hstack([push, terms]))
            worth, beside = gain(before, after, block), gain(pushed, both, block)
            found.append(Dependence(on, worth, _axes(before, after), beside.nats))
        return sorted(found, key=lambda d: -d.gain.nats)

    def noise_without(self, on: str) -> list[Noise]:
        """Noise of each trial as the fit with the terms of a group leaves it."""
        sizes, at, out = self._regress(self.terms[on])[self.jacobian.shape[1] :], 0, []
        for trial in self.trials:
            response = trial.responses[on]
            own = sizes[at : at + response.shape[-1]] if on in PER_TRIAL else sizes
            at += response.shape[-1]
            out.append(trial.noise_without(response @ own))
        return out

    def _heldout_residual(self, terms: Floats) -> Floats:
        """What a fit with terms (N, K) leaves of the blocks that it did not see: (N,)."""
        out, both = self.residual.copy(), np.hstack([self.jacobian, terms])
        for seen, heldout in self.fit.problem.folds:
            out[heldout] -= np.asarray(both[heldout] @ self._regress(terms, seen))
        return out

    def _regress(self, terms: Floats, rows: Rows = slice(None)) -> Floats:
        """Changes of the fit's numbers, and sizes of the terms: (m + K,)."""
        unknowns, m = self.fit.unknowns, self.jacobian.shape[1]
        A, w = np.hstack([self.jacobian, terms])[rows], self.weight[rows]
        P = unknowns.prior**-2.0
        ridge = thresholds.RIDGE_ROWS * np.maximum(np.mean(terms**2, axis=0), 1e-24)
        H = A.T @ (w[:, None] * A) + np.diag(np.append(P, ridge))
        s = A.T @ (w * self.residual[rows])
        s[:m] += P * (self.fit.z - unknowns.start)
        return np.asarray(np.linalg.lstsq(H, s, rcond=1e-12)[0])


def _whitened(runs: RunSet, means: Floats) -> Floats:
    """Means (S, n, 3, K) as residuals: (N, K)."""
    return np.ascontiguousarray(projected_residuals(runs, np.moveaxis(means, -1, 0)).T)


def _axes(before: Floats, after: Floats) -> tuple[str, ...]:
    """The axes on which a group helps."""
    clip = thresholds.CLIP_SIGMAS
    was, left = (np.clip(r.reshape(-1, 3), -clip, clip) for r in (before, after))
    won = np.sum(was**2 - left**2, axis=0)
    helped = won > thresholds.MIN_AXIS_SHARE * max(float(won.max()), 1e-9)
    return tuple(name for name, helps in zip(AXES, helped, strict=True) if helps)


def swing_period(fit: Fit) -> float | None:
    """Period [s] at which the force that the best model misses in surge or sway swings most.

    None where its spectrum has no hump: half an octave that holds several times the power of the
    octaves on either side, as waves from many directions make it. A train of waves is an effect; of
    a whole sea only this is seen. Of several recordings those that swing are half of the time and
    more: a pilot who pumps on one of them makes no sea of the others.
    """
    humps = [_highest_hump(fit, k) for k in range(len(fit.problem.trials))]
    rows = [int(trial.usable.sum()) for trial in fit.problem.trials]
    swing = [hump > thresholds.MIN_HUMP for hump, _ in humps]
    if 2 * sum(n for n, swings in zip(rows, swing, strict=True) if swings) < sum(rows):
        return None
    hump, period = max(humps, default=(0.0, 0.0))
    return period if hump > thresholds.MIN_HUMP else None


def _highest_hump(fit: Fit, trial: int) -> tuple[float, float]:
    """Power of the highest hump over that beside it, and its period [s]; zeros without a spectrum.

    What is missing in surge and in sway on one trial.
    """
    best = (0.0, 0.0)
    for frequency, power in _spectra(fit, trial):
        velocity = power / np.maximum(frequency, 1e-9) ** 2
        for f in FREQUENCIES_HZ:
            around = ((f / 4.0, f / 2.0), (2.0 * f, 4.0 * f))
            beside = max(_mean_power(frequency, power, *band) for band in around)
            top = f * 2.0**-0.25, f * 2.0**0.25
            hump = _mean_power(frequency, power, *top) / beside
            swings = _mean_power(frequency, velocity, *top) / _mean_power(
                frequency, velocity, *around[0]
            )
            if hump > best[0] and swings > thresholds.MIN_HUMP_OF_VELOCITY:  # false of NaN
                best = (float(hump), float(1.0 / f))
    return best


def _spectra(fit: Fit, trial: int) -> list[tuple[Floats, Floats]]:
    """Frequency [Hz] and power of what is missing in surge and in sway on one trial."""
    from scipy.signal import welch  # takes half a second to import

    rows = fit.problem.trials[trial]
    force, length = missing_force_only(rows, fit.model(trial))[:, :2], round(SEGMENT_S / rows.dt)
    parts = [force[s.start : s.stop] for s in usable_stretches(rows.usable) if len(s) >= length]
    if not parts:
        return []
    each = [welch(part, 1.0 / rows.dt, nperseg=length, axis=0) for part in parts]
    power = np.average([p for _, p in each], axis=0, weights=[len(part) for part in parts])
    return [(each[0][0], power[:, axis]) for axis in (0, 1)]


def _mean_power(frequency: Floats, power: Floats, low: float, high: float) -> float:
    within = (frequency >= low) & (frequency <= high)
    return float(power[within].mean()) if within.any() else np.nan
