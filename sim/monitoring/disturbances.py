"""What is wrong with a boat under way: explanations of the missing force, each a filter.

    f = B(ν, τ) b + e                                nothing but the small errors of a right model
    f = B(ν − c, τ) b + F(ν) − F(ν − c) + e          the water moves: c north, east [m/s]
    f = B(ν, τ) b + w(ψ, ν; g) + e                   the air pushes: g north, east
    f = B(ν, τ) b + h(o) + e                         a thruster, the compass, the drag, anything
                                                     (`sim.monitoring.causes`)

f is the missing force, averaged over a second, F the balance of the vessel. b are small errors of
the boat's own model (a constant force, the scale of its thrust and of its damping, a heading
offset), with priors. Damping goes with the velocity through the water: written over ground, a boat
that drifts along with a current would look like one without sway damping. e starts with the
standard deviation that the estimate states, and then follows what the best explanation leaves.
g = |V| V of the wind, on areas that are assumed where the vessel has none.

Each explanation is an extended Kalman filter of x = (b, o), o the disturbance (c, g, … or nothing):

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 1.5

The score is how well each second was predicted. Consecutive seconds are more alike than R says:
three count as two, and R follows what the best explanation leaves (`sim.monitoring.filters`). When
trouble begins (`reopened`) all start anew with the boat as it was known before: what set in halfway
has not been near zero for long. A named explanation has to beat the boat itself and all other named
ones; where a force that wanders freely beats them all by far, it is none of these. On few headings
water and air push alike: there one of them has to beat the other by far.
Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, §5.4 and §11.6 (multiple models); Joseph's form of the covariance.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sim.model import Model
from sim.monitoring import (
    NO_CURRENT,
    Balance,
    SecondMeans,
    WindModel,
    balances_at,
    current_shift,
    thrust_ahead,
)
from sim.monitoring.causes import BOAT_ERRORS, Hull, Law
from sim.monitoring.explanations import ALL_THRUSTERS, Explanations, explanations, hull_of
from sim.monitoring.filters import (
    ALIKE_S,
    NOISE_START,
    DisturbanceFilter,
    MeasurementModel,
    advance_filters,
    linearised,
)
from sim.state import Eta, Floats, Ints, to_world

# Chosen on the tuning voyages of benchmarks/live_naming.py; what they give on others:
# benchmarks/results/live_naming.md, and for the estimates live_diagnosis.md.
MIN_SCORE_NATS = 10.0  # by which an explanation must beat the boat itself …
MIN_SCORE_BETWEEN_NATS = 5.0  # … and each other one
MIN_SCORE_APART_NATS = 15.0  # of water and air on few headings, by which one must beat the other
MIN_SCORE_OTHER_NATS = 12.0  # by which a wandering force must beat all of them: none of these
ALL_THRUSTERS_NATS = 12.0  # by which all thrusters at once have to do better than any other cause
MIN_CALM_SECONDS = 60  # before trouble, for the boat's own errors to be known
MIN_NOISE = 0.01  # of the priors of b as forces: no estimate is perfect
MAX_SILENCE_S = 600.0  # a longer silence counts as this long
MAX_IDLE = 0.05  # of the command full ahead: less is no thrust to judge by
ABOARD = (Law.THRUST, Law.COMPASS, Law.DRAG)  # they show while a motor drives …
MIN_DRIVEN_S = 10  # … for so long
MIN_SHARE = 0.1  # of a thrust: of the difference that says what the thruster adds

# standard deviations of b: share of the thrust full ahead; shares; rad
BOAT_FORCE, BOAT_SCALES, BOAT_HEADING = 0.03, (0.08, 0.08, 0.1, 0.1, 0.1), 0.03


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


CAUSE_OF = {
    Law.CURRENT: Cause.CURRENT, Law.WIND: Cause.WIND, Law.THRUST: Cause.THRUST,
    Law.COMPASS: Cause.COMPASS, Law.DRAG: Cause.DRAG, Law.ANYTHING: Cause.OTHER,
}  # fmt: skip


@dataclass(frozen=True)
class DisturbanceEstimate:
    """The explanations after `count` seconds; noise (3,): variance of e over the stated.

    means (F, N), covariances (F, N, N), innovations (F, L, 3) the newest first, scores (F,) of all
    filters: the boat's own errors alone, then current, wind and the causes aboard
    opened   when trouble began, and all explanations with it [s]; −inf: from the beginning
    driven   seconds since then in which a motor drove
    beside   causes that are taken as known: the explanations are of what is left beside them
    """

    all: Explanations
    means: Floats
    covariances: Floats
    innovations: Floats
    scores: Floats
    noise: Floats
    time: float = -np.inf
    count: int = 0
    opened: float = -np.inf
    driven: int = 0
    beside: tuple["KnownCause", ...] = ()

    def filter(self, f: int) -> DisturbanceFilter:
        """One of them, with views into the tables."""
        n = int(self.all.which[f, 2])
        return DisturbanceFilter(
            self.all.prior[f, :n], self.means[f, :n], self.covariances[f, :n, :n],
            self.innovations[f, 0], self.all.walk_s[f, :n], float(self.scores[f]),
        )  # fmt: skip

    @property
    def boat(self) -> DisturbanceFilter:
        """The boat's own errors alone."""
        return self.filter(BOAT)

    @property
    def water(self) -> DisturbanceFilter:
        """A current."""
        return self.filter(WATER)

    @property
    def air(self) -> DisturbanceFilter:
        """A wind."""
        return self.filter(AIR)

    def around(self, f: int) -> Floats:
        """North, east (2,) of the current (WATER) or the wind (AIR), with what is known of it."""
        known = [one.size for one in self.beside if one.law is self.all.laws[f]]
        return np.asarray(self.filter(f).disturbance + sum(known))

    @property
    def finite(self) -> bool:
        """Whether all of them hold finite numbers."""
        return bool(np.isfinite(self.means).all())

    @cached_property
    def named(self) -> list[tuple[float, Cause, int]]:
        """Score, cause and number of each explanation, the one that predicts best first.

        All thrusters at once have to do better: motors that lag look like weak ones.
        """
        scores, laws = (self.scores - self._handicap).tolist(), self.all.laws
        each = [(scores[f], CAUSE_OF[laws[f]], f) for f in range(WATER, len(laws))]
        return sorted(each, key=lambda one: -one[0])

    @property
    def _handicap(self) -> Floats:
        """What is taken off the score of each explanation (F,) [nats]; no water drives a boat."""
        pairs = zip(self.all.laws, self.all.names, strict=True)
        whole = [law is Law.THRUST and name == ALL_THRUSTERS for law, name in pairs]
        drives = [law is Law.DRAG for law in self.all.laws] & (self.means[:, BOAT_ERRORS] < -1.0)
        unseen = drives | self._is_known
        if self.is_adrift:
            unseen |= [law in ABOARD for law in self.all.laws]
        return np.where(unseen, np.inf, ALL_THRUSTERS_NATS * np.array(whole))

    @property
    def _is_known(self) -> NDArray[np.bool_]:
        """Which explanations (F,) are among the causes that are known, or are one with them."""
        known = {(one.law, one.name) for one in self.beside}
        thrust = any(law is Law.THRUST for law, _ in known)
        pairs = zip(self.all.laws, self.all.names, strict=True)
        return np.array([
            (law, name) in known or (thrust and law is Law.THRUST and name == ALL_THRUSTERS)
            for law, name in pairs
        ])  # fmt: skip

    def number_of(self, cause: Cause) -> int:
        """Of the explanation by that cause which predicts best."""
        return next(f for _, kind, f in self.named if kind is cause)

    def best(self, cause: Cause) -> DisturbanceFilter:
        """The filter of that cause which predicts best."""
        return self.filter(self.number_of(cause))

    @cached_property
    def likely(self) -> tuple[Cause, ...]:
        """Causes that explain the missing force about as well as the best; none where none does."""
        every = self.named
        other = max(score for score, kind, _ in every if kind is Cause.OTHER)
        named = [(score, kind) for score, kind, _ in every if kind is not Cause.OTHER]
        best = named[0][0]
        if max(best, other) - float(self.scores[BOAT]) < MIN_SCORE_NATS:
            return ()
        if other - best >= MIN_SCORE_OTHER_NATS:
            return (Cause.OTHER,)
        near = [kind for score, kind in named if best - score < MIN_SCORE_BETWEEN_NATS]
        doubt = [Cause.OTHER] if other > best else []
        return tuple(dict.fromkeys([*near, *doubt]))

    @cached_property
    def cause(self) -> Cause:
        """What explains the missing force best, as far as these seconds tell."""
        return self.cause_of(self.likely)

    def likely_on(self, few_headings: bool) -> tuple[Cause, ...]:
        """`likely`; on few headings water goes with air, unless one of them does far better.

        So it does while the motors rest: a boat adrift goes with both.
        """
        likely, pair = self.likely, (Cause.CURRENT, Cause.WIND)
        apart = abs(float(self.scores[WATER] - self.scores[AIR])) >= MIN_SCORE_APART_NATS
        told = apart if few_headings else True
        if (told and not self.is_adrift) or set(pair).isdisjoint(likely):
            return likely
        known = {one.cause for one in self.beside}
        return tuple(dict.fromkeys([*likely, *(kind for kind in pair if kind not in known)]))

    @property
    def is_adrift(self) -> bool:
        """Whether hardly a motor has driven since the trouble began."""
        return bool(np.isfinite(self.opened)) and self.driven < MIN_DRIVEN_S

    def cause_of(self, likely: tuple[Cause, ...]) -> Cause:
        """One word for the likely causes.

        Nothing where none of them is clearly more than nothing: an explanation of no size may
        predict a little better, but it cannot make an error for which the model is called wrong.
        Of water and air alone it is told that it may be either.
        """
        if not likely or likely == (Cause.OTHER,):
            return likely[0] if likely else Cause.NOTHING
        if not any(kind is not Cause.OTHER and self.best(kind).significant for kind in likely):
            return Cause.NOTHING
        if set(likely) == {Cause.CURRENT, Cause.WIND}:
            return Cause.EITHER
        return Cause.SEVERAL if len(likely) > 1 else likely[0]


@dataclass(frozen=True, eq=False)
class KnownCause:
    """A cause whose size is taken from an estimate, to look at what is left beside it."""

    cause: Cause
    estimate: DisturbanceEstimate

    @cached_property
    def number(self) -> int:
        """Of the explanation of that cause which predicts best."""
        return self.estimate.number_of(self.cause)

    @property
    def law(self) -> Law:
        """How it acts."""
        return self.estimate.all.laws[self.number]

    @property
    def name(self) -> str:
        """Of the thruster."""
        return self.estimate.all.names[self.number]

    @property
    def size(self) -> Floats:
        """o (n,)."""
        return self.estimate.filter(self.number).disturbance


BOAT, WATER, AIR = 0, 1, 2  # the first filters


@dataclass(frozen=True)
class DisturbanceEstimator:
    """The vessel, its wind model, the priors of b (10,) as standard deviations; its explanations.

    hull      what their laws take of the vessel
    compass   number of the explanation that a compass error is
    """

    model: Model
    air: WindModel
    prior: Floats
    all: Explanations
    hull: Hull

    @classmethod
    def of(cls, model: Model, air: WindModel | None = None) -> "DisturbanceEstimator":
        """Priors follow the size of the vessel; `air`: how it takes the wind, if not as usual."""
        vessel = model.vessel
        thrust = thrust_ahead(vessel)
        lever = 0.5 * vessel.hull.beam
        force = BOAT_FORCE * thrust * np.array([1.0, 1.0, lever])
        scale = BOAT_SCALES  # of thrust, of turning, of damping in u, v, r
        heading = -BOAT_HEADING * vessel.dynamics.Y_v  # N s/m
        prior = np.array([*force, *scale, heading, heading * lever])
        air = air or WindModel.of(vessel)
        each = Explanations.of(prior, list(explanations(vessel, thrust, air.prior)))
        return cls(model, air, prior, each, hull_of(vessel, air))

    def drives(self, second: SecondMeans) -> bool:
        """Whether a motor does."""
        motors = second.mean_commands[: len(self.model.vessel.thrusters)]
        return bool((np.abs(motors) > MAX_IDLE).any())

    @cached_property
    def compass(self) -> int:
        """Number of the explanation by the compass."""
        return self.all.laws.index(Law.COMPASS)

    def start(self) -> DisturbanceEstimate:
        """The state before the first second."""
        prior = self.all.prior
        covariances = np.stack([np.diag(one**2) for one in prior])
        count = len(prior)
        return DisturbanceEstimate(
            self.all, np.zeros_like(prior), covariances, np.zeros((count, ALIKE_S, 3)),
            np.zeros(count), np.full(3, NOISE_START),
        )  # fmt: skip

    def reopened(
        self, estimate: DisturbanceEstimate, time: float, beside: tuple[KnownCause, ...] = ()
    ) -> DisturbanceEstimate:
        """Trouble has begun: what explains it is judged by what comes from now on.

        The boat's own errors are as they were before it, if there was time to learn anything; the
        disturbances are as unknown as at first. `beside`: causes that are taken as known.
        """
        fresh, b = self.start(), slice(BOAT_ERRORS)
        before = estimate if estimate.count >= MIN_CALM_SECONDS else fresh
        fresh.means[:, b] = before.means[BOAT, b]
        fresh.covariances[:, b, b] = before.covariances[BOAT, b, b]
        return replace(
            estimate, means=fresh.means, covariances=fresh.covariances, scores=fresh.scores,
            opened=time, driven=0, beside=beside,
        )  # fmt: skip

    def observe(
        self, estimate: DisturbanceEstimate, second: SecondMeans
    ) -> tuple[DisturbanceEstimate, Balance]:
        """One more second -> the estimate after it, and the balance there."""
        drives = self.drives(second)
        second = self.without(second, estimate.beside)
        F = self._balances(estimate, second)
        silence = max(second.time - estimate.time, 0.0)
        dt = min(silence, MAX_SILENCE_S) if estimate.count else 0.0
        means, covariances = estimate.means.copy(), estimate.covariances.copy()
        innovations, scores = estimate.innovations.copy(), estimate.scores.copy()
        noise = estimate.noise.copy()
        advance_filters(
            (self.all.which, self.all.prior, self.all.walk_s),
            (means, covariances, innovations, scores),
            (second.missing, self.variance(second, noise)),
            _second(second), tuple(self.hull), F, dt, estimate.count, noise,
        )  # fmt: skip
        after = DisturbanceEstimate(
            self.all, means, covariances, innovations, scores, noise, second.time,
            estimate.count + 1, estimate.opened, estimate.driven + drives, estimate.beside,
        )  # fmt: skip
        return after, Balance.of(F)

    def without(self, second: SecondMeans, known: Iterable[KnownCause]) -> SecondMeans:
        """A second as it would be without causes that are known: in water that moves, through the
        water; of a compass that is off, as the boat lay.
        """
        for one in known:
            motion, o = second.motion.copy(), one.size
            current = o if one.law is Law.CURRENT else NO_CURRENT
            off = float(o[0]) if one.law is Law.COMPASS else 0.0
            thrust = np.zeros(len(self.thrust_numbers))
            which = self.all.which[one.number]
            if one.law is Law.THRUST:
                thrust[int(which[1])] = o[0]
            balances = balances_at(self.model, second, current, off)
            F = np.concatenate([balances, self.thrusts(second, thrust)])
            force = self.linearised(which, o, second, F).force
            if one.law is Law.CURRENT:
                motion[3:] -= current_shift(current, second)
            elif one.law is Law.COMPASS:
                for i in (3, 6):  # velocity, acceleration
                    motion[i], motion[i + 1] = to_world(motion[i], motion[i + 1], off)
                motion[Eta.YAW] -= off
            second = replace(second, motion=motion, missing=second.missing - force)
        return second

    def _balances(self, estimate: DisturbanceEstimate, second: SecondMeans) -> Floats:
        """Balances (11 + T, 3), T of each thruster and of all, that the laws take, where the
        estimate stands.
        """
        current = estimate.means[WATER, BOAT_ERRORS : BOAT_ERRORS + 2]
        off = float(estimate.means[self.compass, BOAT_ERRORS])
        laws, shares = self.all.laws, estimate.means[:, BOAT_ERRORS]
        thrust = [share for share, law in zip(shares, laws, strict=True) if law is Law.THRUST]
        balances = balances_at(self.model, second, current, off)
        return np.concatenate([balances, self.thrusts(second, np.array(thrust))])

    def thrusts(self, second: SecondMeans, shares: Floats) -> Floats:
        """What each thruster, and then all of them, add per share of their thrust too much, about
        `shares` (T,): (T, 3).

        By the vessel's balance with and without that share: a thruster may be steered, and lose its
        push through the water, and a rudder may stand in its stream.
        """
        model, row, time = self.model, second.motion[None], np.array([second.time])
        commands, out = second.mean_commands[None], np.zeros((len(shares), 3))
        before, _ = model.missing_force(row, time, commands, commands)
        for i, share in enumerate(np.where(np.abs(shares) < MIN_SHARE, -MIN_SHARE, shares)):
            theta = model.theta.copy()
            theta[self.thrust_numbers[i]] *= 1.0 + share
            changed, _ = model.missing_force(row, time, commands, commands, theta=theta)
            out[i] = (before[0] - changed[0]) / share
        return out

    @cached_property
    def thrust_numbers(self) -> list[Ints]:
        """Columns of theta with the thrust, ahead and astern, of each thruster; then of all."""
        names, each = self.model.names, self.model.vessel.thrusters
        found = [
            np.array([names.index(f"{t.name}.{end}") for end in ("ahead", "astern")]) for t in each
        ]
        return [*found, np.concatenate(found)] if found else []

    def measured(
        self, estimate: DisturbanceEstimate, second: SecondMeans, f: int
    ) -> MeasurementModel:
        """Explanation f where the estimate stands."""
        which, F = self.all.which[f], self._balances(estimate, second)
        return self.linearised(which, estimate.filter(f).disturbance, second, F)

    def explained(
        self, estimate: DisturbanceEstimate, second: SecondMeans, f: int
    ) -> tuple[Floats, Balance]:
        """Missing force (3,) that explanation f makes with what is known beside it, without the
        boat's own errors, and the balance.
        """
        beside = self.without(second, estimate.beside)
        F = self._balances(estimate, beside)
        made = self.linearised(self.all.which[f], estimate.filter(f).disturbance, beside, F).force
        return made + second.missing - beside.missing, Balance.of(F)

    def linearised(
        self, which: Ints, o: Floats, second: SecondMeans, F: Floats
    ) -> MeasurementModel:
        """An explanation (3,) as `Explanations.which` has it, of size o, with the balances F."""
        force, H = np.empty(3), np.empty((3, int(which[2])))
        law, thruster, _ = which.tolist()
        linearised(law, thruster, o, _second(second), tuple(self.hull), F, force, H)
        return MeasurementModel(H[:, :BOAT_ERRORS], force, H[:, BOAT_ERRORS:])

    def variance(self, second: SecondMeans, noise: Floats) -> Floats:
        """Variance of a missing force: (3,), the stated one times `noise` (3,)."""
        return np.asarray(noise * second.missing_std**2 + (MIN_NOISE * self.prior[:3]) ** 2)

    def water_model(self, second: SecondMeans, F: Floats, current: Floats) -> MeasurementModel:
        """F(ν) − F(ν − c), and its slope against c; balances F (>= 9, 3) in that current."""
        return self.linearised(self.all.which[WATER], current, second, F)

    def air_model(self, second: SecondMeans, g: Floats) -> MeasurementModel:
        """w(ψ, ν; g), and its slope against g."""
        return self.linearised(self.all.which[AIR], g, second, NO_BALANCES)


NO_BALANCES = np.zeros((0, 3))


def _second(second: SecondMeans) -> tuple[Floats, ...]:
    """What the laws take of a second."""
    return second.motion, second.commanded
