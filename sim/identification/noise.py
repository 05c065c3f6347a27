"""How the motion's errors hang together in time: a first-order process per channel.

    ε_k = ρ ε_{k−1} + √(1 − ρ²) σ w_k        whitened:  (ε_k − ρ ε_{k−1}) / (σ √(1 − ρ²))

Errors of receivers, compasses and smoothers wander. Taken for white they pull damping aside:
whoever estimates a start state from few correlated rows believes too much of it. σ and ρ are
those that make the residuals most likely once the start states are taken out (restricted maximum
likelihood: Patterson and Thompson, Biometrika 58, 1971).
"""

from typing import NamedTuple

import numpy as np

from sim.state import Floats

TIMES = (0.1, 0.25, 0.5, 0.8, 1.2, 1.8, 2.7, 4.0, 8.0)  # s, that errors may be correlated over
CLIP = 3.0  # standard deviations: outliers count no more in σ
SMALLEST = np.array([1e-5, 1e-5, 1e-6])  # m/s, m/s, rad/s: even of simulated, exact motion


class Noise(NamedTuple):
    """σ (3,) of u, v, r [m/s, m/s, rad/s] and ρ (3,) from row to row."""

    sigma: Floats
    rho: Floats

    def with_channel(self, i: int, sigma: float, rho: float) -> "Noise":
        """The same with another σ and ρ of channel i."""
        chosen = np.arange(3) == i
        return Noise(np.where(chosen, sigma, self.sigma), np.where(chosen, rho, self.rho))


class Errors(NamedTuple):
    """Errors (S, n, 3), ∂ reported / ∂ start (S, n, 3, 3), rows that count (S, n) as 0 and 1."""

    error: Floats
    phi: Floats
    within: Floats


def whitened(error: Floats, noise: Noise) -> Floats:
    """Rows (..., n, 3) one after another -> rows of unit variance, independent."""
    unit = error / noise.sigma
    out = unit.copy()
    out[..., 1:, :] -= noise.rho * unit[..., :-1, :]
    out[..., 1:, :] /= np.sqrt(1.0 - noise.rho**2)
    return out


def starts_out(e: Errors, noise: Noise) -> tuple[Floats, Floats, Floats]:
    """Whitened residuals (S, n, 3) without what a start explains, the basis (S, n, 3, 3) of that,

    and the correction (S, 3) of the start [m/s, m/s, rad/s].
    """
    count = e.within[..., None]
    w = whitened(e.error, noise) * count
    A = np.moveaxis(whitened(np.moveaxis(e.phi, -1, 0), noise) * count, 0, -1)
    S, n = e.within.shape
    Q, R = np.linalg.qr(A.reshape(S, 3 * n, 3))
    along = np.einsum("smk,sm->sk", Q, w.reshape(S, 3 * n))
    basis = Q.reshape(S, n, 3, 3)
    correction = np.linalg.solve(R, along[..., None])[..., 0]
    return w - np.einsum("sncl,sl->snc", basis, along), basis, correction


def estimated(e: Errors, dt: float, before: Noise) -> Noise:
    """The most likely noise, channel by channel, the others at what they were."""
    noise = before
    for i in range(3):
        found = [_fitted(e, noise, i, float(np.exp(-dt / tau))) for tau in TIMES]
        noise = min(found, key=lambda f: f[0])[1]
    return noise


def _fitted(e: Errors, noise: Noise, i: int, rho: float) -> tuple[float, Noise]:
    """−2 log restricted likelihood and noise, with channel i correlated so and its σ fitted."""
    for _ in range(2):
        noise = noise.with_channel(i, noise.sigma[i], rho)
        left, basis, _ = starts_out(e, noise)
        freedom = max(float(e.within.sum() - np.sum(basis[:, :, i] ** 2)), 1.0)
        typical = np.sqrt(np.median(left[..., i][e.within > 0] ** 2) / 0.455)  # of χ²
        squares = np.sum(np.clip(left[..., i], -CLIP * typical, CLIP * typical) ** 2)
        size = max(float(noise.sigma[i] * np.sqrt(squares / freedom)), float(SMALLEST[i]))
        noise = noise.with_channel(i, size, rho)
    return _cost(e, noise), noise


def _cost(e: Errors, noise: Noise) -> float:
    """−2 log of the restricted likelihood, but for a constant."""
    left, _, _ = starts_out(e, noise)
    rows, steps = e.within.sum(), e.within[:, 1:].sum()
    spread = 2.0 * rows * np.log(noise.sigma).sum() + steps * np.log(1.0 - noise.rho**2).sum()
    count = e.within[..., None]
    A = np.moveaxis(whitened(np.moveaxis(e.phi, -1, 0), noise) * count, 0, -1)
    G = np.einsum("snck,sncl->skl", A, A)
    return float(spread + np.linalg.slogdet(G)[1].sum() + np.sum(left**2))
