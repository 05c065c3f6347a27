"""How a number of a boat went over its recordings, and whether it has changed at all.

    y_i = m(t_i) + w(t_i) + e_i,    e_i ~ N(0, s_i² + τ²),    w a random walk, Var = q · days

y_i is what recording i says, s_i its own standard deviation, τ the scatter from voyage to voyage
that no interval tells (water, load, wind). m is a constant, or a change that is believed:

    step   m = a + b [t > t_k]               weed, a propeller changed, a blow
    drift  m = a + b max(0, t − t_k)         wear, growth on the hull

A change is searched for at every t_k with `EDGE` recordings on either side. The statistic is the
mean of the likelihood ratios of all of them; its p-value comes from the same statistic of the
recordings in random order (a permutation test: Good, Permutation, Parametric and Bootstrap Tests of
Hypotheses, 3rd ed. 2005), so it holds whatever the distribution of the scatter and however many
moments were tried; a value far from the others counts as `FAR`, so no single bad day decides. τ is
that of DerSimonian and Laird (Controlled Clinical Trials 7, 1986). The course is the Gaussian
posterior of m + w, which is what a Kalman smoother computes.
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
ALARM = 0.05  # share of fleets that may raise any false alarm
ORDERS = (500, 20_000)  # random orders: of every number, and of those that may be significant
PROMISING = 0.1  # p-value below which the second is run
MOST_MOMENTS = 100  # at which a change is tried; among more recordings, evenly spread
FAR = 4.0  # standard deviations, by the median: one bad day counts no more in the test
NORMAL_95 = 1.96
NORMAL_MAD = 1.4826  # standard deviations in a median absolute deviation


@dataclass(frozen=True)
class Series:
    """A number of one boat by recording: time (n,) [days, ascending], value and std (n,)."""

    time: Floats
    value: Floats
    std: Floats


class Change(NamedTuple):
    """A change: step or drift, the moment [days] and its 95 % range, the level before, now.

    share  change relative to the level before, with its 95 % interval; a loss is negative
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
    """One form of change: its kind, its moment [days], its regressor (n,)."""

    kind: str
    moment: float
    form: Floats


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
    for k in np.unique(np.linspace(EDGE, last, min(MOST_MOMENTS, last - EDGE + 1)).astype(int)):
        if time[k] > time[k - 1]:
            moment = 0.5 * float(time[k - 1] + time[k])
            out.append(Candidate("step", moment, (time > moment).astype(float)))
    for k in np.unique(np.linspace(0, last - 1, min(MOST_MOMENTS, last)).astype(int)):
        form = np.maximum(time - time[k], 0.0)
        if form[-1] > 0.0:
            out.append(Candidate("drift", float(time[k]), form))
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
    weight = _weights(tried)
    explained = _explained(white[None], constant, forms)[0]
    support = _support(explained[None], weight, len(white))[0]
    random, p = np.random.default_rng(seed), 1.0
    for orders in ORDERS:
        if p > PROMISING and orders != ORDERS[0]:
            break
        shuffled = random.permuted(np.tile(white, (orders, 1)), axis=1)
        others = _support(_explained(shuffled, constant, forms), weight, len(white))
        p = float((1 + np.sum(others >= support - 1e-9)) / (orders + 1))
    return Evidence(_change(series, tried, explained, deviation), p)


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


def _explained(white: Floats, constant: Floats, forms: Floats) -> Floats:
    """Whitened values (B, n) -> share of their squares that each form explains (B, K)."""
    squares = np.sum(white**2, axis=1) - (white @ constant) ** 2
    return np.asarray((white @ forms) ** 2 / np.maximum(squares, 1e-300)[:, None])


def _weights(tried: Sequence[Candidate]) -> Floats:
    """Share (K,) of each candidate beforehand: a third steps, a third drifts, a third the drift
    over all recordings."""
    first = next((i for i, c in enumerate(tried) if c.kind == "drift"), None)
    group = np.array(["all" if i == first else c.kind for i, c in enumerate(tried)])
    kinds, number, count = np.unique(group, return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[number] / len(kinds))


def _support(explained: Floats, weight: Floats, n: int) -> Floats:
    """Shares explained (B, K) -> log of the mean likelihood ratio of all candidates (B,)."""
    nats = -0.5 * n * np.log1p(-np.minimum(explained, 1.0 - 1e-12))
    return np.asarray(logsumexp(nats, axis=1, b=weight))


def _change(
    series: Series, tried: Sequence[Candidate], explained: Floats, deviation: Floats
) -> Change:
    """The best candidate; its intervals are over all of them, by their likelihood ratios."""
    n, weight = len(series.time), _weights(tried)
    ratio = weight * (1.0 - np.minimum(explained, 1.0 - 1e-12)) ** (-0.5 * n)
    posterior = ratio / ratio.sum()
    fits = [_fitted(series, candidate, deviation) for candidate in tried]
    share, std = np.array([fit[2] for fit in fits]), np.array([fit[3] for fit in fits])
    chosen = int(np.argmax(explained))
    mean = float(posterior @ share)
    spread = float(np.sqrt(posterior @ (std**2 + (share - mean) ** 2)))
    half = float(stdtrit(n - 2, 0.975)) * spread
    kind = tried[chosen].kind
    alike = sorted((c.moment, p) for c, p in zip(tried, posterior, strict=True) if c.kind == kind)
    moments, mass = np.array(alike).T
    below = np.cumsum(mass) / mass.sum()
    low, high = moments[np.searchsorted(below, [0.025, 0.975]).clip(max=len(below) - 1)]
    before, now = fits[chosen][:2]
    return Change(
        kind, tried[chosen].moment, (float(low), float(high)), before, now,
        float(share[chosen]), (mean - half, mean + half),
    )  # fmt: skip


def _fitted(
    series: Series, candidate: Candidate, deviation: Floats
) -> tuple[float, float, float, float]:
    """Weighted least squares -> level before, now, share of the change and its deviation."""
    A = np.column_stack([np.ones(len(series.time)), candidate.form]) / deviation[:, None]
    white = series.value / deviation
    fitted, *_ = np.linalg.lstsq(A, white, rcond=None)
    left = white - A @ fitted
    covariance = np.linalg.inv(A.T @ A) * float(left @ left) / (len(white) - 2)
    before, change = float(fitted[0]), float(fitted[1] * candidate.form[-1])
    size = before or 1e-300
    gradient = np.array([-change / size, candidate.form[-1]]) / size
    return before, before + change, change / size, float(np.sqrt(gradient @ covariance @ gradient))


def believed(p_values: Sequence[float]) -> NDArray[np.bool_]:
    """Which changes of a whole fleet are believed: (n,) p-values -> (n,).

    Holm (Scandinavian Journal of Statistics 6, 1979): a fleet of any size raises any false alarm in
    at most `ALARM` of all cases, whatever else wears in it.
    """
    n, out = len(p_values), np.zeros(len(p_values), np.bool_)
    for rank, i in enumerate(np.argsort(p_values, kind="stable")):
        if p_values[i] > ALARM / (n - rank):
            break
        out[i] = True
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
