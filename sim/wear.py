"""How a number of a boat went over its recordings, and whether it has changed at all.

    y_i = m(t_i) + w(t_i) + e_i,    e_i ~ N(0, s_i² + τ²),    w a random walk, Var = q · days

y_i is what recording i says, s_i its own standard deviation, τ the scatter from voyage to voyage
that no interval tells (water, load, wind). m is a constant, or a change that is believed:

    step   m = a + b [t > t_k]               weed, a propeller changed, a blow
    drift  m = a + b max(0, t − t_k)         wear, growth on the hull

A change is searched for at every t_k with `EDGE` recordings on either side. The statistic is the
mean of the likelihood ratios of all of them, weighted by what is expected beforehand: their
`SHAPES`, and that what wears changes the way in which it wears (`WORN`). Its p-value comes from the
same statistic of the recordings in random order (a permutation test: Good, Permutation, Parametric
and Bootstrap Tests of Hypotheses, 3rd ed. 2005), so it holds whatever the distribution of the
scatter, however many moments were tried and however wrong what was expected is; a value far from
the others counts as `FAR`, so no single bad day decides. What the change is, is then found by
robust regression (`_fitted`). τ is that of DerSimonian and Laird (Controlled Clinical Trials 7,
1986). The course is the Gaussian posterior of m + w, which is what a Kalman smoother computes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.special import logsumexp, stdtrit

from sim.state import Floats

# Chosen, not measured:
EDGE = 3  # recordings on either side of a change: fewer are a bad day
MIN_RECORDINGS = 2 * EDGE
SHAPES = {"step": 0.25, "drift": 0.25, "steady": 0.5}  # of changes; steady: a drift over them all
WORN = 0.8  # of changes go the way of wear: a propeller is renewed and a hull cleaned more rarely
LIKELIER = 4.0  # times as likely as another number does one change that wears
ALARM = 0.04  # share of fleets that may raise any false alarm: 5 % were asked for, measured ± 0.5
ORDERS = (500, 20_000)  # random orders: of every number, and of those that may be significant
PROMISING = 0.1  # p-value below which the second is run
MOST_MOMENTS = 100  # at which a change is tried; among more recordings, evenly spread
FAR = 4.0  # standard deviations, by the median: one bad day counts no more in the test
TAILS = 4.0  # degrees of freedom of a day's error, where the change is measured
ROUNDS = 50  # of expectation and maximisation
NORMAL_95 = 1.96
NORMAL_MAD = 1.4826  # standard deviations in a median absolute deviation


@dataclass(frozen=True)
class Series:
    """A number of one boat by recording: time (n,) [days, ascending], value and std (n,).

    wears  which way its size goes by wear: −1 down (thrust), 1 up (drag), 0: it is not what wears
    """

    time: Floats
    value: Floats
    std: Floats
    wears: int = 0


class Change(NamedTuple):
    """A change: step or drift, the moment [days] and its 95 % range, the level before, now.

    The range ends at recordings: what happened between two of them has no other date.

    share  change relative to the level before, with its 95 % interval; a loss is negative; `now`
           follows from both
    """

    kind: str
    moment: float
    moment95: tuple[float, float]
    before: float
    now: float
    share: float
    share95: tuple[float, float]


class Evidence(NamedTuple):
    """The best change of a series, and the probability of one so clear where there is none."""

    change: Change
    p_value: float


class Course(NamedTuple):
    """The smoothed number at the recordings: mean, low, high (n,); the scatter τ, and √q."""

    mean: Floats
    low: Floats
    high: Floats
    scatter: float
    rate: float


class Candidate(NamedTuple):
    """One form of change: its kind, its moment [days], its regressor (n,).

    between  recordings [days] between which it stands for every moment
    """

    kind: str
    moment: float
    form: Floats
    between: tuple[float, float]


def scatter_of(value: Floats, std: Floats) -> float:
    """Values and their standard deviations (n,) -> the scatter beyond them."""
    weight = std**-2.0
    mean = np.average(value, weights=weight)
    excess = float(np.sum(weight * (value - mean) ** 2)) - (len(value) - 1)
    room = float(weight.sum() - np.sum(weight**2) / weight.sum())
    return float(np.sqrt(max(excess, 0.0) / room)) if room > 0.0 else 0.0


def candidates_of(time: Floats) -> list[Candidate]:
    """All changes that are tried on recordings at these times (n,)."""
    last = len(time) - EDGE
    out = []
    tried = np.linspace(EDGE, last, min(MOST_MOMENTS, last - EDGE + 1)).astype(int)
    tried = np.array([k for k in np.unique(tried) if time[k] > time[k - 1]], dtype=int)
    for before, k, after in zip([EDGE - 1, *tried], tried, [*tried[1:], last + 1], strict=False):
        moment = 0.5 * float(time[k - 1] + time[k])
        form, between = (time > moment).astype(float), (float(time[before]), float(time[after - 1]))
        out.append(Candidate("step", moment, form, between))
    tried = np.unique(np.linspace(0, last - 1, min(MOST_MOMENTS, last)).astype(int))
    for before, k, after in zip([0, *tried], tried, [*tried[1:], last], strict=False):
        form, between = np.maximum(time - time[k], 0.0), (float(time[before]), float(time[after]))
        if form[-1] > 0.0:
            out.append(Candidate("drift", float(time[k]), form, between))
    return out


def evidence_of(series: Series, seed: int = 0) -> Evidence | None:
    """The change that explains most; None where there are too few recordings for any."""
    tried = candidates_of(series.time) if len(series.time) >= MIN_RECORDINGS else []
    if not tried:
        return None
    deviation = _deviation(series)
    root = 1.0 / deviation
    forms = root[:, None] * np.column_stack([c.form for c in tried])
    constant = root / np.linalg.norm(root)
    forms -= np.outer(constant, constant @ forms)
    forms /= np.maximum(np.linalg.norm(forms, axis=0), 1e-300)
    white = _tamed(root * (series.value - np.median(series.value)))
    prior = _prior(tried, series)
    likeness = _likeness(white[None], constant, forms)
    support = float(logsumexp(_nats(likeness, prior, len(white))))
    random, p = np.random.default_rng(seed), 1.0
    for orders in ORDERS:
        if p > PROMISING and orders != ORDERS[0]:
            break
        shuffled = random.permuted(np.tile(white, (orders, 1)), axis=1)
        others = logsumexp(_nats(_likeness(shuffled, constant, forms), prior, len(white)), axis=1)
        p = float((1 + np.sum(others >= support - 1e-9)) / (orders + 1))
    return Evidence(_change(series, tried, prior, deviation), p)


def _tamed(white: Floats) -> Floats:
    """Whitened values (n,) none of which is further from their median than `FAR` allows."""
    middle = np.median(white)
    far = FAR * NORMAL_MAD * float(np.median(np.abs(white - middle)))
    return np.clip(white, middle - far, middle + far) if far > 0.0 else white


def _deviation(series: Series) -> Floats:
    """Standard deviation (n,) of each value with the scatter; never zero."""
    least = 1e-9 * max(float(np.abs(series.value).max()), 1e-300)
    std = np.maximum(series.std, least)
    return np.sqrt(std**2 + scatter_of(series.value, std) ** 2)


def _likeness(white: Floats, constant: Floats, forms: Floats) -> Floats:
    """Whitened values (B, n) -> their correlation (B, K) with each form."""
    squares = np.sum(white**2, axis=1) - (white @ constant) ** 2
    return np.asarray(white @ forms / np.sqrt(np.maximum(squares, 1e-300))[:, None])


class _Prior(NamedTuple):
    """What is expected of the candidates: log of the share (K,) of each, if it goes down, if up."""

    down: Floats
    up: Floats

    def of(self, change: Floats) -> Floats:
        """The share (…, K) of each where it changes so."""
        return np.where(change < 0.0, self.down, self.up)


def _prior(tried: Sequence[Candidate], series: Series) -> _Prior:
    """By their shapes, and by the way in which the number wears."""
    first = next((i for i, c in enumerate(tried) if c.kind == "drift"), None)
    shape = np.array(["steady" if i == first else c.kind for i, c in enumerate(tried)])
    kinds, number, count = np.unique(shape, return_inverse=True, return_counts=True)
    share = np.array([SHAPES[str(kind)] for kind in kinds])
    each = np.log((share / share.sum() / count)[number])
    rising = series.wears * np.sign(np.median(series.value)) * (2.0 * WORN - 1.0)
    return _Prior(each + np.log1p(-rising), each + np.log1p(rising))


def _nats(likeness: Floats, prior: _Prior, n: int) -> Floats:
    """Correlations (B, K) of n values -> log of each form's likelihood ratio and share (B, K)."""
    nats = -0.5 * n * np.log1p(-np.minimum(likeness**2, 1.0 - 1e-12))
    return np.asarray(nats + prior.of(likeness))


class _Fits(NamedTuple):
    """All candidates fitted: level before and change (K,), covariance (K, 2, 2), log likelihood."""

    before: Floats
    change: Floats
    covariance: Floats
    nats: Floats


def _fitted(series: Series, tried: Sequence[Candidate], deviation: Floats) -> _Fits:
    """Regression with errors of Student's t, which a bad day moves little (Lange, Little, Taylor,
    J. Am. Stat. Assoc. 84, 1989), by expectation and maximisation."""
    last = np.array([candidate.form[-1] for candidate in tried])
    form = np.array([candidate.form for candidate in tried]) / last[:, None]
    A = np.stack([np.ones_like(form), form], axis=-1) / deviation[:, None]
    white, n = series.value / deviation, len(series.value)
    weight = np.ones_like(form)
    for _ in range(ROUNDS):
        weighted = weight[..., None] * A
        information = np.einsum("kni,knj->kij", weighted, A)
        z = np.linalg.solve(information, np.einsum("kni,n->ki", weighted, white)[..., None])[..., 0]
        left = (white - np.einsum("kni,ki->kn", A, z)) ** 2
        variance = np.maximum(np.mean(weight * left, axis=1), 1e-18)[:, None]
        weight = (TAILS + 1.0) / (TAILS + left / variance)
    nats = -0.5 * (n * np.log(variance[:, 0]))
    nats -= 0.5 * (TAILS + 1.0) * np.sum(np.log1p(left / (TAILS * variance)), axis=1)
    known = n / (n - 2.0) * (TAILS + 3.0) / (TAILS + 1.0) * variance[..., None]
    return _Fits(z[:, 0], z[:, 1], known * np.linalg.inv(information), nats)


def _change(series: Series, tried: Sequence[Candidate], prior: _Prior, deviation: Floats) -> Change:
    """The best candidate; size and intervals are over all of them, by their likelihood.

    What the best one alone says can lie at the end of an interval over all, or beyond it.
    """
    fits = _fitted(series, tried, deviation)
    size = np.where(fits.before == 0.0, 1e-300, fits.before)
    share = fits.change / size
    gradient = np.stack([-share, np.ones_like(share)], axis=-1) / size[:, None]
    variance = np.einsum("ki,kij,kj->k", gradient, fits.covariance, gradient)
    chosen = int(np.argmax(fits.nats))
    nats = fits.nats + prior.of(fits.change)
    posterior = np.exp(nats - logsumexp(nats))
    mean = float(posterior @ share)
    spread = float(np.sqrt(posterior @ (variance + (share - mean) ** 2)))
    half = float(stdtrit(len(series.time) - 2, 0.975)) * spread
    alike = [i for i, candidate in enumerate(tried) if candidate.kind == tried[chosen].kind]
    below = np.cumsum(posterior[alike]) / posterior[alike].sum()
    low, high = np.searchsorted(below, [0.025, 0.975]).clip(max=len(below) - 1)
    before = float(fits.before[chosen])
    return Change(
        tried[chosen].kind, tried[chosen].moment,
        (tried[alike[low]].between[0], tried[alike[high]].between[1]),
        before, before * (1.0 + mean), mean, (mean - half, mean + half),
    )  # fmt: skip


def believed(p_values: Sequence[float], wears: Sequence[int]) -> NDArray[np.bool_]:
    """Which changes of a whole fleet are believed: (n,) p-values, `Series.wears` of each -> (n,).

    Holm's rule with weights (Scandinavian Journal of Statistics 6, 1979): a fleet of any size
    raises any false alarm in at most `ALARM` of all cases, whatever else wears in it; of that
    share, numbers that wear have `LIKELIER` times as much as others.
    """
    p, out = np.asarray(p_values, dtype=float), np.zeros(len(p_values), np.bool_)
    weight = np.where(np.asarray(wears) != 0, LIKELIER, 1.0)
    left = float(weight.sum())
    for i in np.argsort(p / weight, kind="stable"):
        if p[i] > ALARM * weight[i] / left:
            break
        out[i] = True
        left -= float(weight[i])
    return out


def course_of(series: Series, change: Change | None = None) -> Course:
    """The smoothed number, on a random walk around a constant or around a change."""
    n, t = len(series.time), series.time
    columns = [np.ones(n)]
    if change is not None:
        step, drift = (t > change.moment).astype(float), np.maximum(t - change.moment, 0.0)
        columns.append(step if change.kind == "step" else drift)
    A = np.column_stack(columns)
    size = max(float(np.std(series.value)), 1e-9 * float(np.abs(series.value).max()), 1e-300)
    std = np.maximum(series.std, 1e-6 * size)
    walk = np.minimum(t[:, None], t[None]) - t[0]
    span = max(float(np.ptp(t)), 1e-9)

    def parts(log: Floats) -> tuple[Any, Floats, Floats, float]:
        """Noise and walk [shares of the spread] -> factor, (AᵀV⁻¹A)⁻¹, coefficients, −log L."""
        scatter, rate = size * np.exp(np.clip(log, -12.0, 4.0))
        V = np.diag(std**2 + scatter**2) + walk * rate**2 / span
        factor = cho_factor(V, lower=True)
        information = A.T @ cho_solve(factor, A)
        fitted = np.linalg.solve(information, A.T @ cho_solve(factor, series.value))
        left = series.value - A @ fitted
        determinant = 2.0 * np.sum(np.log(np.diag(factor[0]))) + np.linalg.slogdet(information)[1]
        return factor, information, fitted, 0.5 * (determinant + left @ cho_solve(factor, left))

    starts = [np.array([0.0, -4.0]), np.array([-2.0, 0.0])]
    fits = [minimize(lambda z: parts(z)[3], z, method="Nelder-Mead") for z in starts]
    best = min(fits, key=lambda fit: float(fit.fun)).x
    factor, information, fitted, _ = parts(best)
    scatter, rate = size * np.exp(np.clip(best, -12.0, 4.0))
    K = walk * rate**2 / span
    gain = cho_solve(factor, K).T
    mean = A @ fitted + gain @ (series.value - A @ fitted)
    free = A - gain @ A  # how the mean follows what is not known of the coefficients
    variance = np.diag(K - gain @ K) + np.diag(free @ np.linalg.solve(information, free.T))
    half = NORMAL_95 * np.sqrt(np.maximum(variance, 0.0))
    return Course(mean, mean - half, mean + half, float(scatter), float(rate / np.sqrt(span)))
