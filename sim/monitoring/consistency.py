"""Is the model wrong just now? Prediction errors that come due, beside their noise floor.

    z = mean over u, v, r and horizons of e² / (R + Φ P₀ Φᵀ + Σ Ψ_i Q_i Ψ_iᵀ + s²)
    Φ = Φ_k … Φ_2 Φ_1,     Ψ_i = Φ_k … Φ_i+1,     Q_i = (M⁻¹ Δτ_i δ)²

e is the error of a free prediction, P₀ and R the covariance of the estimate at its start and end,
Φ_i = exp(A_i t) the linearised model over one second, s a size below which nobody minds. Above its
critical speed a hull is unstable on course: Φ grows there and so does the floor, and what comes of
the start state is not put down to the model. Q is what a change of the commanded forces leaves when
its moment is known to δ: servo outputs may come twice a second. z of a perfect model is about 1 or
less, since errors of the estimate are taken as white. Its running mean goes through a hysteresis.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sim.monitoring.live_second import Balance, Moment
from sim.prediction.scales import MIN_SCALES
from sim.state import Floats

MINDED = 0.3 * MIN_SCALES  # m/s, m/s, rad/s
MEAN_S = 20.0  # memory of the running means
HIGH, LOW = 3.0, 1.5  # the model is wrong above, right again below
PARTS = 8  # of a second
TIMING_S = 0.2  # δ
LARGEST = 12.0  # one z counts no more than this


class Past(NamedTuple):
    """One second: variance (3,) of the estimate, Φ (3, 3), Q (3,)."""

    variance: Floats
    transition: Floats
    kick: Floats


@dataclass(frozen=True)
class Misfit:
    """What the last seconds' predictions say.

    level    running mean of z           z      of this second, NaN where nothing came due
    squares  (3,) running sum of e²      floors (3,) of its expected variance, first horizon;
             both over the same weights, so that their roots compare
    weight   of the two sums
    wrong    between HIGH and LOW        since  when the level left LOW behind [s]
    past     of the last seconds, oldest first
    commanded  (3,) a second ago, None at the start
    """

    level: float = 0.0
    z: float = np.nan
    squares: Floats = field(default_factory=lambda: np.zeros(3))
    floors: Floats = field(default_factory=lambda: np.zeros(3))
    weight: float = 0.0
    wrong: bool = False
    since: float = np.inf
    past: tuple["Past", ...] = ()
    commanded: Floats | None = None

    def observe(self, moment: Moment, balance: Balance, horizons: tuple[int, ...]) -> "Misfit":
        """One more second, the balance there; errors (H, 3) came due over `horizons` (H,) [s]."""
        before = moment.commanded if self.commanded is None else self.commanded
        change = moment.commanded - before
        kick = np.asarray(np.linalg.solve(balance.acceleration, change) * TIMING_S, float) ** 2
        now = Past(moment.variance, transition(balance.rate), kick)
        past = (*self.past, now)[-max(horizons) - 1 :]
        floors = [self._floor(past, moment, seconds) for seconds in horizons]
        found = [
            (error, floor)
            for error, floor in zip(moment.errors, floors, strict=True)
            if floor is not None and bool(np.isfinite(error).all())
        ]
        if not found:
            return replace(self, z=np.nan, past=past, commanded=moment.commanded)
        z = float(np.mean([np.mean(error**2 / floor) for error, floor in found]))
        level = self.level + (min(z, LARGEST) - self.level) / MEAN_S
        error, floor = found[0]
        since = min(self.since, moment.time) if level > LOW or self.wrong else np.inf
        return Misfit(
            level, z,
            self.squares + (error**2 - self.squares) / MEAN_S,
            self.floors + (floor - self.floors) / MEAN_S,
            self.weight + (1.0 - self.weight) / MEAN_S,
            level > (LOW if self.wrong else HIGH), since, past, moment.commanded,
        )  # fmt: skip

    @property
    def errors(self) -> Floats:
        """Root mean square error of u, v, r over the shortest horizon, and its floor: (2, 3)."""
        mean = np.stack([self.squares, self.floors]) / max(self.weight, 1e-12)
        return np.asarray(np.sqrt(mean))

    def broken(self) -> "Misfit":
        """The estimate jumped or fell silent: predictions under way tell nothing."""
        return replace(self, z=np.nan, past=(), commanded=None)

    @staticmethod
    def _floor(past: tuple[Past, ...], moment: Moment, seconds: int) -> Floats | None:
        """Expected variance (3,) of the error over that horizon; None where it began too early."""
        if len(past) <= seconds:
            return None
        phi, kicked = np.eye(3), np.zeros(3)
        for second in reversed(past[-seconds:]):
            kicked = kicked + phi**2 @ second.kick
            phi = phi @ second.transition
        return moment.variance + phi**2 @ past[-seconds - 1].variance + kicked + MINDED**2


def transition(rate: Floats) -> Floats:
    """exp(A · 1 s) (3, 3), by Cayley's form of an eighth: scipy's takes milliseconds."""
    half = 0.5 * rate / PARTS
    step = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    return np.linalg.matrix_power(step, PARTS)
