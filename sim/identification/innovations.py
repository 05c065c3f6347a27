"""Innovations of short runs that a Kalman filter ties together: the predictor form of a fit.

A free run of a hull that is unstable on course leaves the track, whatever its parameters; runs that
are short enough to stay on it spend three numbers each on their starts. Here a run starts from the
measured track, and what is unknown of its start is carried over from the run before:

    e_j = Φ_j δ_k + ε_j,   ε first order with σ, ρ      errors of the means of run k
    δ_{k+1} = A_k δ_k − g_k + w_k + c_k                 true start − measured start of the next run
    g_k = measured start of run k+1 − end of run k,     Φ, A: sensitivity to the start of run k

c_k is what the unknown moments of commands add; they add to the e_j too, and the filter knows how
the two are correlated. The innovations of the filter over (δ, ε) are the whitened residuals: of a
stable predictor, on whatever hull. Gains depend on the noise and the sensitivities alone, so the
residuals are linear in the errors. Source: Ljung, System Identification, 2nd ed. 1999, §7.2;
Forssell and Ljung, IEEE Trans. Automatic Control 45, 2000 (unstable systems).

**Colour.** A sea swings with a period, as no first-order noise does. Where the innovations v of a
channel are not white in time an autoregression of them makes them so, with a and s as they have
them (Yule and Walker):

    w_k = ( v_k − Σ_l a_l v_{k−l} ) / s
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from sim.identification.noise import CHI2_MEDIAN, Noise, RunErrors
from sim.identification.tied_filter import filter_errors, riccati
from sim.state import Floats, Ints

# Chosen, not measured:
# What no model knows of a velocity [m/s, m/s, rad/s] after one second: gusts, small waves. As of a
# trial whose noise is what its covariance says; it grows with what the noise is found to be.
PROCESS_STD = np.array([0.013, 0.013, 0.005])
START_SIGMAS = 3.0  # of the measured velocity, that the first start of a chain may be off
CORRELATION_TIMES_S = (0.3, 0.6, 1.2)  # of the errors of the measured track, that are tried
COMMAND_TIMINGS = (0.0, 0.5, 1.0)  # of command timing, in multiples of a message interval
NOISE_ROUNDS = 3
MIN_NOISE_SHARE = 0.2  # of what the covariance says: the noise is not found smaller
MAX_TRANSITION = 50.0  # bound of ∂ velocity / ∂ start of a run
CLIP_STD = 5.0  # standard deviations: a larger innovation counts as this in the likelihood
COLOUR_S = 2.4  # of the past that colour is told by; twice as much tells no more
COLOUR_RIDGE = 1e-6  # of the variance, so that any innovations have a colour
SCALE_ROUNDS = 5  # of the standard deviation of clipped values


class Colour(NamedTuple):
    """Of innovations of u, v, r: a_1 … a_p (p, 3), and s (3,)."""

    a: Floats
    scale: Floats


@dataclass(frozen=True)
class Chain:
    """The filter over S runs of at most n means (m = 3 n rows), ready to be applied.

    follows  (S,) whether the next run begins where this one ends, as 0 and 1
    count    (S,) means of each run
    noise    whitens the errors of a run in time
    state    (S, m, 6) of (δ, ε before the run) in these rows; moved (S, 6, 3): δ to the next run's
    gain     (S, 6, m) of whitened innovations in that of the next run
    root     (S, m, m) Cholesky factor of the innovations' covariance
    spread   (3,) of the innovations of u, v, r, robust: 1 where the noise is right
    deviance −2 log likelihood of the errors that it was made from
    colour   of the innovations; None where they are white
    """

    follows: Floats
    count: Ints
    noise: Noise
    state: Floats
    moved: Floats
    gain: Floats
    root: Floats
    spread: Floats
    deviance: float
    colour: Colour | None = None

    @classmethod
    def of(
        cls, errors: RunErrors, noise: Noise, follows: Floats, process: Floats, mean_s: float
    ) -> "Chain":
        """From errors (S, n + 1, 3) with the gap last, and their sensitivities (S, n + 1, 3, 3).

        process  (3,) standard deviation of w after one second
        """
        recursion = _Recursion.of(errors, follows)
        spread, deviance = recursion.run(noise, process, mean_s)
        return cls(
            follows, recursion.count, noise, recursion.state, recursion.moved, recursion.gain,
            recursion.root, spread, deviance,
        )  # fmt: skip

    @cached_property
    def _unit(self) -> Floats:
        """(S, m, m) whitens the innovations."""
        return np.asarray(np.linalg.inv(self.root), np.float64)

    def whitened(self, error: Floats) -> Floats:
        """Errors and gaps (K, S, n + 1, 3) -> whitened innovations (K, S, n, 3)."""
        K, S, n = error.shape[0], error.shape[1], error.shape[2] - 1
        out = np.zeros((K, S, 3 * n))
        filter_errors(
            np.ascontiguousarray(error).reshape(K, S, 3 * n + 3), self.follows, self.count,
            _fresh(self.noise), self.noise.rho, self.state, self.moved, self.gain, self._unit, out,
        )  # fmt: skip
        white = out.reshape(K, S, n, 3)
        if self.colour is not None:
            white[:, self._counted] = self._without_colour(white[:, self._counted], self.colour)
        return white

    def coloured(self, innovations: Floats, mean_s: float) -> "Chain":
        """The filter that makes these innovations (N, 3) of all means, so far without colour, white
        in time.
        """
        return replace(self, colour=self._colour_of(innovations, mean_s))

    def won_by_colour(self, innovations: Floats, mean_s: float) -> float:
        """How −2 log likelihood changes where innovations (N, 3) get their own colour."""
        colour = self._colour_of(innovations, mean_s)
        left = self._without_colour(innovations[None], colour)[0]
        before, after = (np.sum(_clipped(w, 1.0) ** 2) for w in (innovations, left))
        return float(after - before + 2.0 * len(left) * np.log(colour.scale).sum())

    def _colour_of(self, innovations: Floats, mean_s: float) -> Colour:
        rows = _clipped(innovations, 1.0)
        lags = range(min(round(COLOUR_S / mean_s), len(rows) - 1) + 1)
        r = np.array([(rows[k:] * rows[: len(rows) - k] * self._tied(k)).sum(axis=0) for k in lags])
        r[0] = np.maximum(r[0] * (1.0 + COLOUR_RIDGE), 1e-12)
        a = np.stack([solve_toeplitz(r[:-1, c], r[1:, c]) for c in range(3)], axis=1)
        unscaled = self._without_colour(innovations[None], Colour(a, np.ones(3)))[0]
        return Colour(a, _clipped_std(unscaled))

    def _without_colour(self, rows: Floats, colour: Colour) -> Floats:
        """Innovations (K, N, 3) without what those before tell of them, in standard deviations."""
        out = rows.copy()
        for k, a in enumerate(colour.a, start=1):
            out[:, k:] -= a * rows[:, : rows.shape[1] - k] * self._tied(k)
        return out / colour.scale

    @cached_property
    def _counted(self) -> NDArray[np.bool_]:
        """Which means of the runs there are: (S, n)."""
        return np.arange(self.state.shape[1] // 3) < self.count[:, None]

    @cached_property
    def _stretch(self) -> Floats:
        """Number of the stretch of tied runs that a mean is of: (N,)."""
        return np.repeat(np.cumsum(np.append(0.0, self.follows[:-1] == 0.0)), self.count)

    def _tied(self, lag: int) -> NDArray[np.bool_]:
        """Whether a mean and that `lag` before it are of runs that are tied: (N − lag, 1)."""
        stretch = self._stretch
        return np.asarray(stretch[lag:] == stretch[: len(stretch) - lag])[:, None]

    def subset(self, which: Ints, follows: Floats) -> "Chain":
        """The chain over some of its runs."""
        return replace(
            self, follows=follows, count=self.count[which], state=self.state[which],
            moved=self.moved[which], gain=self.gain[which], root=self.root[which],
        )  # fmt: skip


@dataclass(frozen=True)
class _Recursion:
    """Errors as the filter's recursion reads them, whatever the noise, and what it fills.

    error (S, m + 3), phi (S, n + 1, 3, 3), timing (S, m + 3, m + 3) or empty; of the run after run
    it leaves `state`, `gain` and `root` (see `Chain`), which the next one overwrites.
    """

    error: Floats
    phi: Floats
    within: Floats
    count: Ints
    follows: Floats
    moved: Floats
    timing: Floats
    state: Floats
    gain: Floats
    root: Floats

    @classmethod
    def of(cls, errors: RunErrors, follows: Floats) -> "_Recursion":
        """From errors (S, n + 1, 3) with the gap last, and their sensitivities (S, n + 1, 3, 3)."""
        S, n = errors.within.shape
        count = errors.within.sum(axis=1).astype(np.int64)
        phi = np.nan_to_num(np.clip(errors.phi, -MAX_TRANSITION, MAX_TRANSITION))
        moved = np.concatenate([phi[:, n], -phi[np.arange(S), np.maximum(count - 1, 0)]], axis=1)
        timing = np.zeros((0, 0, 0))
        if errors.timing_covariance is not None:
            timing = np.nan_to_num(errors.timing_covariance)
        root = np.broadcast_to(np.eye(3 * n), (S, 3 * n, 3 * n)).copy()
        return cls(
            np.ascontiguousarray(errors.error).reshape(S, 3 * n + 3), phi, errors.within, count,
            follows, moved, timing, np.zeros((S, 3 * n, 6)), np.zeros((S, 6, 3 * n)), root,
        )  # fmt: skip

    def run(self, noise: Noise, process: Floats, mean_s: float) -> tuple[Floats, float]:
        """Spread (3,) and deviance of the innovations under a noise (see `Chain.of`)."""
        S, n = self.within.shape
        fresh, white = _fresh(noise), np.zeros((S, 3 * n))
        start = np.diag(np.concatenate([(START_SIGMAS * noise.sigma) ** 2, noise.sigma**2]))
        size = riccati(
            self.error, self.phi, self.count, self.follows, self.moved, fresh, noise.rho,
            process**2 * mean_s, self.timing[: None if noise.command_timing > 0.0 else 0],
            noise.command_timing**2, start, self.state, self.gain, self.root, white,
        )  # fmt: skip
        counted = white.reshape(S, n, 3)[self.within > 0]
        spread = np.ones(3)
        if len(counted):
            spread = np.sqrt(np.median(counted**2, axis=0) / CHI2_MEDIAN)
        determinant = size + 2.0 * float(self.count.sum()) * np.log(fresh).sum()
        deviance = float(np.sum(_clipped(counted, 1.0) ** 2) + determinant)
        return np.maximum(spread, 1e-3), deviance


def _clipped_std(rows: Floats) -> Floats:
    """Standard deviation (3,) of rows (N, 3), none beyond `CLIP_STD` of it."""
    if not len(rows):
        return np.ones(3)
    std = np.maximum(np.sqrt(np.median(rows**2, axis=0) / CHI2_MEDIAN), 1e-6)
    for _ in range(SCALE_ROUNDS):
        std = np.sqrt(np.mean(_clipped(rows, std) ** 2, axis=0))
    return np.asarray(np.maximum(std, 1e-6))


def _clipped(rows: Floats, std: Floats | float) -> Floats:
    return np.asarray(np.clip(rows, -CLIP_STD * std, CLIP_STD * std), np.float64)


def _fresh(noise: Noise) -> Floats:
    """Standard deviation of what is new in ε from mean to mean: (3,)."""
    return np.asarray(noise.sigma * np.sqrt(1.0 - noise.rho**2))


def chain_of(
    errors: RunErrors, noise: Noise, follows: Floats, stated: Floats, mean_s: float
) -> Chain:
    """The filter under a noise; what no model knows is as large, beside it, as `PROCESS_STD`."""
    return Chain.of(errors, noise, follows, _process_std(noise, stated), mean_s)


def _process_std(noise: Noise, stated: Floats) -> Floats:
    return np.asarray(PROCESS_STD * noise.sigma / stated)


def estimate_chain_noise(
    errors: RunErrors, follows: Floats, stated: Floats, mean_s: float,
    timings: Sequence[float] = COMMAND_TIMINGS,
) -> tuple[Noise, float]:  # fmt: skip
    """The noise under which the innovations are most likely, of one spread in each channel, and
    −2 log of that likelihood.

    timings  multiples of a message interval that are tried for command timing
    """
    best: tuple[Noise, float] | None = None
    recursion = _Recursion.of(errors, follows)
    timings = timings if errors.timing_covariance is not None else (0.0,)
    for tau, timing in product(CORRELATION_TIMES_S, timings):
        noise = Noise(stated, np.full(3, np.exp(-mean_s / tau)), timing)
        for _ in range(NOISE_ROUNDS):
            spread, _ = recursion.run(noise, _process_std(noise, stated), mean_s)
            sigma = np.maximum(noise.sigma * spread, MIN_NOISE_SHARE * stated)
            noise = noise._replace(sigma=sigma)
        _, deviance = recursion.run(noise, _process_std(noise, stated), mean_s)
        if best is None or deviance < best[1]:
            best = noise, deviance
    assert best is not None
    return best


def follows_of(first: Ints, size: Ints) -> Floats:
    """Whether each run (S,) is followed by one that begins where it ends, as 0 and 1."""
    out = np.zeros(len(first))
    out[:-1] = first[1:] == first[:-1] + size[:-1]
    return out
