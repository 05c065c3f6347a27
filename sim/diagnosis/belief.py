"""One explanation of the missing force, as a Kalman filter that keeps its score.

    x ← x + K m,     m = f − B b − h(o),     S = H P Hᵀ + R,     H = [B ∂h/∂o]
    score ← score e^(−dt/T) − ½ (mᵀ S⁻¹ m + ln |S|) / 2

x = (b, o): b what the boat itself may be off by, o (north, east) what is outside it. The score is
how well each second was foretold. Seconds hang together more than R says: two count as one.
Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
§5.4 and §11.6 (multiple models); Joseph's form of the covariance.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.state import Floats

OWN = 10  # components of b
FORGET_S = 180.0  # memory of the score
RELIEF = 2.0  # seconds that count as one
SURPRISE = 16.0  # squared standard deviations over three axes: beyond this noise is not Gaussian
DRIFT_S, OWN_DRIFT_S = 1800.0, 20000.0  # s over which a random walk reaches its prior's width
SURE = 3.0  # standard deviations


class Sight(NamedTuple):
    """What an explanation says of one second: B (3, 10), h (3,), its slope (3, 0 or 2)."""

    own: Floats
    outside: Floats
    slope: Floats


@dataclass(frozen=True)
class Belief:
    """mean (n,), covariance (n, n), score [nats]; odd (3,): the last miss² over what was expected.

    prior (n,) are the standard deviations at the start.
    """

    prior: Floats
    mean: Floats
    covariance: Floats
    odd: Floats
    score: float = 0.0

    @classmethod
    def start(cls, own: Floats, outside: float | None = None) -> "Belief":
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

    def updated(self, force: Floats, variance: Floats, sight: Sight, dt: float) -> "Belief":
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
        return Belief(self.prior, self.mean + K @ miss, A @ P @ A.T + K @ R @ K.T, odd, score)
