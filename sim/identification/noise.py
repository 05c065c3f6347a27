"""How the motion's errors hang together in time: a first-order process per channel.

    ε_k = ρ ε_{k−1} + √(1 − ρ²) σ w_k        whitened:  (ε_k − ρ ε_{k−1}) / (σ √(1 − ρ²))

Errors of receivers, compasses and smoothers wander. Taken for white they pull damping aside:
whoever estimates a start state from few correlated rows believes too much of it. σ and ρ are
those that make the residuals most likely once the start states are taken out (restricted maximum
likelihood: Patterson and Thompson, Biometrika 58, 1971). What commands add whose moment is known
to a message interval only (`sim.identification.runs`) is told apart by the same likelihood.
"""

from typing import NamedTuple

import numpy as np

from sim.state import Floats

TIMES = (0.1, 0.25, 0.5, 0.8, 1.2, 1.8, 2.7, 4.0, 8.0)  # s, that errors may be correlated over
JOLTS = (0.0, 0.15, 0.3, 0.5, 0.7, 1.0, 1.5, 2.5)
ENOUGH = 1500  # rows that noise is told by
SHORT = 5  # rows of a run
CLIP = 3.0  # standard deviations: outliers count no more in σ
MIN_SIGMA = np.array([1e-5, 1e-5, 1e-6])  # m/s, m/s, rad/s: even of simulated, exact motion


class Noise(NamedTuple):
    """σ (3,) of u, v, r [m/s, m/s, rad/s] and ρ (3,) from row to row.

    jolt  standard deviation of the moments of commands, in multiples of what messages leave open
    """

    sigma: Floats
    rho: Floats
    command_timing: float = 0.0

    def with_channel(self, i: int, sigma: float, rho: float) -> "Noise":
        """The same with another σ and ρ of channel i."""
        chosen = np.arange(3) == i
        sigmas, rhos = np.where(chosen, sigma, self.sigma), np.where(chosen, rho, self.rho)
        return self._replace(sigma=sigmas, rho=rhos)


class RunErrors(NamedTuple):
    """Errors (S, n, 3), ∂ reported / ∂ start (S, n, 3, 3), rows that count (S, n) as 0 and 1.

    jolts  (S, 3n, 3n) covariance that the commands' moments add (`sim.identification.runs`)
    """

    error: Floats
    phi: Floats
    within: Floats
    timing_covariance: Floats | None = None


def whitened(error: Floats, noise: Noise) -> Floats:
    """Rows (..., n, 3) one after another -> rows of unit variance, independent."""
    unit = error / noise.sigma
    out = unit.copy()
    out[..., 1:, :] -= noise.rho * unit[..., :-1, :]
    out[..., 1:, :] /= np.sqrt(1.0 - noise.rho**2)
    return out


def timing_whitener(e: RunErrors, noise: Noise) -> tuple[Floats | None, float]:
    """What makes whitened rows independent in spite of jolts (S, cn, cn), and log det of it.

    Jolts may be those of all channels (c = 3), or of the last one alone.
    """
    if e.timing_covariance is None or noise.command_timing == 0.0:
        return None, 0.0
    S, n = e.within.shape
    c = e.timing_covariance.shape[1] // n
    last = Noise(noise.sigma[-c:], noise.rho[-c:])
    U = noise.command_timing**2 * e.timing_covariance
    for _ in range(2):  # from the left, and from the right
        rows = np.moveaxis(U.reshape(S, n, c, c * n), -1, 0)
        white = whitened(rows, last) * e.within[..., None]
        U = np.moveaxis(white, 0, 1).reshape(S, c * n, c * n)
    L = np.linalg.cholesky(U + np.eye(c * n))
    size = np.log(np.einsum("sii->si", L)).sum()
    return np.linalg.inv(L), -float(size)


def apply_whitener(rows: Floats, mix: Floats | None) -> Floats:
    """Whitened rows (..., S, n, 3), mixed (S, cn, cn) in all or the last of their channels."""
    if mix is None:
        return rows
    c = mix.shape[1] // rows.shape[-2]
    part = rows[..., -c:]
    flat = part.reshape(*part.shape[:-2], -1)
    told = np.einsum("sij,...sj->...si", mix, flat, optimize=True).reshape(part.shape)
    return np.concatenate([rows[..., :-c], told], axis=-1)


def project_out_starts(e: RunErrors, noise: Noise) -> tuple[Floats, Floats, Floats]:
    """Whitened residuals (S, n, 3) without what a start explains, the basis (S, n, 3, 3) of that,

    and the correction (S, 3) of the start [m/s, m/s, rad/s].
    """
    mix, _ = timing_whitener(e, noise)
    w = apply_whitener(whitened(e.error, noise) * e.within[..., None], mix)
    A = _of_starts(e, noise, mix)
    S, n = e.within.shape
    Q, R = np.linalg.qr(A.reshape(S, 3 * n, 3))
    along = np.einsum("smk,sm->sk", Q, w.reshape(S, 3 * n))
    basis = Q.reshape(S, n, 3, 3)
    correction = np.linalg.solve(R, along[..., None])[..., 0]
    return w - np.einsum("sncl,sl->snc", basis, along), basis, correction


def _of_starts(e: RunErrors, noise: Noise, mix: Floats | None) -> Floats:
    """What whitened residuals owe to the starts: (S, n, 3, 3)."""
    white = whitened(np.moveaxis(e.phi, -1, 0), noise) * e.within[..., None]
    return np.moveaxis(apply_whitener(white, mix), 0, -1)


def estimate_noise(e: RunErrors, dt: float, before: Noise) -> Noise:
    """The most likely noise: channel by channel, the others at what they were, and the jolts."""
    e, noise = _some(e), before
    rhos = np.exp(-dt / np.array(TIMES))
    for i in range(2):
        found = [
            _fitted(e._replace(timing_covariance=None), noise, i, float(rho))
            for rho in _near(rhos, noise.rho[i], e)
        ]
        noise = min(found, key=lambda f: f[0])[1]
    found = [
        _fitted(e, noise._replace(command_timing=float(jolt)), 2, float(rho))
        for jolt in (
            [0.0]
            if e.timing_covariance is None
            else _near(np.array(JOLTS), noise.command_timing, e)
        )
        for rho in _near(rhos, noise.rho[2], e)
    ]
    return min(found, key=lambda f: f[0])[1]


def _some(e: RunErrors) -> RunErrors:
    """Every so many of the runs, and jolts of the yaw rate alone: enough to tell noise by."""
    step = max(int(e.within.sum()) // ENOUGH, 1)
    jolts = None if e.timing_covariance is None else e.timing_covariance[::step, 2::3, 2::3]
    return RunErrors(e.error[::step], e.phi[::step], e.within[::step], jolts)


def _near(grid: Floats, at: float, e: RunErrors) -> Floats:
    """Points of a grid to try: all while runs are short, then the nearest and its neighbours."""
    if e.within.shape[1] <= SHORT:
        return grid
    i = int(np.argmin(np.abs(grid - at)))
    return grid[max(i - 1, 0) : i + 2]


def _fitted(e: RunErrors, noise: Noise, i: int, rho: float) -> tuple[float, Noise]:
    """−2 log restricted likelihood and noise, with channel i correlated so and its σ fitted."""
    for _ in range(2):
        noise = noise.with_channel(i, noise.sigma[i], rho)
        left, basis, _ = project_out_starts(e, noise)
        freedom = max(float(e.within.sum() - np.sum(basis[:, :, i] ** 2)), 1.0)
        typical = np.sqrt(np.median(left[..., i][e.within > 0] ** 2) / 0.455)  # of χ²
        squares = np.sum(np.clip(left[..., i], -CLIP * typical, CLIP * typical) ** 2)
        size = max(float(noise.sigma[i] * np.sqrt(squares / freedom)), float(MIN_SIGMA[i]))
        noise = noise.with_channel(i, size, rho)
    return _cost(e, noise), noise


def _cost(e: RunErrors, noise: Noise) -> float:
    """−2 log of the restricted likelihood, but for a constant."""
    left, _, _ = project_out_starts(e, noise)
    mix, size = timing_whitener(e, noise)
    rows, steps = e.within.sum(), e.within[:, 1:].sum()
    spread = 2.0 * rows * np.log(noise.sigma).sum() + steps * np.log(1.0 - noise.rho**2).sum()
    spread -= 2.0 * size
    A = _of_starts(e, noise, mix)
    G = np.einsum("snck,sncl->skl", A, A)
    return float(spread + np.linalg.slogdet(G)[1].sum() + np.sum(left**2))
