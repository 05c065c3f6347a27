"""Filters of the missing force, one for each explanation, and one compiled step of all of them.

Each is an extended Kalman filter of x = (b, o), o the disturbance (c, g, … or nothing):

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 1.5

The score is how well each second was predicted. Consecutive seconds are more alike than R says:
three count as two. R follows what the best explanation leaves, in its own units z = m / √S:

    r = z_k² + 2 Σ_i (1 − i/L) z_k z_k−i,   i = 1 … L − 1,     R ← R (1 + (r − 1) / (k + k₀)),
    k + k₀ at most a minute

r is not the variance of a second but that of the mean of many, per second: what is alike from one
second to the next ones counts as noise too, as the velocities of a receiver that errs one way for
some seconds. Of one second r is never taken as less than nothing, so that white noise counts 1.8
times. Source of r: Newey and West, Econometrica 55 (1987), with the weights of Bartlett.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.kernel.compiled import compiled
from sim.monitoring.causes import BOAT_ERRORS, Hull, linearise
from sim.monitoring.kalman import kalman_step
from sim.state import Floats, Ints

# Chosen, as the numbers of `sim.monitoring.disturbances`.
SCORE_MEMORY_S = 180.0
SECONDS_PER_INDEPENDENT_SECOND = 1.5
DRIFT_S = 1800.0  # in which the random walk of o reaches its prior's width
BOAT_DRIFT_S = 20000.0  # the same of b
# errors of 16 currents were 1.45 times what the filters held for possible: what the model of a boat
# lacks is more alike from one second to the next than they know (benchmarks/results/live_diagnosis)
STATED_VARIANCE = 2.1
SIGNIFICANT_SIGMAS = 3.0  # of o, to be called different from nothing
# Of the variance of e over the stated one. Stated is that of a single estimate: of the mean over a
# second a complete boat of the tuning voyages leaves 0.004 to 0.1 of it, alike ones taken together.
NOISE_MEMORY_S = 60.0
NOISE_START = 0.2
NOISE_START_SECONDS = 5.0  # k₀: what is taken at the start counts as much as so many seconds
NOISE_LIMITS = (0.02, 10.0)
MAX_NOISE_RATIO = 9.0  # of one second: a larger one counts no more
ALIKE_S = 12  # L: innovations so many seconds apart are taken as independent
# The same where the seconds before it are not looked at (`white_noise_after`)
MAX_NOISE_STEP = 0.1  # share of a change that one second makes
MIN_WHITE_NOISE = 0.1
NONE = np.zeros(0)


class MeasurementModel(NamedTuple):
    """One explanation linearised at one second: B (3, 10), h (3,), ∂h/∂o (3, 0 or 2)."""

    boat: Floats
    force: Floats
    slope: Floats


@dataclass(frozen=True)
class DisturbanceFilter:
    """mean (n,), covariance (n, n), score [nats] of one explanation; prior (n,) std at the start.

    innovation  (3,) the last one over its expected standard deviation
    walk_s      (n,) time in which the random walk of each reaches its prior's width
    """

    prior: Floats
    mean: Floats
    covariance: Floats
    innovation: Floats
    walk_s: Floats
    score: float = 0.0

    @classmethod
    def start(
        cls, boat: Floats, disturbance: Floats = NONE, drift_s: float = DRIFT_S
    ) -> "DisturbanceFilter":
        """Standard deviations of b (10,) and of o (n,), and the time of its walk [s]."""
        prior = np.append(boat, disturbance)
        walk = np.where(np.arange(len(prior)) < BOAT_ERRORS, BOAT_DRIFT_S, drift_s)
        return cls(prior, np.zeros(len(prior)), np.diag(prior**2), np.zeros(3), walk)

    @property
    def disturbance(self) -> Floats:
        """o: (n,), of water and air north, east."""
        return self.mean[BOAT_ERRORS:]

    @property
    def disturbance_covariance(self) -> Floats:
        """Covariance of o: (n, n)."""
        return self.covariance[BOAT_ERRORS:, BOAT_ERRORS:]

    @property
    def stated_covariance(self) -> Floats:
        """Covariance of o (n, n) as it is told: errors were larger than the filter knows."""
        return STATED_VARIANCE * self.disturbance_covariance

    def squared_distance(self, disturbance: Floats) -> float:
        """How far o is from another (n,), in squared standard deviations."""
        off = self.disturbance - disturbance
        return float(off @ np.linalg.solve(self.disturbance_covariance, off))

    @property
    def significant(self) -> bool:
        """Whether o is clearly different from nothing."""
        return self.squared_distance(np.zeros(len(self.disturbance))) > SIGNIFICANT_SIGMAS**2

    def updated(
        self,
        force: Floats,
        variance: Floats,
        measured: MeasurementModel,
        dt: float,
        held: NDArray[np.bool_] | None = None,
    ) -> "DisturbanceFilter":
        """The filter after a missing force (3,) with its variance (3,), `dt` [s] after the last.

        `held` (n,): those that only count as unknown and do not move (Schmidt's filter).
        """
        H = np.hstack([measured.boat, measured.slope])
        expected = measured.boat @ self.mean[:BOAT_ERRORS] + measured.force
        n, innovation = len(self.mean), np.empty(3)
        mean, covariance = self.mean.copy(), self.covariance.copy()
        distance = kalman_step(
            (mean, covariance), self.prior**2 * dt / self.walk_s, (force - expected, variance, H),
            np.zeros(n, np.bool_) if held is None else held, innovation, n,
        )  # fmt: skip
        score = score_after(self.score, distance, dt)
        return DisturbanceFilter(self.prior, mean, covariance, innovation, self.walk_s, score)


@compiled
def score_after(score: float, distance: float, dt: float) -> float:
    """The score [nats] after a distance as of `kalman_step`, `dt` [s] after the last."""
    nats = -0.5 * distance / SECONDS_PER_INDEPENDENT_SECOND
    return score * np.exp(-dt / SCORE_MEMORY_S) + nats


@compiled
def linearised(
    law: int, thruster: int, o: Floats, second: tuple[Floats, ...], hull: tuple[Floats, ...],
    F: Floats, force: Floats, H: Floats,
) -> None:  # fmt: skip
    """`linearise`, for Python: named tuples cost numba longer than what is done here."""
    linearise(law, thruster, o, second, Hull(*hull), F, force, H)


@compiled
def advance_filters(
    every: tuple[Ints, Floats, Floats], filters: tuple[Floats, ...],
    measured: tuple[Floats, Floats], second: tuple[Floats, ...], hull: tuple[Floats, ...],
    F: Floats, dt: float, count: int, noise: Floats,
) -> None:  # fmt: skip
    """All filters over one second, in place, after `count` others.

    every     `which`, `prior`, `walk_s` of `Explanations`
    filters   `means`, `covariances`, `innovations`, `scores` of `DisturbanceEstimate`
    measured  missing force (3,), its variance (3,)
    second    motion, commanded; hull, F as `linearise` takes them
    noise     (3,) follows what the best of them leaves
    """
    which, prior, walk_s = every
    means, covariances, innovations, scores = filters
    missing, variance = measured
    numbers, length = Hull(*hull), means.shape[1]
    H, force, innovation = np.zeros((3, length)), np.zeros(3), np.zeros(3)
    walk, held = np.zeros(length), np.zeros(length, np.bool_)
    for f in range(len(which)):
        law, thruster, n = which[f, 0], which[f, 1], which[f, 2]
        mean = means[f]
        linearise(law, thruster, mean[BOAT_ERRORS:], second, numbers, F, force, H)
        for a in range(3):
            innovation[a] = missing[a] - force[a]
            for i in range(BOAT_ERRORS):
                innovation[a] -= H[a, i] * mean[i]
        for i in range(n):
            walk[i] = prior[f, i] ** 2 * dt / walk_s[f, i]
        for k in range(len(innovations[f]) - 1, 0, -1):
            for a in range(3):
                innovations[f, k, a] = innovations[f, k - 1, a]
        distance = kalman_step(
            (mean, covariances[f]), walk, (innovation, variance, H), held, innovations[f, 0], n
        )
        scores[f] = score_after(scores[f], distance, dt)
    best = 0
    for f in range(1, len(which)):
        if scores[f] > scores[best]:
            best = f
    change_noise(noise, innovations[best], noise_step(dt, count))


@compiled
def noise_step(dt: float, count: int) -> float:
    """Share of a change of the noise that a second makes, `dt` [s] after the last of `count`."""
    known = min(count + NOISE_START_SECONDS, NOISE_MEMORY_S)
    return min(dt / known, 1.0 / NOISE_START_SECONDS)


@compiled
def change_noise(noise: Floats, innovations: Floats, step: float) -> None:
    """Variance of e over the stated one (3,), in place, after normalised innovations (L, 3), the
    newest first.
    """
    lags = len(innovations)
    for a in range(3):
        now, low, high = innovations[0, a], NOISE_LIMITS[0], NOISE_LIMITS[1]
        alike = 0.0
        for i in range(1, lags):
            alike += 2.0 * (1.0 - i / lags) * now * innovations[i, a]
        ratio = max(min(now**2, MAX_NOISE_RATIO) + min(alike, MAX_NOISE_RATIO), 0.0)
        noise[a] = min(max(noise[a] * (1.0 + (ratio - 1.0) * step), low), high)


def white_noise_after(noise: Floats, innovation: Floats, dt: float) -> Floats:
    """Variance of e over the stated one (3,), alike or not, after an innovation (3,) and dt [s]."""
    step = min(dt / NOISE_MEMORY_S, MAX_NOISE_STEP)
    after = noise * (1.0 + (np.minimum(innovation**2, MAX_NOISE_RATIO) - 1.0) * step)
    return np.clip(after, MIN_WHITE_NOISE, NOISE_LIMITS[1])
