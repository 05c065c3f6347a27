"""Current and wind, estimated under way: three explanations of the missing force, each a filter.

    f = B(ν, τ) b + e                                nothing but the boat itself
    f = B(ν − c, τ) b + F(ν) − F(ν − c) + e          the water moves: c north, east [m/s]
    f = B(ν, τ) b + w(ψ, ν; g) + e                   the air pushes: g north, east

f is the missing force, averaged over a second, F the balance of the vessel. b are errors of the
boat's own model (a constant force, the scale of its thrust and of its damping, a heading offset),
with priors: what stays fixed to the boat is not put down to water or air. Damping goes with the
velocity through the water: written over ground, a boat that drifts along with a current would look
like one without sway damping. e starts with the standard deviation that the estimate states, and
then follows what the best explanation leaves. With wind areas g = |V| V of the wind, else it is a
force [N].

Each explanation is an extended Kalman filter of x = (b, o), o the disturbance (c, g or nothing):

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 2

The score is how well each second was predicted. Consecutive seconds are more alike than R says:
two count as one. Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, §5.4 and §11.6 (multiple models); Joseph's form of the covariance.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from sim.model import Model
from sim.monitoring.live_second import (
    Balance,
    SecondMeans,
    WindModel,
    balance_at,
    current_shift,
    world_to_body,
)
from sim.state import Floats

# Chosen; together they give benchmarks/results/live_diagnosis.md: no event on six complete vessels,
# a current named in half a minute to two minutes, to 0.05 m/s and 10 degrees.
BOAT_ERRORS = 10  # components of b
SCORE_MEMORY_S = 180.0
SECONDS_PER_INDEPENDENT_SECOND = 2.0
MAX_SQUARED_DISTANCE = 16.0  # mᵀ S⁻¹ m over three axes: beyond this noise is not Gaussian
DRIFT_S = 1800.0  # in which the random walk of o reaches its prior's width
BOAT_DRIFT_S = 20000.0  # the same of b
SIGNIFICANT_SIGMAS = 3.0  # of o, to be called different from nothing
CURRENT_PRIOR_MPS = 0.5  # of either component
MIN_SCORE_NATS = 8.0  # by which an explanation must beat the boat itself …
MIN_SCORE_BETWEEN_NATS = 4.0  # … and water the air, or the other way round
NOISE_MEMORY_S = 60.0  # of the variance of e
NOISE_LIMITS = (0.1, 10.0)  # its variance over the stated one: at least, at most
MIN_NOISE = 0.01  # of the priors of b as forces: no estimate is perfect
MAX_SILENCE_S = 600.0  # a longer silence counts as this long


class MeasurementModel(NamedTuple):
    """One explanation linearised at one second: B (3, 10), h (3,), ∂h/∂o (3, 0 or 2)."""

    boat: Floats
    force: Floats
    slope: Floats


@dataclass(frozen=True)
class DisturbanceFilter:
    """mean (n,), covariance (n, n), score [nats] of one explanation; prior (n,) std at the start.

    innovation_ratio  (3,) the last squared innovation over its expected variance
    """

    prior: Floats
    mean: Floats
    covariance: Floats
    innovation_ratio: Floats
    score: float = 0.0

    @classmethod
    def start(cls, boat: Floats, disturbance: float | None = None) -> "DisturbanceFilter":
        """Standard deviations of b (10,) and of either component of o, where there is any."""
        prior = boat if disturbance is None else np.append(boat, [disturbance, disturbance])
        return cls(prior, np.zeros(len(prior)), np.diag(prior**2), np.ones(3))

    @property
    def disturbance(self) -> Floats:
        """o: north, east (2,)."""
        return self.mean[BOAT_ERRORS:]

    @property
    def disturbance_covariance(self) -> Floats:
        """Of o: (2, 2)."""
        return self.covariance[BOAT_ERRORS:, BOAT_ERRORS:]

    def squared_distance(self, disturbance: Floats) -> float:
        """How far o is from another (2,), in squared standard deviations."""
        off = self.disturbance - disturbance
        return float(off @ np.linalg.solve(self.disturbance_covariance, off))

    @property
    def significant(self) -> bool:
        """Whether o is clearly different from nothing."""
        return self.squared_distance(np.zeros(2)) > SIGNIFICANT_SIGMAS**2

    def updated(
        self, force: Floats, variance: Floats, measured: MeasurementModel, dt: float
    ) -> "DisturbanceFilter":
        """After a missing force (3,) with its variance (3,), `dt` [s] after the last."""
        walk = np.where(np.arange(len(self.prior)) < BOAT_ERRORS, BOAT_DRIFT_S, DRIFT_S)
        P = self.covariance + np.diag(self.prior**2 * dt / walk)
        H, R = np.hstack([measured.boat, measured.slope]), np.diag(variance)
        m = force - measured.boat @ self.mean[:BOAT_ERRORS] - measured.force
        S = H @ P @ H.T + R
        squared, ratio = float(m @ np.linalg.solve(S, m)), m**2 / np.diag(S)
        if squared > MAX_SQUARED_DISTANCE:  # an outlier: it counts, but less
            R = R * (squared / MAX_SQUARED_DISTANCE)
            S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(len(self.mean)) - K @ H
        distance = min(squared, MAX_SQUARED_DISTANCE) + float(np.linalg.slogdet(S)[1])
        nats = -0.5 * distance / SECONDS_PER_INDEPENDENT_SECOND
        score = self.score * float(np.exp(-dt / SCORE_MEMORY_S)) + nats
        return DisturbanceFilter(
            self.prior, self.mean + K @ m, A @ P @ A.T + K @ R @ K.T, ratio, score
        )


class Cause(Enum):
    """What the surroundings do that the vessel does not know."""

    NOTHING = "none"
    CURRENT = "current"
    WIND = "wind"
    EITHER = "current or wind"


@dataclass(frozen=True)
class DisturbanceEstimate:
    """The three explanations after `count` seconds; noise (3,): variance of e over the stated."""

    boat: DisturbanceFilter
    water: DisturbanceFilter
    air: DisturbanceFilter
    noise: Floats
    time: float = -np.inf
    count: int = 0

    @property
    def cause(self) -> Cause:
        """What explains the missing force best, as far as these seconds tell."""
        water, air = self.water.score - self.boat.score, self.air.score - self.boat.score
        if max(water, air) < MIN_SCORE_NATS:
            return Cause.NOTHING
        better = self.water if water > air else self.air
        if abs(water - air) < MIN_SCORE_BETWEEN_NATS or not better.significant:
            return Cause.EITHER
        return Cause.CURRENT if water > air else Cause.WIND


@dataclass(frozen=True)
class DisturbanceEstimator:
    """The vessel, its wind model, and the priors of b (10,) as standard deviations."""

    model: Model
    air: WindModel
    prior: Floats

    @classmethod
    def of(cls, model: Model) -> "DisturbanceEstimator":
        """Priors follow the size of the vessel."""
        vessel = model.vessel
        thrust = sum(t.thrust[1] for t in vessel.thrusters) or 0.5 * vessel.hull.mass
        lever = 0.5 * vessel.hull.beam
        force = [0.1 * thrust, 0.1 * thrust, 0.1 * thrust * lever]
        scale = [0.2, 0.2, 0.2, 0.15, 0.2]  # of thrust, of turning, of damping in u, v, r
        heading = -0.2 * vessel.dynamics.Y_v  # N s/m: a heading that is off by 0.2 rad
        prior = np.array([*force, *scale, heading, heading * lever])
        return cls(model, WindModel.of(vessel, thrust), prior)

    def start(self) -> DisturbanceEstimate:
        """Before the first second."""
        boat, water, air = (
            DisturbanceFilter.start(self.prior, disturbance)
            for disturbance in (None, CURRENT_PRIOR_MPS, self.air.prior)
        )
        return DisturbanceEstimate(boat, water, air, np.ones(3))

    def observe(
        self, estimate: DisturbanceEstimate, second: SecondMeans
    ) -> tuple[DisturbanceEstimate, Balance]:
        """One more second -> the estimate after it, and the balance there."""
        current = estimate.water.disturbance
        balance = balance_at(self.model, second, current)
        silence = max(second.time - estimate.time, 0.0)
        dt = min(silence, MAX_SILENCE_S) if estimate.count else 0.0
        variance = estimate.noise * second.missing_std**2 + (MIN_NOISE * self.prior[:3]) ** 2
        boat, water, air = (
            one.updated(second.missing, variance, measured, dt)
            for one, measured in (
                (estimate.boat, self._boat(second)),
                (estimate.water, self._water(second, balance, current)),
                (estimate.air, self._air(second, estimate.air.disturbance)),
            )
        )
        ratio = max((boat, water, air), key=lambda one: one.score).innovation_ratio
        change = 1.0 + (np.minimum(ratio, 9.0) - 1.0) * min(dt / NOISE_MEMORY_S, 0.1)
        noise = np.clip(estimate.noise * change, *NOISE_LIMITS)
        after = DisturbanceEstimate(boat, water, air, noise, second.time, estimate.count + 1)
        return after, balance

    def _boat(self, second: SecondMeans) -> MeasurementModel:
        return MeasurementModel(self._errors(second, second.nu), np.zeros(3), np.zeros((3, 0)))

    def _water(self, second: SecondMeans, balance: Balance, current: Floats) -> MeasurementModel:
        """F(ν) − F(ν − c), and its slope against c."""
        turn = np.array([world_to_body(e, second.yaw) for e in np.eye(2)]).T  # (2, 2)
        spin = second.nu[2] * np.array([[0.0, 1.0], [-1.0, 0.0]]) @ turn
        slope = balance.slope_nu[:, :2] @ turn + balance.slope_nu_dot[:, :2] @ spin
        through = second.nu - current_shift(current, second)[:3]
        force = balance.still_water - balance.moving_water
        return MeasurementModel(self._errors(second, through), force, slope)

    def _air(self, second: SecondMeans, g: Floats) -> MeasurementModel:
        errors = self._errors(second, second.nu)
        return MeasurementModel(errors, *self.air.force_and_slope(g, second))

    def _errors(self, second: SecondMeans, nu: Floats) -> Floats:
        """B (3, 10): what one unit of each of the boat's own errors adds to the missing force."""
        u, v, r = nu
        d = self.model.vessel.dynamics
        out = np.zeros((3, BOAT_ERRORS))
        out[0, 0] = out[1, 1] = out[2, 2] = 1.0
        out[0, 3], out[2, 4] = second.commanded[0], second.commanded[2]
        out[0, 5] = (d.X_u + d.X_uu * abs(u)) * u
        out[1, 6] = (d.Y_v + d.Y_vv * abs(v)) * v
        out[2, 7] = (d.N_r + d.N_rr * abs(r)) * r
        out[1, 8] = out[2, 9] = u
        return out
