"""The recursions of the filter that ties short runs together, compiled.

What they compute, and the symbols, stand in `sim.identification.innovations`. Matrices are of a few
rows each, and multiplied in loops: calls of a library take several times as long.
"""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, error_model="numpy")
def riccati(  # type: ignore[no-untyped-def]
    error, phi, count, follows, moved, fresh, rho, process, timing, timing_scale, start,
    state, gain, root, white,
):  # fmt: skip
    """The recursion run by run: state, gain, root and the whitened errors (S, m) are filled.

    Returns Σ log det of the innovations' covariances. error (S, m + 3) with the gap last; process
    (3,): variance of w for each mean; timing (S, m + 3, m + 3), or empty. What command timing adds
    to the next (δ, ε) is c, and what is no ε in the last error.
    """
    S, most, size = len(phi), state.shape[1], 0.0
    P, moved_P, x, moved_x = np.empty((6, 6)), np.empty((6, 3)), np.empty(6), np.empty(6)
    _set_state(x, P, start)
    GP, own, beside = np.empty((most, 6)), np.empty((most, most)), np.zeros((6, most))
    X = np.empty((most, 7))  # covariance of the next (δ, ε) with the rows, and the innovations
    before, unit = _per_row(most, fresh, rho)
    for k in range(S):
        m, F, G, L = 3 * count[k], moved[k], state[k], root[k]
        _state_rows(phi[k], fresh, rho, G[:m])
        for i in range(m):
            for j in range(i + 1):
                own[i, j] = 1.0 if i == j else 0.0
        if len(timing):
            rows = _whitened_rows(timing[k], m, before, unit)
            for i in range(m):
                for j in range(i + 1):
                    new = rows[i, j] - before[j] * rows[i, max(j - 3, 0)]
                    own[i, j] += timing_scale * unit[j] * new
            for i in range(3):
                for j in range(m):
                    beside[i, j] = timing_scale * rows[j, m + i]
                    beside[3 + i, j] = -timing_scale * rows[j, m - 3 + i]
        for i in range(m):
            for b in range(6):
                GP[i, b] = 0.0
                for a in range(6):
                    GP[i, b] += G[i, a] * P[a, b]
            for j in range(i + 1):
                for b in range(6):
                    own[i, j] += GP[i, b] * G[j, b]
            for b in range(6):
                X[i, b] = beside[b, i]
                for a in range(3):
                    X[i, b] += GP[i, a] * F[b, a]
            X[i, 6] = _in_time(error[k], i, before, unit)
            for b in range(6):
                X[i, 6] -= G[i, b] * x[b]
            for j in range(i + 1):  # Cholesky row by row, and X solved with it
                left = own[i, j]
                for a in range(j):
                    left -= L[i, a] * L[j, a]
                if j == i:
                    if not left > 0.0:
                        raise np.linalg.LinAlgError("innovations without a covariance")
                    L[i, i] = np.sqrt(left)
                    continue
                L[i, j] = left / L[j, j]
                for b in range(7):
                    X[i, b] -= L[i, j] * X[j, b]
            for b in range(7):
                X[i, b] /= L[i, i]
            size += 2.0 * np.log(L[i, i])
            white[k, i] = X[i, 6]
        if follows[k] == 0.0:
            _set_state(x, P, start)
            continue
        for b in range(6):
            moved_x[b] = 0.0
            for i in range(m):
                gain[k, b, i] = X[i, b]
                moved_x[b] += X[i, b] * X[i, 6]
            for a in range(3):
                moved_x[b] += F[b, a] * x[a]
                moved_P[b, a] = 0.0
                for c in range(3):
                    moved_P[b, a] += F[b, c] * P[c, a]
        for a in range(6):
            x[a] = moved_x[a]
            for b in range(a + 1):
                P[a, b] = 0.0
                for c in range(3):
                    P[a, b] += moved_P[a, c] * F[b, c]
                for i in range(m):
                    P[a, b] -= X[i, a] * X[i, b]
        for i in range(3):
            x[i] -= error[k, error.shape[1] - 3 + i]
            x[3 + i] += error[k, m - 3 + i]
            P[i, i] += process[i] * count[k]
        if len(timing):
            for i in range(3):
                for j in range(3):
                    P[3 + i, j] -= timing_scale * timing[k, m - 3 + i, m + j]
                    if j <= i:
                        P[i, j] += timing_scale * timing[k, m + i, m + j]
                        P[3 + i, 3 + j] += timing_scale * timing[k, m - 3 + i, m - 3 + j]
        for a in range(6):
            for b in range(a):
                P[b, a] = P[a, b]
    return size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _set_state(x, P, start):  # type: ignore[no-untyped-def]
    """The filter as it starts: element by element, see `sim.kernel.rows.set_row`."""
    for a in range(6):
        x[a] = 0.0
        for b in range(6):
            P[a, b] = start[a, b]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _state_rows(phi, fresh, rho, out):  # type: ignore[no-untyped-def]
    """Φ (n, 3, 3) -> (δ, ε) in the whitened rows of a run: out (m, 6)."""
    for i in range(len(out)):
        j, a = i // 3, i % 3
        for b in range(3):
            before = rho[a] * phi[j - 1, a, b] if j > 0 else 0.0
            out[i, b] = (phi[j, a, b] - before) / fresh[a]
        if j == 0:
            out[i, 3 + a] = rho[a] / fresh[a]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _per_row(m, fresh, rho):  # type: ignore[no-untyped-def]
    """What whitens rows in time, (m,), (m,): the share of the row of a mean before, and 1 / std."""
    before, unit = np.empty(m), np.empty(m)
    for i in range(m):
        before[i] = rho[i % 3] if i > 2 else 0.0
        unit[i] = 1.0 / fresh[i % 3]
    return before, unit


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _in_time(error, i, before, unit):  # type: ignore[no-untyped-def]
    """Error i of those of a run (m + 3,), whitened in time."""
    return (error[i] - before[i] * error[max(i - 3, 0)]) * unit[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _whitened_rows(matrix, m, before, unit):  # type: ignore[no-untyped-def]
    """The first m + 3 columns of a covariance (M, M), whitened from the left: (m, m + 3)."""
    out = np.empty((m, m + 3))
    for i in range(m):
        for j in range(m + 3):
            out[i, j] = (matrix[i, j] - before[i] * matrix[max(i - 3, 0), j]) * unit[i]
    return out


# sums of products in any order: as vectors they take half as long
@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def filter_errors(error, follows, count, fresh, rho, state, moved, gain, unit, out):  # type: ignore[no-untyped-def]
    """Errors (K, S, m + 3) with the gap last -> whitened innovations out (K, S, m)."""
    K, S, wide = error.shape
    x, moved_x, v = np.zeros(6), np.empty(6), np.empty(out.shape[2])
    before, unit_in_time = _per_row(out.shape[2], fresh, rho)
    for q in range(K):
        x[:] = 0.0
        for k in range(S):
            m = 3 * count[k]
            for i in range(m):
                v[i] = _in_time(error[q, k], i, before, unit_in_time)
                for b in range(6):
                    v[i] -= state[k, i, b] * x[b]
            for i in range(m):
                for j in range(i + 1):
                    out[q, k, i] += unit[k, i, j] * v[j]
            if follows[k] == 0.0:
                x[:] = 0.0
                continue
            for b in range(6):
                moved_x[b] = 0.0
                for a in range(3):
                    moved_x[b] += moved[k, b, a] * x[a]
                for i in range(m):
                    moved_x[b] += gain[k, b, i] * out[q, k, i]
            for i in range(6):
                x[i] = moved_x[i]
            for i in range(3):
                x[i] -= error[q, k, wide - 3 + i]
                x[3 + i] += error[q, k, m - 3 + i]
