"""Is the model wrong just now? Prediction errors that come due, beside their noise floor.

    z = mean over u, v, r and horizons of e² / (R + Φ P₀ Φᵀ + Σ Ψ_i Q_i Ψ_iᵀ + s²)
    Φ = Φ_k … Φ_2 Φ_1,     Ψ_i = Φ_k … Φ_i+1,     Q_i = (M⁻¹ Δτ_i δ)²

e is the error of a free prediction, P₀ and R the covariance of the estimate at its start and end,
Φ_i = exp(A_i t) the linearised model over one second, of velocities and heading (with which goes
what a current in the vessel file does), s a size below which errors do not matter.
Above its critical speed a hull is unstable on course: Φ grows there and so does the floor, and what
comes of the start state is not put down to the model. Q is what a change of the commanded forces
leaves when its moment is known to δ: servo outputs may come twice a second. z of a perfect model is
about 1 or less, since errors of the estimate are taken as white. Its running mean goes through a
hysteresis.

Errors after one second that change from second to second are no force that the model lacks, which
lasts, but the velocity of a chop or the scatter of a receiver. With q the mean of e² after one
second and d half that of its change, both beyond what is expected,

    min(d, q² / d)

is part of the floor of the longer predictions: of a swing of ω it is the mean of e² after any
longer time, q = 2 σ² (1 − cos ω), d = q (1 − cos ω). The same of predictions that follow one
another over five seconds, for velocities that err one way for some seconds, would hide most of what
changes as the boat manoeuvres: a motor that lags, a load.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from sim.kernel.compiled import compiled
from sim.monitoring import Balance, SecondMeans
from sim.prediction.free_runs import MIN_SCALES
from sim.state import Floats, Ints

# Chosen; together they give benchmarks/results/live_diagnosis.md: no event on six complete vessels,
# a model called wrong 11 to 20 s after a current sets in.
NEGLIGIBLE = 0.3 * MIN_SCALES  # s: m/s, m/s, rad/s
MEMORY_S = 20.0  # of the running means
RECENT_S = 5.0  # of the shorter one
WRONG_ABOVE, RIGHT_BELOW = 3.0, 1.5  # mean of z
MIN_TIMES_FLOOR = 2.0  # mean square of u, v or r over its floor: "off by 0.05, noise explains 0.05"
COMMAND_TIMING_S = 0.2  # δ
TINY = 1e-12
MAX_Z = 12.0  # a single z counts no more than this
DOUBLINGS = 3  # of the step from which the transition of a second is made …
SUBSTEPS = 2**DOUBLINGS  # … so many of them
# A prediction that noise alone may put so far off [m/s, m/s, rad/s] judges nothing: the model runs
# away from any start, as a fast hull that is unstable on course does.
MAX_FLOOR_STD = np.array([5.0, 5.0, 3.0])


# Columns of a past second: variance (3,) of the estimate, Φ (4, 4) row by row, Q (3,)
STATES = 4  # u, v, r, ψ
TRANSITION, COMMANDS, COLUMNS = 3, 3 + STATES**2, 6 + STATES**2
NO_PAST = np.zeros((0, COLUMNS))
NO_CHOP, UNKNOWN = np.zeros(3), np.full(3, np.nan)


@dataclass(frozen=True)
class Misfit:
    """How large the prediction errors of the last seconds are, beside what noise explains.

    level    running mean of z           z      of this second, NaN where nothing came due
    recent   the same over few seconds
    squares  (3,) running sum of e²      floors (3,) of its expected variance, first horizon;
             both over the same weights, so that their roots compare
    short    (3,) running mean of e² after one second, less its expected variance
    changes  (3,) the same of half the squared change from second to second
    weight   of the sums
    wrong    after the hysteresis        since  when the level last rose above `RIGHT_BELOW` [s]
    past     (K, 22) the last seconds, oldest first
    commanded  (3,) a second ago, None at the start
    short_error  (3,) after one second, a second ago
    """

    level: float = 0.0
    recent: float = 0.0
    z: float = np.nan
    squares: Floats = field(default_factory=lambda: np.zeros(3))
    floors: Floats = field(default_factory=lambda: np.zeros(3))
    short: Floats = field(default_factory=lambda: np.zeros(3))
    changes: Floats = field(default_factory=lambda: np.zeros(3))
    weight: float = 0.0
    wrong: bool = False
    since: float = np.inf
    past: Floats = field(default_factory=lambda: NO_PAST)
    commanded: Floats | None = None
    short_error: Floats = field(default_factory=lambda: UNKNOWN)

    def observe(
        self, second: SecondMeans, balance: Balance, horizons: tuple[int, ...], clears: bool = True
    ) -> "Misfit":
        """One more second, the balance there; errors (H, 3) came due over `horizons` (H,) [s].

        `clears`: whether small errors of this second may end what was wrong.
        """
        before = second.commanded if self.commanded is None else self.commanded
        change = np.asarray(np.linalg.solve(balance.slope_nu_dot, second.commanded - before), float)
        past = np.empty((min(len(self.past), max(horizons)) + 1, COLUMNS))
        past[:-1] = self.past[-max(horizons) :]
        write_second(second.variance, balance.system_matrix, change, past[-1])
        seen = self._with_short(second, past)
        due = np.empty((len(horizons), 3))
        z, first = judge(past, second.variance, seen.chop, np.array(horizons), second.errors, due)
        seen = replace(seen, z=np.nan, past=past, commanded=second.commanded)
        if first < 0:
            return seen
        error, floor = second.errors[first], due[first]
        level = self.level + (min(z, MAX_Z) - self.level) / MEMORY_S
        level = level if clears else max(level, self.level)
        recent = self.recent + (min(z, MAX_Z) - self.recent) / RECENT_S
        since = min(self.since, second.time) if level > RIGHT_BELOW or self.wrong else np.inf
        squares = self.squares + (error**2 - self.squares) / MEMORY_S
        floors = self.floors + (floor - self.floors) / MEMORY_S
        shows = bool((squares > MIN_TIMES_FLOOR * floors).any())
        wrong = level > RIGHT_BELOW if self.wrong else level > WRONG_ABOVE and shows
        if self.wrong and not wrong:  # it has ended: what comes next has an onset of its own
            since = np.inf
        return replace(
            seen, level=level, recent=recent, z=z, squares=squares, floors=floors, since=since,
            weight=self.weight + (1.0 - self.weight) / MEMORY_S,
            wrong=wrong,
        )  # fmt: skip

    def _with_short(self, second: SecondMeans, past: Floats) -> "Misfit":
        """One more error after one second, and its change where one came due a second ago too."""
        now = replace(self, short_error=second.short_error)
        change, expected = second.short_error - self.short_error, np.empty(3)
        judges = write_floor(past, second.variance, 1, NO_CHOP, expected)
        if not (judges and np.isfinite(change).all()):
            return now
        short = self.short + (second.short_error**2 - expected - self.short) / MEMORY_S
        changes = self.changes + (0.5 * change**2 - expected - self.changes) / MEMORY_S
        return replace(now, short=short, changes=changes)

    @property
    def chop(self) -> Floats:
        """Variance (3,) of predictions that is due to velocities which swing within seconds."""
        short, changes = np.maximum(self.short, 0.0), np.maximum(self.changes, 0.0)
        return np.asarray(np.minimum(changes, short**2 / np.maximum(changes, TINY)))

    @property
    def ends(self) -> bool:
        """Whether errors of late would not be called wrong."""
        return self.recent < WRONG_ABOVE

    @property
    def errors(self) -> Floats:
        """Root mean square error of u, v, r over the shortest horizon, and its floor: (2, 3)."""
        mean = np.stack([self.squares, self.floors]) / max(self.weight, TINY)
        return np.asarray(np.sqrt(mean))

    @property
    def worst_channel(self) -> int:
        """Of u, v, r: the one whose error is largest beside its floor."""
        error, floor = self.errors
        return int(np.argmax(error / np.maximum(floor, TINY)))

    def after_gap(self) -> "Misfit":
        """The estimate jumped or fell silent: predictions under way are dropped."""
        return replace(self, z=np.nan, past=NO_PAST, commanded=None, short_error=UNKNOWN)


@compiled
def write_second(variance: Floats, A: Floats, change: Floats, out: Floats) -> None:
    """A second as `Misfit.past` keeps it: variance (3,), A (4, 4), M⁻¹ Δτ (3,) -> (22,)."""
    phi = transition(A)
    for i in range(3):
        out[i] = variance[i]
        out[COMMANDS + i] = (change[i] * COMMAND_TIMING_S) ** 2
    for i in range(STATES):
        for j in range(STATES):
            out[TRANSITION + STATES * i + j] = phi[i, j]


@compiled
def judge(
    past: Floats, variance: Floats, beside: Floats, horizons: Ints, errors: Floats, floors: Floats
) -> tuple[float, int]:
    """Errors (H, 3) of the predictions over `horizons` (H,) that end now, beside what they may be.

    past (K, 22), the newest second last; variance (3,) of the estimate, beside (3,) of what comes
    and goes within seconds -> mean of z, NaN where none counts, and the first horizon that does,
    else −1. floors (H, 3): the expected variances, NaN where a prediction began too early, or
    judges nothing.
    """
    total, count, first = 0.0, 0, -1
    for h in range(len(horizons)):
        counts = write_floor(past, variance, horizons[h], beside, floors[h])
        z = 0.0
        for i in range(3):
            z += errors[h, i] ** 2 / floors[h, i] / 3.0
        if counts and np.isfinite(errors[h, 0] + errors[h, 1] + errors[h, 2]):
            total, count, first = total + z, count + 1, h if first < 0 else first
    return (total / count if count else np.nan), first


@compiled
def write_floor(past: Floats, variance: Floats, seconds: int, beside: Floats, out: Floats) -> bool:
    """Expected variance (3,) of the error over that horizon -> whether the prediction judges."""
    out[0] = out[1] = out[2] = np.nan
    if len(past) <= seconds:
        return False
    phi, commands = identity(), np.zeros(3)
    for k in range(len(past) - 1, len(past) - 1 - seconds, -1):
        one = past[k]
        for i in range(3):
            for j in range(3):
                commands[i] += phi[i, j] ** 2 * one[COMMANDS + j]
        phi = product(phi, one[TRANSITION:COMMANDS].reshape(STATES, STATES))
    before, judges = past[len(past) - 1 - seconds], True
    for i in range(3):
        out[i] = variance[i] + commands[i] + beside[i] + NEGLIGIBLE[i] ** 2
        for j in range(3):
            out[i] += phi[i, j] ** 2 * before[j]
        judges = judges and out[i] < MAX_FLOOR_STD[i] ** 2  # false of NaN
    return judges


@compiled
def transition(A: Floats) -> Floats:
    """exp(A · 1 s) (4, 4), by Cayley's form of an eighth: scipy's takes milliseconds."""
    minus, phi = identity(), identity()
    for i in range(STATES):
        for j in range(STATES):
            minus[i, j] -= 0.5 * A[i, j] / SUBSTEPS
            phi[i, j] += 0.5 * A[i, j] / SUBSTEPS
    solve(minus, phi)
    for _ in range(DOUBLINGS):
        phi = product(phi, phi)
    return phi


def step_response(A: Floats) -> Floats:
    """∫₀¹ exp(A t) dt (4, 4): what a constant push makes in a second, of the same form."""
    dt = 1.0 / SUBSTEPS
    inverse = np.linalg.inv(np.eye(STATES) - 0.5 * dt * A)
    phi, gamma = inverse @ (np.eye(STATES) + 0.5 * dt * A), dt * inverse
    for _ in range(DOUBLINGS):
        phi, gamma = phi @ phi, gamma + phi @ gamma
    return np.asarray(gamma)


@compiled
def identity() -> Floats:
    """(4, 4)."""
    out = np.zeros((STATES, STATES))
    for i in range(STATES):
        out[i, i] = 1.0
    return out


@compiled
def product(a: Floats, b: Floats) -> Floats:
    """a b (4, 4): in loops, numba takes seconds to compile `@`."""
    out = np.zeros((STATES, STATES))
    for i in range(STATES):
        for j in range(STATES):
            for k in range(STATES):
                out[i, j] += a[i, k] * b[k, j]
    return out


@compiled
def solve(a: Floats, b: Floats) -> None:
    """b ← a⁻¹ b (4, 4) by Gauss with pivots, `a` is used up; not finite where it is singular."""
    for k in range(STATES):
        pivot = k
        for i in range(k + 1, STATES):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        for j in range(STATES):
            a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            b[k, j], b[pivot, j] = b[pivot, j], b[k, j]
        for i in range(k + 1, STATES):
            share = a[i, k] / a[k, k]
            for j in range(STATES):
                a[i, j] -= share * a[k, j]
                b[i, j] -= share * b[k, j]
    for k in range(STATES - 1, -1, -1):
        for j in range(STATES):
            for i in range(k + 1, STATES):
                b[k, j] -= a[k, i] * b[i, j]
            b[k, j] /= a[k, k]
