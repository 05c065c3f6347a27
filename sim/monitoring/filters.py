"""Filters of the missing force, one for each explanation, and one compiled step of all of them.

Each is an extended Kalman filter of x = (b, o), o the disturbance (c, g, … or nothing):

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 1.5

The score is how well each second was predicted. Consecutive seconds are more alike than R says:
three count as two. R follows what the best explanation leaves.
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
SIGNIFICANT_SIGMAS = 3.0  # of o, to be called different from nothing
NOISE_MEMORY_S = 60.0  # of the variance of e
NOISE_LIMITS = (0.1, 10.0)  # its variance over the stated one: at least, at most
MAX_NOISE_RATIO = 9.0  # of one second: a larger one counts no more
MAX_NOISE_STEP = 0.1  # share of a change that one second makes
NONE = np.zeros(0)


class MeasurementModel(NamedTuple):
    """One explanation linearised at one second: B (3, 10), h (3,), ∂h/∂o (3, 0 or 2)."""

    boat: Floats
    force: Floats
    slope: Floats


@dataclass(frozen=True)
class DisturbanceFilter:
    """mean (n,), covariance (n, n), score [nats] of one explanation; prior (n,) std at the start.

    innovation_ratio  (3,) the last squared innovation over its expected variance
    walk_s            (n,) time in which the random walk of each reaches its prior's width
    """

    prior: Floats
    mean: Floats
    covariance: Floats
    innovation_ratio: Floats
    walk_s: Floats
    score: float = 0.0

    @classmethod
    def start(
        cls, boat: Floats, disturbance: Floats = NONE, drift_s: float = DRIFT_S
    ) -> "DisturbanceFilter":
        """Standard deviations of b (10,) and of o (n,), and the time of its walk [s]."""
        prior = np.append(boat, disturbance)
        walk = np.where(np.arange(len(prior)) < BOAT_ERRORS, BOAT_DRIFT_S, drift_s)
        return cls(prior, np.zeros(len(prior)), np.diag(prior**2), np.ones(3), walk)

    @property
    def disturbance(self) -> Floats:
        """o: (n,), of water and air north, east."""
        return self.mean[BOAT_ERRORS:]

    @property
    def disturbance_covariance(self) -> Floats:
        """Covariance of o: (n, n)."""
        return self.covariance[BOAT_ERRORS:, BOAT_ERRORS:]

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
        n, ratio = len(self.mean), np.empty(3)
        mean, covariance = self.mean.copy(), self.covariance.copy()
        distance = kalman_step(
            (mean, covariance), self.prior**2 * dt / self.walk_s, (force - expected, variance, H),
            np.zeros(n, np.bool_) if held is None else held, ratio, n,
        )  # fmt: skip
        score = score_after(self.score, distance, dt)
        return DisturbanceFilter(self.prior, mean, covariance, ratio, self.walk_s, score)


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
    F: Floats, dt: float, noise: Floats,
) -> None:  # fmt: skip
    """All filters over one second, in place.

    every     `which`, `prior`, `walk_s` of `Explanations`
    filters   `means`, `covariances`, `ratios`, `scores` of `DisturbanceEstimate`
    measured  missing force (3,), its variance (3,)
    second    motion, commanded; hull, F as `linearise` takes them
    noise     (3,) follows what the best of them leaves
    """
    which, prior, walk_s = every
    means, covariances, ratios, scores = filters
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
        distance = kalman_step(
            (mean, covariances[f]), walk, (innovation, variance, H), held, ratios[f], n
        )
        scores[f] = score_after(scores[f], distance, dt)
    best = 0
    for f in range(1, len(which)):
        if scores[f] > scores[best]:
            best = f
    change_noise(noise, ratios[best], dt)


@compiled
def change_noise(noise: Floats, innovation_ratio: Floats, dt: float) -> None:
    """Variance of e over the stated one (3,), in place, after an innovation ratio (3,), dt [s]."""
    step = min(dt / NOISE_MEMORY_S, MAX_NOISE_STEP)
    for a in range(3):
        change = (min(innovation_ratio[a], MAX_NOISE_RATIO) - 1.0) * step
        noise[a] = min(max(noise[a] * (1.0 + change), NOISE_LIMITS[0]), NOISE_LIMITS[1])


def noise_after(noise: Floats, innovation_ratio: Floats, dt: float) -> Floats:
    """Variance of e over the stated one (3,), after an innovation ratio (3,) and `dt` [s]."""
    after = noise.copy()
    change_noise(after, innovation_ratio, dt)
    return after
