"""Backward pass of a fixed-interval smoother.

Bryson and Frazier's form of the Rauch-Tung-Striebel smoother, modified by Bierman: it carries the
information of the future as λ (13,) and Λ (13, 13) and needs no inverse of a covariance:

    over a measurement  λ ← λ − Hᵀ (S⁻¹ y + Kᵀ λ)    Λ ← (I − K H)ᵀ Λ (I − K H) + Hᵀ S⁻¹ H
    over a prediction   λ ← Fᵀ λ                      Λ ← Fᵀ Λ F
    smoothed            x − P λ                       P − P Λ P

with x, P after the filter's own update. Source: G. J. Bierman, Fixed interval smoothing with
discrete measurements, International Journal of Control 18(1), 1973.
"""

from typing import NamedTuple

import numpy as np

from gateway.estimation.measurement import Workspace, symmetrise
from gateway.estimation.motion import COLUMNS, ROWS
from gateway.estimation.names import STATES, State
from gateway.estimation.step import KalmanState, valid
from gateway.jit import compiled
from sim.state import Floats, Ints
from sim.trial import MOTION


class Trace(NamedTuple):
    """What the forward pass keeps of each of its n steps.

    x (n, 13), P (n, 13, 13) after the step; F (n, 13, 13), H (n, 2, 13), K (n, 13, 2),
    S_inv (n, 2, 2), y (n, 2), components used (n,), valid (n,)
    """

    x: Floats
    P: Floats
    F: Floats
    H: Floats
    K: Floats
    S_inv: Floats
    y: Floats
    used: Ints
    valid: Ints


def new_trace(size: int) -> Trace:
    """Room for that many steps."""
    s = STATES
    shapes = ((s,), (s, s), (s, s), (2, s), (s, 2), (2, 2), (2,))
    flags = [np.zeros(size, np.int64) for _ in range(2)]
    return Trace(*(np.zeros((size, *shape)) for shape in shapes), *flags)


@compiled
def store_step(trace: Trace, n: int, state: KalmanState, used: int, work: Workspace) -> None:
    """Keeps step n."""
    trace.x[n] = state.x
    trace.P[n] = state.P
    trace.F[n] = work.F
    trace.used[n], trace.valid[n] = used, valid(state.gates)
    if used:
        trace.H[n] = work.H
        trace.K[n] = work.K
        trace.S_inv[n] = work.S_inv
        trace.y[n] = work.y


@compiled
def smoothed_motion(
    x: Floats, P: Floats, lam: Floats, Lam: Floats, A: Floats, mean: Floats, cov: Floats
) -> None:
    """Filtered x, P and the future's λ, Λ -> motion (9,), covariance (9, 9); A (13, 13) scratch."""
    for i in range(MOTION):
        mean[i] = x[i]
        for j in range(STATES):
            mean[i] -= P[i, j] * lam[j]
            A[i, j] = 0.0
        for k in range(STATES):
            for j in range(STATES):
                A[i, j] += P[i, k] * Lam[k, j]
    for i in range(MOTION):
        for j in range(MOTION):
            cov[i, j] = P[i, j]
            for k in range(STATES):
                cov[i, j] -= A[i, k] * P[j, k]
    symmetrise(cov)


@compiled
def backward_update(trace: Trace, n: int, lam: Floats, Lam: Floats, work: Workspace) -> None:
    """λ (13,), Λ (13, 13) before the measurement of step n, in place."""
    H, K, S_inv, y, W = trace.H[n], trace.K[n], trace.S_inv[n], trace.y[n], work.PH
    m = trace.used[n]
    for a in range(m):
        pull = 0.0
        for b in range(m):
            pull += S_inv[a, b] * y[b]
        for i in range(STATES):
            pull += K[i, a] * lam[i]
            W[i, a] = 0.0
            for j in range(STATES):
                W[i, a] += Lam[i, j] * K[j, a]
        work.R[a] = pull
    for a in range(m):
        for i in range(STATES):
            lam[i] -= H[a, i] * work.R[a]
    for a in range(m):
        for b in range(m):
            G = S_inv[a, b]
            for i in range(STATES):
                G += K[i, a] * W[i, b]
            for i in range(STATES):
                if H[a, i] != 0.0:
                    for j in range(STATES):
                        Lam[i, j] += H[a, i] * G * H[b, j]
    for a in range(m):
        for j in range(STATES):
            if H[a, j] != 0.0:
                for i in range(STATES):
                    Lam[i, j] -= W[i, a] * H[a, j]
                    Lam[j, i] -= W[i, a] * H[a, j]


@compiled
def transpose_times(F: Floats, x: Floats) -> None:
    """x (13,) becomes Fᵀ x in place, last column first: F is that of `motion.transition`."""
    for i in range(State.U_DOT, STATES):
        x[i] *= F[i, i]
    for n in range(len(ROWS) - 1, -1, -1):
        x[COLUMNS[n]] += F[ROWS[n], COLUMNS[n]] * x[ROWS[n]]


@compiled
def backward_prediction(F: Floats, lam: Floats, Lam: Floats) -> None:
    """λ (13,), Λ (13, 13) before a prediction with transition F, in place."""
    transpose_times(F, lam)
    for k in range(STATES):
        transpose_times(F, Lam[k, :])
    for k in range(STATES):
        transpose_times(F, Lam[:, k])
    symmetrise(Lam)
