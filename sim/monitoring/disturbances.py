"""What is wrong with a boat under way: explanations of the missing force, each a filter.

    f = B(ν, τ) b + e                                nothing but the small errors of a right model
    f = B(ν − c, τ) b + F(ν) − F(ν − c) + e          the water moves: c north, east [m/s]
    f = B(ν, τ) b + w(ψ, ν; g) + e                   the air pushes: g north, east
    f = B(ν, τ) b + h(o) + e                         a thruster, the compass, the drag, anything
                                                     (`sim.monitoring`)

f is the missing force, averaged over a second, F the balance of the vessel. b are small errors of
the boat's own model (a constant force, the scale of its thrust and of its damping, a heading
offset), with priors. Damping goes with the velocity through the water: written over ground, a boat
that drifts along with a current would look like one without sway damping. e starts with the
standard deviation that the estimate states, and then follows what the best explanation leaves. With
wind areas g = |V| V of the wind, else it is a force [N].

Each explanation is an extended Kalman filter of x = (b, o), o the disturbance (c, g, … or nothing):

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 1.5

The score is how well each second was predicted. Consecutive seconds are more alike than R says:
three count as two. When trouble begins (`reopened`) all start anew with the boat as it was known
before: what set in halfway has not been near zero for long. A named explanation has to beat the
boat itself and all other named ones; where a force that wanders freely beats them all by far, it is
none of these. Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, §5.4 and §11.6 (multiple models); Joseph's form of the covariance.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.monitoring import (
    Balance,
    OwnCause,
    SecondMeans,
    WindModel,
    balance_at,
    current_shift,
    kalman_step,
    own_causes,
    world_to_body,
)
from sim.state import Floats

# Chosen; together they give benchmarks/results/live_diagnosis.md: no event on six complete vessels,
# a current named in half a minute to two minutes, to 0.05 m/s and 10 degrees.
BOAT_ERRORS = 10  # components of b
SCORE_MEMORY_S = 180.0
SECONDS_PER_INDEPENDENT_SECOND = 1.5
DRIFT_S = 1800.0  # in which the random walk of o reaches its prior's width
BOAT_DRIFT_S = 20000.0  # the same of b
SIGNIFICANT_SIGMAS = 3.0  # of o, to be called different from nothing
CURRENT_PRIOR_MPS = 0.5  # of either component
MIN_SCORE_NATS = 8.0  # by which an explanation must beat the boat itself …
MIN_SCORE_BETWEEN_NATS = 5.0  # … and each other one
MIN_SCORE_OTHER_NATS = 12.0  # by which a wandering force must beat all of them: none of these
MIN_CALM_SECONDS = 60  # before trouble, for the boat's own errors to be known
NOISE_MEMORY_S = 60.0  # of the variance of e
NOISE_LIMITS = (0.1, 10.0)  # its variance over the stated one: at least, at most
MIN_NOISE = 0.01  # of the priors of b as forces: no estimate is perfect
MAX_SILENCE_S = 600.0  # a longer silence counts as this long


# standard deviations of b: share of the thrust full ahead; shares; rad
BOAT_FORCE, BOAT_SCALES, BOAT_HEADING = 0.03, (0.08, 0.08, 0.1, 0.1, 0.1), 0.03
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

    def reopened(self, before: "DisturbanceFilter") -> "DisturbanceFilter":
        """The filter as if the disturbance began now: b as before it, o as unknown as at first."""
        mean, covariance = np.zeros(len(self.prior)), np.diag(self.prior**2)
        mean[:BOAT_ERRORS] = before.mean[:BOAT_ERRORS]
        covariance[:BOAT_ERRORS, :BOAT_ERRORS] = before.covariance[:BOAT_ERRORS, :BOAT_ERRORS]
        return replace(self, mean=mean, covariance=covariance, score=0.0)

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
        kept = np.zeros(len(self.mean), np.bool_) if held is None else held
        mean, covariance, ratio, distance = kalman_step(
            (self.mean, self.covariance, self.prior**2 * dt / self.walk_s),
            (force - expected, variance, H),
            kept,
        )
        nats = -0.5 * distance / SECONDS_PER_INDEPENDENT_SECOND
        score = self.score * float(np.exp(-dt / SCORE_MEMORY_S)) + nats
        return DisturbanceFilter(self.prior, mean, covariance, ratio, self.walk_s, score)


class Cause(Enum):
    """What is wrong: around the boat or on it; one of several; none of these."""

    NOTHING = "none"
    CURRENT = "current"
    WIND = "wind"
    EITHER = "current or wind"
    THRUST = "thrust"
    COMPASS = "compass"
    DRAG = "drag"
    OTHER = "none of these"
    SEVERAL = "several"


KIND_OF = {
    "thrust": Cause.THRUST, "compass": Cause.COMPASS, "drag": Cause.DRAG, "anything": Cause.OTHER,
}  # fmt: skip


@dataclass(frozen=True)
class DisturbanceEstimate:
    """The explanations after `count` seconds; noise (3,): variance of e over the stated.

    own      one filter for each of `DisturbanceEstimator.own`
    opened   when trouble began, and all explanations with it [s]; −inf: from the beginning
    """

    boat: DisturbanceFilter
    water: DisturbanceFilter
    air: DisturbanceFilter
    own: tuple[DisturbanceFilter, ...]
    kinds: tuple[Cause, ...]  # of each of them …
    names: tuple[str, ...]  # … and of its thruster
    noise: Floats
    time: float = -np.inf
    count: int = 0
    opened: float = -np.inf

    @property
    def ranked(self) -> list[tuple[Cause, DisturbanceFilter]]:
        """All explanations, the one that predicts best first."""
        named = zip(self.kinds, self.own, strict=True)
        both = [(Cause.CURRENT, self.water), (Cause.WIND, self.air), *named]
        return sorted(both, key=lambda one: -one[1].score)

    @property
    def likely(self) -> tuple[Cause, ...]:
        """Causes that explain the missing force about as well as the best; none where none does."""
        other = max(one.score for kind, one in self.ranked if kind is Cause.OTHER)
        named = [(kind, one) for kind, one in self.ranked if kind is not Cause.OTHER]
        best = named[0][1].score
        if max(best, other) - self.boat.score < MIN_SCORE_NATS:
            return ()
        if other - best >= MIN_SCORE_OTHER_NATS:
            return (Cause.OTHER,)
        near = [kind for kind, one in named if best - one.score < MIN_SCORE_BETWEEN_NATS]
        doubt = [Cause.OTHER] if other - best >= MIN_SCORE_BETWEEN_NATS else []
        return tuple(dict.fromkeys([*near, *doubt]))

    @property
    def cause(self) -> Cause:
        """What explains the missing force best, as far as these seconds tell."""
        likely = self.likely
        if not likely:
            return Cause.NOTHING
        if set(likely) == {Cause.CURRENT, Cause.WIND}:
            return Cause.EITHER
        if len(likely) > 1:
            return Cause.SEVERAL
        best = next(one for kind, one in self.ranked if kind is likely[0])
        if best.significant or likely[0] is Cause.OTHER:
            return likely[0]
        return Cause.EITHER if likely[0] in (Cause.CURRENT, Cause.WIND) else Cause.SEVERAL


@dataclass(frozen=True)
class DisturbanceEstimator:
    """The vessel, its wind model, and the priors of b (10,) as standard deviations."""

    model: Model
    air: WindModel
    prior: Floats
    own: tuple[OwnCause, ...] = ()

    @classmethod
    def of(cls, model: Model) -> "DisturbanceEstimator":
        """Priors follow the size of the vessel."""
        vessel = model.vessel
        thrust = sum(t.thrust[1] for t in vessel.thrusters) or 0.5 * vessel.hull.mass
        lever = 0.5 * vessel.hull.beam
        force = BOAT_FORCE * thrust * np.array([1.0, 1.0, lever])
        scale = BOAT_SCALES  # of thrust, of turning, of damping in u, v, r
        heading = -BOAT_HEADING * vessel.dynamics.Y_v  # N s/m
        prior = np.array([*force, *scale, heading, heading * lever])
        return cls(model, WindModel.of(vessel, thrust), prior, own_causes(model, DRIFT_S))

    def start(self) -> DisturbanceEstimate:
        """The state before the first second."""
        current, wind = np.full(2, CURRENT_PRIOR_MPS), np.full(2, self.air.prior)
        boat, water, air = (DisturbanceFilter.start(self.prior, o) for o in (NONE, current, wind))
        own = tuple(DisturbanceFilter.start(self.prior, c.prior, c.drift_s) for c in self.own)
        kinds = tuple(KIND_OF[cause.kind] for cause in self.own)
        names = tuple(cause.name for cause in self.own)
        return DisturbanceEstimate(boat, water, air, own, kinds, names, np.ones(3))

    def reopened(self, estimate: DisturbanceEstimate, time: float) -> DisturbanceEstimate:
        """Trouble has begun: what explains it is judged by what comes from now on.

        What was learnt of the boat before is kept if there was time to learn anything.
        """
        before = estimate.boat if estimate.count >= MIN_CALM_SECONDS else self.start().boat
        boat, water, air = (
            one.reopened(before) for one in (estimate.boat, estimate.water, estimate.air)
        )
        own = tuple(one.reopened(before) for one in estimate.own)
        return replace(estimate, boat=boat, water=water, air=air, own=own, opened=time)

    def observe(
        self, estimate: DisturbanceEstimate, second: SecondMeans
    ) -> tuple[DisturbanceEstimate, Balance]:
        """One more second -> the estimate after it, and the balance there."""
        current = estimate.water.disturbance
        balance = balance_at(self.model, second, current)
        silence = max(second.time - estimate.time, 0.0)
        dt = min(silence, MAX_SILENCE_S) if estimate.count else 0.0
        variance = self.variance(second, estimate.noise)
        errors = self._errors(second, second.nu)
        boat, water, air = (
            one.updated(second.missing, variance, measured, dt)
            for one, measured in (
                (estimate.boat, self._boat(second)),
                (estimate.water, self.water_model(second, balance, current)),
                (estimate.air, self.air_model(second, estimate.air.disturbance)),
            )
        )
        own = tuple(
            one.updated(
                second.missing,
                variance,
                MeasurementModel(errors, *cause.force(second, one.disturbance)),
                dt,
            )
            for one, cause in zip(estimate.own, self.own, strict=True)
        )
        best = max((boat, water, air, *own), key=lambda one: one.score)
        noise = noise_after(estimate.noise, best.innovation_ratio, dt)
        after = replace(
            estimate, boat=boat, water=water, air=air, own=own, noise=noise, time=second.time,
            count=estimate.count + 1,
        )  # fmt: skip
        return after, balance

    def _boat(self, second: SecondMeans) -> MeasurementModel:
        return MeasurementModel(self._errors(second, second.nu), np.zeros(3), np.zeros((3, 0)))

    def variance(self, second: SecondMeans, noise: Floats) -> Floats:
        """Variance of a missing force: (3,), the stated one times `noise` (3,)."""
        return np.asarray(noise * second.missing_std**2 + (MIN_NOISE * self.prior[:3]) ** 2)

    def water_model(
        self, second: SecondMeans, balance: Balance, current: Floats
    ) -> MeasurementModel:
        """F(ν) − F(ν − c), and its slope against c."""
        turn = np.array([world_to_body(e, second.yaw) for e in np.eye(2)]).T  # (2, 2)
        spin = second.nu[2] * np.array([[0.0, 1.0], [-1.0, 0.0]]) @ turn
        slope = balance.slope_nu[:, :2] @ turn + balance.slope_nu_dot[:, :2] @ spin
        through = second.nu - current_shift(current, second)[:3]
        force = balance.still_water - balance.moving_water
        return MeasurementModel(self._errors(second, through), force, slope)

    def air_model(self, second: SecondMeans, g: Floats) -> MeasurementModel:
        """w(ψ, ν; g), and its slope against g."""
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


def noise_after(noise: Floats, innovation_ratio: Floats, dt: float) -> Floats:
    """Variance of e over the stated one (3,), after an innovation ratio (3,) and `dt` [s]."""
    change = 1.0 + (np.minimum(innovation_ratio, 9.0) - 1.0) * min(dt / NOISE_MEMORY_S, 0.1)
    return np.asarray(np.clip(noise * change, *NOISE_LIMITS))
