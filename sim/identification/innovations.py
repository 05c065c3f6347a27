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
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numba
import numpy as np

from sim.identification.noise import CHI2_MEDIAN, MIN_SIGMA, Noise, RunErrors
from sim.state import Floats, Ints
from sim.trial import Trial

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


def track_std(trial: Trial) -> Floats:
    """Standard deviation of the measured u, v, r that the trial states: (3,), median in time."""
    variance = np.einsum("tii->ti", trial.covariance)[trial.usable, 3:6]
    stated = np.sqrt(np.median(variance, axis=0)) if len(variance) else MIN_SIGMA
    return np.asarray(np.maximum(np.nan_to_num(stated), MIN_SIGMA))


@dataclass(frozen=True)
class Chain:
    """The filter over S runs of at most n means (m = 3 n rows), ready to be applied.

    follows  (S,) whether the next run begins where this one ends, as 0 and 1
    last     (S,) the last mean of each run
    rows     (S, m, m) whitening of the errors of a run in time
    state    (S, m, 6) of (δ, ε before the run) in these rows; moved (S, 6, 3): δ to the next run's
    gain     (S, 6, m) of whitened innovations in that of the next run, unit (S, m, m) whitens them
    spread   (3,) of the innovations of u, v, r, robust: 1 where the noise is right
    deviance −2 log likelihood of the errors that it was made from
    """

    follows: Floats
    last: Ints
    rows: Floats
    state: Floats
    moved: Floats
    gain: Floats
    unit: Floats
    spread: Floats
    deviance: float

    @classmethod
    def of(
        cls, errors: RunErrors, noise: Noise, follows: Floats, process: Floats, mean_s: float
    ) -> "Chain":
        """From errors (S, n + 1, 3) with the gap last, and their sensitivities (S, n + 1, 3, 3).

        process  (3,) standard deviation of w after one second
        """
        S, n = errors.within.shape
        count = errors.within.sum(axis=1).astype(np.int64)
        last = np.maximum(count - 1, 0)
        phi = np.nan_to_num(np.clip(errors.phi, -MAX_TRANSITION, MAX_TRANSITION))
        rows, state = _rows_and_state(phi[:, :n], errors.within, noise)
        moved = np.concatenate([phi[:, n], -phi[np.arange(S), last]], axis=1)
        own = np.broadcast_to(np.eye(3 * n), (S, 3 * n, 3 * n)).copy()
        drive, both = np.zeros((S, 6, 6)), np.zeros((S, 6, 3 * n))
        drive[:, :3, :3] = np.diag(process**2) * (mean_s * count)[:, None, None]
        if errors.timing_covariance is not None and noise.command_timing > 0.0:
            timing = noise.command_timing**2 * np.nan_to_num(errors.timing_covariance)
            counted = np.repeat(errors.within, 3, axis=1)
            inside = timing[:, : 3 * n, : 3 * n] * counted[:, None] * counted[:, :, None]
            own += rows @ inside @ np.swapaxes(rows, 1, 2)
            added = _end_and_last(count, last, n)  # c, and what is no ε in the last error
            drive += added @ timing @ np.swapaxes(added, 1, 2)
            both = (added @ timing)[:, :, : 3 * n] * counted[:, None] @ np.swapaxes(rows, 1, 2)
        start = np.diag(np.concatenate([(START_SIGMAS * noise.sigma) ** 2, noise.sigma**2]))
        gain, unit, size = _gains(state, own, moved, follows, start, drive, both)
        chain = cls(follows, last, rows, state, moved, gain, unit, np.ones(3), 0.0)
        white = chain.whitened(errors.error[None])[0][errors.within > 0]
        spread = np.sqrt(np.median(white**2, axis=0) / CHI2_MEDIAN) if len(white) else np.ones(3)
        determinant = size - 2.0 * np.log(np.maximum(_diagonal(rows), 1e-300)).sum()
        deviance = float(np.sum(np.clip(white, -CLIP_STD, CLIP_STD) ** 2) + determinant)
        return replace(chain, spread=np.maximum(spread, 1e-3), deviance=deviance)

    def whitened(self, error: Floats) -> Floats:
        """Errors and gaps (K, S, n + 1, 3) -> whitened innovations (K, S, n, 3)."""
        K, S, n = error.shape[0], error.shape[1], error.shape[2] - 1
        out = np.zeros((K, S, 3 * n))
        _filter(
            np.ascontiguousarray(error).reshape(K, S, 3 * n + 3), self.follows, self.last,
            self.rows, self.state, self.moved, self.gain, self.unit, out,
        )  # fmt: skip
        return out.reshape(K, S, n, 3)

    def subset(self, which: Ints, follows: Floats) -> "Chain":
        """The chain over some of its runs."""
        return replace(
            self, follows=follows, last=self.last[which], rows=self.rows[which],
            state=self.state[which], moved=self.moved[which], gain=self.gain[which],
            unit=self.unit[which],
        )  # fmt: skip


def chain_of(
    errors: RunErrors, noise: Noise, follows: Floats, stated: Floats, mean_s: float
) -> Chain:
    """The filter under a noise; what no model knows is as large, beside it, as `PROCESS_STD`."""
    return Chain.of(errors, noise, follows, PROCESS_STD * noise.sigma / stated, mean_s)


def estimate_chain_noise(
    errors: RunErrors, follows: Floats, stated: Floats, mean_s: float,
    timings: Sequence[float] = COMMAND_TIMINGS,
) -> Noise:  # fmt: skip
    """The noise under which the innovations are most likely, of one spread in each channel.

    timings  multiples of a message interval that are tried for command timing
    """
    best: tuple[float, Noise] | None = None
    timings = timings if errors.timing_covariance is not None else (0.0,)
    for tau, timing in product(CORRELATION_TIMES_S, timings):
        noise = Noise(stated, np.full(3, np.exp(-mean_s / tau)), timing)
        for _ in range(NOISE_ROUNDS):
            spread = chain_of(errors, noise, follows, stated, mean_s).spread
            sigma = np.maximum(noise.sigma * spread, MIN_NOISE_SHARE * stated)
            noise = noise._replace(sigma=sigma)
        deviance = chain_of(errors, noise, follows, stated, mean_s).deviance
        if best is None or deviance < best[0]:
            best = deviance, noise
    assert best is not None
    return best[1]


def follows_of(first: Ints, size: Ints) -> Floats:
    """Whether each run (S,) is followed by one that begins where it ends, as 0 and 1."""
    out = np.zeros(len(first))
    out[:-1] = first[1:] == first[:-1] + size[:-1]
    return out


def _end_and_last(count: Ints, last: Ints, n: int) -> Floats:
    """Of n + 1 means of a run (S,): the one after its last, and less the last: (S, 6, 3 n + 3)."""
    out = np.zeros((len(count), 2, 3, n + 1, 3))
    for i in range(3):
        out[np.arange(len(count)), 0, i, count, i] = 1.0
        out[np.arange(len(count)), 1, i, last, i] = -1.0
    return out.reshape(len(count), 6, 3 * n + 3)


def _diagonal(matrices: Floats) -> Floats:
    return np.asarray(np.einsum("sii->si", matrices))


def _rows_and_state(phi: Floats, within: Floats, noise: Noise) -> tuple[Floats, Floats]:
    """Φ (S, n, 3, 3) -> whitening of a run's errors (S, m, m), (δ, ε) in these rows (S, m, 6)."""
    S, n = within.shape
    fresh = noise.sigma * np.sqrt(1.0 - noise.rho**2)
    one = np.zeros((n, 3, n, 3))
    for i in range(3):
        one[np.arange(n), i, np.arange(n), i] = 1.0 / fresh[i]
        one[np.arange(1, n), i, np.arange(n - 1), i] = -noise.rho[i] / fresh[i]
    counted = np.repeat(within, 3, axis=1)
    rows = np.broadcast_to(one.reshape(3 * n, 3 * n), (S, 3 * n, 3 * n)).copy()
    carried = np.zeros((n, 3, 3))
    carried[0] = np.diag(noise.rho / fresh)
    state = np.concatenate(
        [rows @ phi.reshape(S, 3 * n, 3), np.broadcast_to(carried.reshape(-1, 3), (S, 3 * n, 3))],
        axis=2,
    )
    outside = np.where(counted == 0.0)
    rows[outside], state[outside] = 0.0, 0.0
    rows[outside[0], outside[1], outside[1]] = 1.0
    return rows, np.ascontiguousarray(state)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gains(state, own, moved, follows, start, drive, both):  # type: ignore[no-untyped-def]
    """Riccati recursion -> gain (S, 6, m), unit (S, m, m), Σ log det of the innovations.

    drive (S, 6, 6): what is new in the next (δ, ε); both (S, 6, m): its covariance with the errors
    of the run.
    """
    S, m, _ = state.shape
    gain, unit = np.zeros((S, 6, m)), np.zeros((S, m, m))
    P, size = start.copy(), 0.0
    for k in range(S):
        G, F = state[k], moved[k]
        L = np.linalg.cholesky(G @ P @ G.T + own[k])
        W = np.linalg.inv(L)
        for i in range(m):
            size += 2.0 * np.log(L[i, i])
        unit[k] = W
        if follows[k] == 0.0:
            P = start.copy()
            continue
        cross = F @ np.ascontiguousarray((P @ G.T)[:3])
        cross += both[k]
        B = cross @ W.T
        gain[k] = B
        P = F @ np.ascontiguousarray(P[:3, :3]) @ F.T - B @ B.T
        P += drive[k]
        P = 0.5 * (P + P.T)
    return gain, unit, size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _filter(error, follows, last, rows, state, moved, gain, unit, out):  # type: ignore[no-untyped-def]
    """Errors (K, S, m + 3) with the gap last -> whitened innovations out (K, S, m)."""
    K, S, wide = error.shape
    m = wide - 3
    for q in range(K):
        x = np.zeros(6)
        for k in range(S):
            e = error[q, k]
            v = rows[k] @ e[:m] - state[k] @ x
            w = unit[k] @ v
            out[q, k] = w
            if follows[k] == 0.0:
                x[:] = 0.0
                continue
            x = moved[k] @ x[:3] + gain[k] @ w
            j = 3 * last[k]
            for i in range(3):
                x[i] -= e[m + i]
                x[3 + i] += e[j + i]
