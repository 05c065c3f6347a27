"""The vessel's numbers, followed while it sails: recursive identification with forgetting.

    f = B b + [F(ν) − F(ν − c)] + w(g) + Σ h_i s_i + e,     h_i = −∂F/∂s_i

f is the missing force of the vessel as its file has it, averaged over a second; s_i is by what
share a number is larger than the file says: the thrust of each thruster (ahead and astern alike),
the drag ahead (X_u and X_uu), the damping of turns (N_r and N_rr). Mass and inertia are held:
motion alone does not tell thrust from mass, so every s is relative to them. c, g and b are the
current, the wind and the small errors of `sim.monitoring.disturbances`, whose filter this is,
beside the boat's own constant force, which wanders within minutes: what is steady is never put
down to a number. What all s have in common only accelerations tell, and the estimate smooths those
by some ten per cent: a share that all h have in common stands for that, and the mean of all s is
taken as known within `COMMON_STD` from the start: that all change alike is unlikely.

Forgetting: s walks, so that what was learnt is worth less as time passes. A number moves only while
it is excited: from the last minute alone, the others known and whatever a constant force explains
left out, its share could be told to `EXCITED_STD`. Else it is held and its interval widens
(Schmidt's filter: it still counts as unknown for the others). It moves slowly, and within limits.

Sources: Ljung, System Identification, 2nd ed. 1999, §11.2, 11.5 (recursive least squares as a
Kalman filter, forgetting as a random walk); Schmidt 1966 (considered states); openpilot's paramsd
and torqued (validity, gates, limits).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.monitoring import SecondMeans, WindModel, balances_at, current_shift
from sim.monitoring.causes import BOAT_ERRORS
from sim.monitoring.disturbances import MAX_SILENCE_S, DisturbanceEstimator
from sim.monitoring.explanations import CURRENT_PRIOR_MPS
from sim.monitoring.filters import DisturbanceFilter, MeasurementModel, white_noise_after
from sim.state import Floats, Ints
from sim.vessel import Thruster, Vessel

# Chosen on the tuning voyages of benchmarks/live_parameters.py; what they give on others:
# benchmarks/results/live_parameters.md.
NUMBER_PRIOR = 0.25  # standard deviation of a share at the start
NUMBER_WALK_S = 1200.0  # in which its walk reaches that: 3 % in 17 s, 10 % in three minutes
COMMON_STD = 0.04  # the same of the mean of all shares
SMOOTHING, SMOOTHING_STD = -0.08, 0.05  # how much too small the estimate makes accelerations
AROUND_WALK_S = 600.0  # as NUMBER_WALK_S, of current and wind
FORCE_WALK_S = 240.0  # the same of the boat's own constant force
CORRELATED = 1.5  # consecutive seconds are alike: variance of e over that of an independent second
EXCITATION_MEMORY_S = 60.0
EXCITED_STD = 0.05  # of a share, the others known, from the excitation of that memory alone
MAX_CHANGE_PER_S = 0.01  # of a share
LIMITS = (-0.7, 1.0)  # of a share
MIN_EXCITED_S = 60.0  # before a number is valid
MAX_VALID_STD = 0.1
TOGETHER_S = 120.0  # of excitation, after which one that is not valid is asked why; chosen
TOGETHER_SHARE = 0.4  # of its variance, left where the other is known; chosen
SIGMAS_95 = 1.96
# A number has left when its 95 % interval has not held the vessel's for a while
CLEAR_S = 20.0
BACK_SIGMAS = 1.0  # it is back when it has been as near to it as this for as long
# b that a share would describe again: scales of thrust, of turning, of drag, of turn damping
REPLACED = (3, 4, 5, 7)
AROUND = 5  # current and wind, north and east each; by how much accelerations are too small
STEP = 1e-3  # of a share, for its slope


class Number(NamedTuple):
    """A number of the vessel that is followed: its name, and the parameters it multiplies."""

    name: str
    members: tuple[str, ...]


def with_shares(vessel: Vessel, shares: Mapping[str, float]) -> Vessel:
    """A vessel whose numbers are larger by those shares; names are those of `followed_numbers`."""
    factor = {name: 1.0 + share for name, share in shares.items()}

    def scaled(thruster: Thruster) -> Thruster:
        astern, ahead = (factor.get(f"thrust {thruster.name}", 1.0) * F for F in thruster.thrust)
        return replace(thruster, thrust=(astern, ahead))

    d, drag, turning = vessel.dynamics, factor.get("drag", 1.0), factor.get("turning damping", 1.0)
    dynamics = replace(
        d, X_u=drag * d.X_u, X_uu=drag * d.X_uu, N_r=turning * d.N_r, N_rr=turning * d.N_rr
    )
    return replace(vessel, dynamics=dynamics, thrusters=tuple(map(scaled, vessel.thrusters)))


def followed_numbers(model: Model) -> tuple[Number, ...]:
    """What is followed of a vessel: the thrust of each thruster, drag, turning damping."""
    thrusters = model.vessel.thrusters
    thrust = (
        Number(f"thrust {t.name}", (f"{t.name}.ahead", f"{t.name}.astern")) for t in thrusters
    )
    return (*thrust, Number("drag", ("X_u", "X_uu")), Number("turning damping", ("N_r", "N_rr")))


@dataclass(frozen=True)
class NumberEstimates:
    """The numbers after some seconds.

    filter      over b (10,), current, wind (2,), smoothing, shares (n,)
    noise       (3,) variance of e over the stated
    slope_mean  (3, n) running mean of h       information  (n, n) of s about it
    excited_s   (n,) seconds in which each was excited
    left        (n,) which have left the vessel's interval
    clear_s     (n,) for how long that has looked otherwise
    told_with   (n,) number that each is told only together with, as it was first seen; −1: none
    """

    filter: DisturbanceFilter
    noise: Floats
    slope_mean: Floats
    information: Floats
    excited: NDArray[np.bool_]
    excited_s: Floats
    left: NDArray[np.bool_]
    clear_s: Floats
    told_with: Ints
    time: float = -np.inf

    @property
    def shares(self) -> Floats:
        """By how much each is larger than the vessel file says: (n,)."""
        return self.filter.mean[BOAT_ERRORS + AROUND :]

    @property
    def std(self) -> Floats:
        """Standard deviation of each share (n,)."""
        return np.asarray(np.sqrt(np.diag(self.filter.covariance)[BOAT_ERRORS + AROUND :]))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which are known well enough to be used (n,)."""
        low, high = LIMITS
        inside = (self.shares > low) & (self.shares < high)
        return np.asarray((self.excited_s >= MIN_EXCITED_S) & (self.std <= MAX_VALID_STD) & inside)

    @property
    def together(self) -> Ints:
        """Which other number would have to be known for each to be told; −1: none, or told (n,).

        Asked of numbers that were excited for long and are not known: thrusters that lie one
        behind the other, thrust and drag at one speed. P_ii − P_ij²/P_jj is the variance of i
        where j is known.
        """
        P = self.filter.covariance[BOAT_ERRORS + AROUND :, BOAT_ERRORS + AROUND :]
        variance = np.diag(P)
        given = variance[:, np.newaxis] - P**2 / variance
        np.fill_diagonal(given, np.inf)
        unknown = (self.excited_s >= TOGETHER_S) & (self.std > MAX_VALID_STD)
        solved = given.min(axis=1) <= TOGETHER_SHARE * variance
        return np.where(unknown & solved, given.argmin(axis=1), -1)


@dataclass(frozen=True)
class NumberFollower:
    """Follows the numbers of a vessel; holds settings, no state."""

    estimator: DisturbanceEstimator
    numbers: tuple[Number, ...]
    thetas: Floats = field(repr=False)  # (n, P): the parameters, each number a step larger

    @classmethod
    def of(cls, model: Model) -> "NumberFollower":
        """All numbers of a vessel that can be followed."""
        numbers = followed_numbers(model)
        thetas = np.tile(model.theta, (len(numbers), 1))
        for row, number in zip(thetas, numbers, strict=True):
            row[[model.names.index(name) for name in number.members]] *= 1.0 + STEP
        estimator = DisturbanceEstimator.of(model, WindModel.uniform(model.vessel))
        return cls(estimator, numbers, thetas)

    @cached_property
    def unknown(self) -> Floats:
        """Covariance of the shares at the start (n, n)."""
        n = len(self.numbers)
        alike = np.full((n, n), 1.0 / n)
        return NUMBER_PRIOR**2 * (np.eye(n) - alike) + COMMON_STD**2 * n * alike

    def start(self) -> NumberEstimates:
        """The state before the first second."""
        n, boat = len(self.numbers), self.estimator.prior.copy()
        boat[list(REPLACED)] = 0.0
        around = [*[CURRENT_PRIOR_MPS] * 2, *[self.estimator.air.prior] * 2, SMOOTHING_STD]
        filter_ = DisturbanceFilter.start(boat, np.array([*around, *[NUMBER_PRIOR] * n]))
        walk = filter_.walk_s.copy()
        walk[:3], walk[BOAT_ERRORS:], walk[-n - 1 :] = FORCE_WALK_S, AROUND_WALK_S, np.inf
        covariance = filter_.covariance.copy()
        covariance[-n:, -n:] = self.unknown
        mean = filter_.mean.copy()
        mean[BOAT_ERRORS + AROUND - 1] = SMOOTHING
        filter_ = replace(filter_, walk_s=walk, covariance=covariance, mean=mean)
        none, zeros = np.zeros(n, np.bool_), np.zeros(n)
        return NumberEstimates(
            filter_, np.ones(3), np.zeros((3, n)), np.zeros((n, n)), none,
            zeros, none, zeros, np.full(n, -1),
        )  # fmt: skip

    def observe(self, before: NumberEstimates, second: SecondMeans) -> NumberEstimates:
        """One more second -> the estimates after it; those before where they are not finite."""
        try:
            now = self._after(before, second)
        except np.linalg.LinAlgError:
            return before
        finite = np.isfinite(now.filter.mean).all() and np.isfinite(now.filter.covariance).all()
        return now if finite and np.isfinite(now.information).all() else before

    def _after(self, before: NumberEstimates, second: SecondMeans) -> NumberEstimates:
        silence = second.time - before.time
        dt = min(max(silence, 0.0), MAX_SILENCE_S) if np.isfinite(silence) else 0.0
        measured, h = self._measurement(before, second)
        variance = CORRELATED * self.estimator.variance(second, before.noise)
        mean, information = self._excitation(before, h, variance)
        excited = self._excited(information)
        held = np.zeros(len(before.filter.prior), np.bool_)
        held[-len(excited) :], held[BOAT_ERRORS + AROUND - 1] = ~excited, not excited.all()
        forgotten, n = before.filter.covariance.copy(), len(self.numbers)
        forgotten[-n:, -n:] += self.unknown * dt / NUMBER_WALK_S
        after = replace(before.filter, covariance=forgotten)
        after = after.updated(second.missing, variance, measured, dt, held)
        after = replace(after, mean=self._limited(before.filter.mean, after.mean, dt))
        now = replace(
            before, filter=after, noise=white_noise_after(before.noise, after.innovation, dt),
            slope_mean=mean, information=information, excited=excited,
            excited_s=before.excited_s + excited * min(dt, 1.0), time=second.time,
        )  # fmt: skip
        return self._judged(now, dt)

    def _judged(self, now: NumberEstimates, dt: float) -> NumberEstimates:
        """Which have been clear of the vessel's interval for a while, which are in it again."""
        off = np.abs(now.shares) / now.std
        beyond, inside = off > SIGMAS_95, off < BACK_SIGMAS
        clear = np.where(now.left, inside, beyond) & now.valid
        clear_s = np.where(clear, now.clear_s + dt, 0.0)
        turned = clear_s >= CLEAR_S
        left = now.left ^ turned
        with_ = np.where(now.told_with < 0, now.together, now.told_with)
        return replace(now, clear_s=np.where(turned, 0.0, clear_s), left=left, told_with=with_)

    def _measurement(
        self, before: NumberEstimates, second: SecondMeans
    ) -> tuple[MeasurementModel, Floats]:
        """The missing force as the estimates explain it, and h (3, n)."""
        around = before.filter.disturbance
        current, wind, smoothing = around[:2], around[2:4], around[4]
        balances = balances_at(self.estimator.model, second, current)
        water = self.estimator.water_model(second, balances, current)
        air = self.estimator.air_model(second, wind)
        h = self._slopes(second, current)
        force = water.force + air.force + h @ (before.shares + smoothing)
        alike = h.sum(axis=1, keepdims=True)
        slope = np.hstack([water.slope, air.slope, alike, h])
        return MeasurementModel(water.boat, force, slope), h

    def _slopes(self, second: SecondMeans, current: Floats) -> Floats:
        """h (3, n) of each share, in the water that moves so."""
        model, row = self.estimator.model, second.motion[None].copy()
        row[0, 3:] -= current_shift(current, second)
        time, commands = np.array([second.time]), second.mean_commands[None]
        forces = [
            model.missing_force(row, time, commands, commands, theta=theta)[0][0]
            for theta in (model.theta, *self.thetas)
        ]
        return np.array([(forces[0] - force) / STEP for force in forces[1:]]).T

    def _excitation(
        self, before: NumberEstimates, h: Floats, variance: Floats
    ) -> tuple[Floats, Floats]:
        """Running mean of h (3, n), and the information (n, n) of the last minute about it."""
        kept = 1.0 - 1.0 / EXCITATION_MEMORY_S
        mean = before.slope_mean + (h - before.slope_mean) / EXCITATION_MEMORY_S
        off = h - before.slope_mean if np.isfinite(before.time) else np.zeros_like(h)
        return mean, kept * before.information + off.T @ (off / variance[:, None])

    def _excited(self, information: Floats) -> NDArray[np.bool_]:
        """Which the last minute alone would tell: (n,)."""
        return np.asarray(np.diag(information) > EXCITED_STD**-2)

    def _limited(self, before: Floats, after: Floats, dt: float) -> Floats:
        """Shares move slowly, and within limits."""
        n, most = len(self.numbers), MAX_CHANGE_PER_S * max(dt, 1.0)
        out = after.copy()
        out[-n:] = np.clip(out[-n:], before[-n:] - most, before[-n:] + most)
        out[-n:] = np.clip(out[-n:], *LIMITS)
        return out
