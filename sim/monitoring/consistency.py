"""Is the model wrong just now? Prediction errors that come due, beside their noise floor.

    z = mean over u, v, r and horizons of e² / (R + Φ P₀ Φᵀ + Σ Ψ_i Q_i Ψ_iᵀ + s²)
    Φ = Φ_k … Φ_2 Φ_1,     Ψ_i = Φ_k … Φ_i+1,     Q_i = (M⁻¹ Δτ_i δ)²

e is the error of a free prediction, P₀ and R the covariance of the estimate at its start and end,
Φ_i = exp(A_i t) the linearised model over one second, s a size below which errors do not matter.
Above its critical speed a hull is unstable on course: Φ grows there and so does the floor, and what
comes of the start state is not put down to the model. Q is what a change of the commanded forces
leaves when its moment is known to δ: servo outputs may come twice a second. z of a perfect model is
about 1 or less, since errors of the estimate are taken as white. Its running mean goes through a
hysteresis.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sim.monitoring import Balance, SecondMeans
from sim.prediction.free_runs import MIN_SCALES
from sim.state import Floats

# Chosen; together they give benchmarks/results/live_diagnosis.md: no event on six complete vessels,
# a model called wrong 11 to 20 s after a current sets in.
NEGLIGIBLE = 0.3 * MIN_SCALES  # s: m/s, m/s, rad/s
MEMORY_S = 20.0  # of the running means
WRONG_ABOVE, RIGHT_BELOW = 3.0, 1.5  # mean of z
COMMAND_TIMING_S = 0.2  # δ
MAX_Z = 12.0  # a single z counts no more than this
SUBSTEPS = 8  # of a second, for its transition
# A prediction that noise alone may put so far off [m/s, m/s, rad/s] judges nothing: the model runs
# away from any start, as a fast hull that is unstable on course does.
MAX_FLOOR_STD = np.array([5.0, 5.0, 3.0])


class PastSecond(NamedTuple):
    """One second: variance (3,) of the estimate, Φ (3, 3), Q (3,)."""

    variance: Floats
    transition: Floats
    command_variance: Floats


@dataclass(frozen=True)
class Misfit:
    """How large the prediction errors of the last seconds are, beside what noise explains.

    level    running mean of z           z      of this second, NaN where nothing came due
    squares  (3,) running sum of e²      floors (3,) of its expected variance, first horizon;
             both over the same weights, so that their roots compare
    weight   of the two sums
    wrong    after the hysteresis        since  when the level last rose above `RIGHT_BELOW` [s]
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
    past: tuple[PastSecond, ...] = ()
    commanded: Floats | None = None

    def observe(self, second: SecondMeans, balance: Balance, horizons: tuple[int, ...]) -> "Misfit":
        """One more second, the balance there; errors (H, 3) came due over `horizons` (H,) [s]."""
        before = second.commanded if self.commanded is None else self.commanded
        change = np.linalg.solve(balance.slope_nu_dot, second.commanded - before)
        unknown = np.asarray(change * COMMAND_TIMING_S, float) ** 2
        now = PastSecond(second.variance, transition(balance.system_matrix), unknown)
        past = (*self.past, now)[-max(horizons) - 1 :]
        floors = [_floor(past, second, seconds) for seconds in horizons]
        due = [
            (error, floor)
            for error, floor in zip(second.errors, floors, strict=True)
            if floor is not None and bool(np.isfinite(error).all())
        ]
        if not due:
            return replace(self, z=np.nan, past=past, commanded=second.commanded)
        z = float(np.mean([np.mean(error**2 / floor) for error, floor in due]))
        level = self.level + (min(z, MAX_Z) - self.level) / MEMORY_S
        error, floor = due[0]
        since = min(self.since, second.time) if level > RIGHT_BELOW or self.wrong else np.inf
        return Misfit(
            level, z,
            self.squares + (error**2 - self.squares) / MEMORY_S,
            self.floors + (floor - self.floors) / MEMORY_S,
            self.weight + (1.0 - self.weight) / MEMORY_S,
            level > (RIGHT_BELOW if self.wrong else WRONG_ABOVE), since, past, second.commanded,
        )  # fmt: skip

    @property
    def errors(self) -> Floats:
        """Root mean square error of u, v, r over the shortest horizon, and its floor: (2, 3)."""
        mean = np.stack([self.squares, self.floors]) / max(self.weight, 1e-12)
        return np.asarray(np.sqrt(mean))

    def after_gap(self) -> "Misfit":
        """The estimate jumped or fell silent: predictions under way are dropped."""
        return replace(self, z=np.nan, past=(), commanded=None)


def _floor(past: tuple[PastSecond, ...], second: SecondMeans, seconds: int) -> Floats | None:
    """Expected variance (3,) of the error over that horizon; None where it began too early, or
    where the prediction judges nothing.
    """
    if len(past) <= seconds:
        return None
    phi, commands = np.eye(3), np.zeros(3)
    for earlier in reversed(past[-seconds:]):
        commands = commands + phi**2 @ earlier.command_variance
        phi = phi @ earlier.transition
    floor = second.variance + phi**2 @ past[-seconds - 1].variance + commands + NEGLIGIBLE**2
    return np.asarray(floor) if bool((floor < MAX_FLOOR_STD**2).all()) else None


def transition(A: Floats) -> Floats:
    """exp(A · 1 s) (3, 3), by Cayley's form of an eighth: scipy's takes milliseconds."""
    half = 0.5 * A / SUBSTEPS
    step = np.linalg.solve(np.eye(3) - half, np.eye(3) + half)
    return np.linalg.matrix_power(step, SUBSTEPS)
