"""One explanation of the missing force, as a Kalman filter that keeps its score.

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 2

x = (b, o): b what the boat itself may be off by, o (north, east) what is outside it. The score is
how well each second was foretold. Seconds hang together more than R says: two count as one.
Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
§5.4 and §11.6 (multiple models); Joseph's form of the covariance.

Current and wind, estimated while the boat sails: three explanations of the missing force.

    f = B(ν, τ) b + e                                nothing but the boat itself
    f = B(ν − c, τ) b + F(ν) − F(ν − c) + e          the water moves: c north, east [m/s]
    f = B(ν, τ) b + w(ψ, ν; g) + e                   the air pushes: g north, east

f is the missing force, meaned over a second, F the balance of the vessel. b are what the boat
itself may be off by (a constant force, the scale of its thrust and of its damping, a heading that
is off), with priors: what stays fixed to the boat is not put down to water or air. Damping goes
with the velocity through the water: written over ground, a boat that drifts along with a current
would look like one without sway damping. e starts with the standard deviation that the estimate
states, and then follows what the best explanation leaves. With wind areas g = |V| V of the wind,
else it is a force [N]. Source of the filter: see `belief`.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from sim.model import Model
from sim.monitoring.live_second import Air, Balance, Moment, balance_at, in_body, shift_by
from sim.state import Floats

OWN = 10  # components of b
FORGET_S = 180.0  # memory of the score
RELIEF = 2.0  # seconds that count as one
SURPRISE = 16.0  # squared standard deviations over three axes: beyond this noise is not Gaussian
DRIFT_S, OWN_DRIFT_S = 1800.0, 20000.0  # s over which a random walk reaches its prior's width
SURE = 3.0  # standard deviations


class MeasurementModel(NamedTuple):
    """What an explanation says of one second: B (3, 10), h (3,), its slope (3, 0 or 2)."""

    own: Floats
    outside: Floats
    slope: Floats


@dataclass(frozen=True)
class DisturbanceFilter:
    """mean (n,), covariance (n, n), score [nats]; odd (3,): the last miss² over what was expected.

    prior (n,) are the standard deviations at the start.
    """

    prior: Floats
    mean: Floats
    covariance: Floats
    odd: Floats
    score: float = 0.0

    @classmethod
    def start(cls, own: Floats, outside: float | None = None) -> "DisturbanceFilter":
        """Widths of b (10,) and of either component outside, where there is anything outside."""
        prior = own if outside is None else np.append(own, [outside, outside])
        return cls(prior, np.zeros(len(prior)), np.diag(prior**2), np.ones(3))

    @property
    def outside(self) -> Floats:
        """North, east (2,)."""
        return self.mean[OWN:]

    @property
    def spread(self) -> Floats:
        """Covariance of what is outside: (2, 2)."""
        return self.covariance[OWN:, OWN:]

    @property
    def certain(self) -> bool:
        """Is what is outside clearly not nothing?"""
        return float(self.outside @ np.linalg.solve(self.spread, self.outside)) > SURE**2

    def updated(
        self, force: Floats, variance: Floats, sight: MeasurementModel, dt: float
    ) -> "DisturbanceFilter":
        """Missing force (3,) with its variance (3,), `dt` [s] after the last."""
        walk = np.where(np.arange(len(self.prior)) < OWN, OWN_DRIFT_S, DRIFT_S)
        P = self.covariance + np.diag(self.prior**2 * dt / walk)
        H, R = np.hstack([sight.own, sight.slope]), np.diag(variance)
        miss = force - sight.own @ self.mean[:OWN] - sight.outside
        S = H @ P @ H.T + R
        squared, odd = float(miss @ np.linalg.solve(S, miss)), miss**2 / np.diag(S)
        if squared > SURPRISE:  # a jolt: it counts, but less
            R = R * (squared / SURPRISE)
            S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(len(self.mean)) - K @ H
        said = -0.5 * (min(squared, SURPRISE) + float(np.linalg.slogdet(S)[1])) / RELIEF
        score = self.score * float(np.exp(-dt / FORGET_S)) + said
        return DisturbanceFilter(
            self.prior, self.mean + K @ miss, A @ P @ A.T + K @ R @ K.T, odd, score
        )


WATER = 0.5  # m/s, prior of either component
WORTH = 8.0  # nats by which an explanation must beat the boat itself …
APART = 4.0  # … and water the air, or the other way round
NOISE_S = 60.0  # memory of how large e is
NOISE = (0.1, 10.0)  # its variance over the stated one: at least, at most
LEAST = 0.01  # of what the boat itself may be off by: no estimate is perfect
LONGEST_S = 600.0  # a longer silence counts as this long


class Cause(Enum):
    """What the surroundings do that the vessel does not know."""

    NOTHING = "none"
    CURRENT = "current"
    WIND = "wind"
    EITHER = "current or wind"


@dataclass(frozen=True)
class Outlook:
    """The three explanations after `count` seconds; noise (3,): variance over the stated one."""

    boat: DisturbanceFilter
    water: DisturbanceFilter
    air: DisturbanceFilter
    noise: Floats
    time: float = -np.inf
    count: int = 0

    @property
    def because(self) -> Cause:
        """What explains the missing force best, as far as these seconds tell."""
        water, air = self.water.score - self.boat.score, self.air.score - self.boat.score
        if max(water, air) < WORTH:
            return Cause.NOTHING
        better = self.water if water > air else self.air
        if abs(water - air) < APART or not better.certain:
            return Cause.EITHER
        return Cause.CURRENT if water > air else Cause.WIND


@dataclass(frozen=True)
class Estimator:
    """The vessel, its air, and how far the boat itself may be off: (10,) standard deviations."""

    model: Model
    air: Air
    own: Floats

    @classmethod
    def of(cls, model: Model) -> "Estimator":
        """Widths follow the size of the vessel."""
        vessel = model.vessel
        thrust = sum(t.thrust[1] for t in vessel.thrusters) or 0.5 * vessel.hull.mass
        lever = 0.5 * vessel.hull.beam
        force = [0.1 * thrust, 0.1 * thrust, 0.1 * thrust * lever]
        scale = [0.2, 0.2, 0.2, 0.15, 0.2]  # of thrust, of turning, of damping in u, v, r
        askew = -0.2 * vessel.dynamics.Y_v  # N s/m: a heading that is off by 0.2 rad
        own = np.array([*force, *scale, askew, askew * lever])
        return cls(model, Air.of(vessel, thrust), own)

    def start(self) -> Outlook:
        """Nothing seen yet."""
        boat, water = DisturbanceFilter.start(self.own), DisturbanceFilter.start(self.own, WATER)
        return Outlook(boat, water, DisturbanceFilter.start(self.own, self.air.prior), np.ones(3))

    def observe(self, outlook: Outlook, moment: Moment) -> tuple[Outlook, Balance]:
        """One more second -> what is believed after it, and the balance there."""
        balance = balance_at(self.model, moment, outlook.water.outside)
        dt = min(max(moment.time - outlook.time, 0.0), LONGEST_S) if outlook.count else 0.0
        variance = outlook.noise * moment.std**2 + (LEAST * self.own[:3]) ** 2
        boat, water, air = (
            belief.updated(moment.missing, variance, sight, dt)
            for belief, sight in (
                (outlook.boat, self._boat(moment)),
                (outlook.water, self._water(moment, balance, outlook.water.outside)),
                (outlook.air, self._air(moment, outlook.air.outside)),
            )
        )
        odd = max((boat, water, air), key=lambda belief: belief.score).odd
        change = 1.0 + (np.minimum(odd, 9.0) - 1.0) * min(dt / NOISE_S, 0.1)
        noise = np.clip(outlook.noise * change, *NOISE)
        return Outlook(boat, water, air, noise, moment.time, outlook.count + 1), balance

    def _boat(self, moment: Moment) -> MeasurementModel:
        return MeasurementModel(self._own(moment, moment.nu), np.zeros(3), np.zeros((3, 0)))

    def _water(self, moment: Moment, balance: Balance, current: Floats) -> MeasurementModel:
        """F(ν) − F(ν − c), and its slope against c."""
        turn = np.array([in_body(e, moment.yaw) for e in np.eye(2)]).T  # world to body (2, 2)
        spin = moment.nu[2] * np.array([[0.0, 1.0], [-1.0, 0.0]]) @ turn
        slope = balance.velocity[:, :2] @ turn + balance.acceleration[:, :2] @ spin
        through = moment.nu - shift_by(current, moment)[:3]
        return MeasurementModel(self._own(moment, through), balance.still - balance.moving, slope)

    def _air(self, moment: Moment, g: Floats) -> MeasurementModel:
        return MeasurementModel(self._own(moment, moment.nu), *self.air.push(g, moment))

    def _own(self, moment: Moment, nu: Floats) -> Floats:
        """B (3, 10): what one unit of each of the boat's own errors adds to the missing force."""
        u, v, r = nu
        d = self.model.vessel.dynamics
        out = np.zeros((3, OWN))
        out[0, 0] = out[1, 1] = out[2, 2] = 1.0
        out[0, 3], out[2, 4] = moment.commanded[0], moment.commanded[2]
        out[0, 5] = (d.X_u + d.X_uu * abs(u)) * u
        out[1, 6] = (d.Y_v + d.Y_vv * abs(v)) * v
        out[2, 7] = (d.N_r + d.N_rr * abs(r)) * r
        out[1, 8] = out[2, 9] = u
        return out
