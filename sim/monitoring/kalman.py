"""The step of all filters here: an extended Kalman filter that weighs outliers less.

    S = H P Hᵀ + R = L Lᵀ,     K = P Hᵀ S⁻¹,     x ← x + K m
    P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ          (Joseph's form)

Beyond `MAX_SQUARED_DISTANCE` of mᵀ S⁻¹ m, R counts as much larger as it takes. An S that is not
positive definite gives NaN. A boat under way takes eight such steps each second: compiled, in loops
(numba takes seconds to compile `@`), 1 µs each.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
§5.2 and §7.3.
"""

import numpy as np
from numpy.typing import NDArray

from sim.kernel.compiled import compiled
from sim.state import Floats

AXES = 3  # of what is measured: X, Y, N
MAX_SQUARED_DISTANCE = 16.0  # mᵀ S⁻¹ m over three axes: beyond this noise is not Gaussian; chosen


@compiled
def cholesky(spread: Floats, variance: Floats, L: Floats) -> None:
    """L with L Lᵀ = spread + diag(variance): (3, 3), (3,) -> L (3, 3), its lower half alone."""
    for i in range(AXES):
        for j in range(i + 1):
            rest = spread[i, j] + (variance[i] if i == j else 0.0)
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]


@compiled
def whiten(L: Floats, column: Floats) -> None:
    """column ← L⁻¹ column: (3, 3), (3,)."""
    for i in range(AXES):
        for j in range(i):
            column[i] -= L[i, j] * column[j]
        column[i] /= L[i, i]


@compiled
def unwhiten(L: Floats, column: Floats) -> None:
    """column ← L⁻ᵀ column: (3, 3), (3,)."""
    for i in range(AXES - 1, -1, -1):
        for j in range(i + 1, AXES):
            column[i] -= L[j, i] * column[j]
        column[i] /= L[i, i]


@compiled
def weighed(L: Floats, innovation: Floats) -> float:
    """mᵀ S⁻¹ m of an innovation m (3,) where S = L Lᵀ (3, 3)."""
    white, squared = innovation.copy(), 0.0
    whiten(L, white)
    for i in range(AXES):
        squared += white[i] ** 2
    return squared


@compiled
def kalman_step(
    state: tuple[Floats, Floats],
    walk: Floats,
    measured: tuple[Floats, Floats, Floats],
    held: NDArray[np.bool_],
    normalised: Floats,
    n: int,
) -> float:
    """One step of a filter of n components, in place; arrays may be longer, the rest is left alone.

    state     mean (n,), covariance (n, n)       walk  (n,): variance that its random walk adds
    measured  innovation m (3,), its variance R (3,), H (3, n)
    held      (n,): what does not move           normalised (3,): becomes mᵢ / √Sᵢᵢ
    -> mᵀ S⁻¹ m (at most `MAX_SQUARED_DISTANCE`) + ln |S|
    """
    mean, P = state
    m, variance, H = measured
    for i in range(n):
        P[i, i] += walk[i]
    HP, spread = np.zeros((AXES, n)), np.zeros((AXES, AXES))
    for a in range(AXES):
        for i in range(n):
            for j in range(n):
                HP[a, j] += H[a, i] * P[i, j]
        for b in range(AXES):
            for j in range(n):
                spread[a, b] += HP[a, j] * H[b, j]
        normalised[a] = m[a] / np.sqrt(spread[a, a] + variance[a])
    L, R = np.zeros((AXES, AXES)), variance.copy()
    cholesky(spread, R, L)
    squared = weighed(L, m)
    if squared > MAX_SQUARED_DISTANCE:  # an outlier: it counts, but less
        for a in range(AXES):
            R[a] *= squared / MAX_SQUARED_DISTANCE
        cholesky(spread, R, L)
    K = np.zeros((n, AXES))
    for i in range(n):
        if held[i]:
            continue
        for a in range(AXES):
            K[i, a] = HP[a, i]
        whiten(L, K[i])
        unwhiten(L, K[i])
        for a in range(AXES):
            mean[i] += K[i, a] * m[a]
    joseph(P, K, R, H, HP)
    distance = min(squared, MAX_SQUARED_DISTANCE)
    for a in range(AXES):
        distance += 2.0 * np.log(L[a, a])
    return distance


@compiled
def joseph(P: Floats, K: Floats, R: Floats, H: Floats, HP: Floats) -> None:
    """P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ: first from the left, then from the right."""
    n = len(K)
    for i in range(n):
        for j in range(n):
            for a in range(AXES):
                P[i, j] -= K[i, a] * HP[a, j]
    PH = np.zeros((n, AXES))
    for i in range(n):
        for a in range(AXES):
            for j in range(n):
                PH[i, a] += P[i, j] * H[a, j]
            PH[i, a] -= K[i, a] * R[a]
    for i in range(n):
        for j in range(n):
            for a in range(AXES):
                P[i, j] -= PH[i, a] * K[j, a]
