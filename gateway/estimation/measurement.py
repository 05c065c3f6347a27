"""Measurement models h(x) of the filter, and the update by one or two components in Joseph's form.

    yaw: ψ    rate: r − d ṙ    position: (N, E) + e_p
    velocity: R(ψ) (u, v) + e_v    body velocity: (u, v) + e_v
    acceleration: (u̇ − r v, v̇ + r u)

Units rad, rad/s, m, m/s, m/s²; the e are the coloured errors of the sensors, d is the delay of
the gyro's low-pass filter.

    y = z − h(x)    S = H P Hᵀ + R    K = P Hᵀ S⁻¹
    x ← x + K y     P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ      R diagonal

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, §5.2 and §10.3.
"""

from typing import NamedTuple

import numpy as np

from gateway.estimation.names import STATES, MeasurementKind, State
from sim.kernel.compiled import compiled
from sim.state import Floats, wrap


@compiled
def linearise(kind: int, x: Floats, z: Floats, gyro_delay: float, H: Floats, y: Floats) -> int:
    """State (13,), measurement (2,) -> Jacobian H (2, 13), innovation y (2,); its components."""
    H[:] = 0.0
    y[:] = 0.0
    if kind == MeasurementKind.YAW:
        H[0, State.YAW] = 1.0
        y[0] = wrap(z[0] - x[State.YAW])
        return 1
    if kind == MeasurementKind.YAW_RATE:
        H[0, State.R], H[0, State.R_DOT] = 1.0, -gyro_delay
        y[0] = z[0] - x[State.R] + gyro_delay * x[State.R_DOT]
        return 1
    if kind == MeasurementKind.VELOCITY:
        return _velocity(x, z, H, y)
    if kind == MeasurementKind.POSITION:
        H[0, State.NORTH] = H[0, State.POSITION_ERROR_NORTH] = 1.0
        H[1, State.EAST] = H[1, State.POSITION_ERROR_EAST] = 1.0
        y[0] = z[0] - x[State.NORTH] - x[State.POSITION_ERROR_NORTH]
        y[1] = z[1] - x[State.EAST] - x[State.POSITION_ERROR_EAST]
        return 2
    if kind == MeasurementKind.BODY_VELOCITY:
        H[0, State.U] = H[0, State.VELOCITY_ERROR_FIRST] = 1.0
        H[1, State.V] = H[1, State.VELOCITY_ERROR_SECOND] = 1.0
        y[0] = z[0] - x[State.U] - x[State.VELOCITY_ERROR_FIRST]
        y[1] = z[1] - x[State.V] - x[State.VELOCITY_ERROR_SECOND]
        return 2
    if kind == MeasurementKind.ACCELERATION:
        return _acceleration(x, z, H, y)
    return 0


@compiled
def _velocity(x: Floats, z: Floats, H: Floats, y: Floats) -> int:
    """Velocity over ground towards north and east [m/s]."""
    c, s = np.cos(x[State.YAW]), np.sin(x[State.YAW])
    north = c * x[State.U] - s * x[State.V]
    east = s * x[State.U] + c * x[State.V]
    H[0, State.YAW], H[0, State.U], H[0, State.V] = -east, c, -s
    H[1, State.YAW], H[1, State.U], H[1, State.V] = north, s, c
    H[0, State.VELOCITY_ERROR_FIRST] = H[1, State.VELOCITY_ERROR_SECOND] = 1.0
    y[0] = z[0] - north - x[State.VELOCITY_ERROR_FIRST]
    y[1] = z[1] - east - x[State.VELOCITY_ERROR_SECOND]
    return 2


@compiled
def _acceleration(x: Floats, z: Floats, H: Floats, y: Floats) -> int:
    """Acceleration at the sensor, forward and starboard [m/s²]."""
    u, v, r = x[State.U], x[State.V], x[State.R]
    H[0, State.U_DOT], H[0, State.V], H[0, State.R] = 1.0, -r, -v
    H[1, State.V_DOT], H[1, State.U], H[1, State.R] = 1.0, r, u
    y[0] = z[0] - x[State.U_DOT] + r * v
    y[1] = z[1] - x[State.V_DOT] - r * u
    return 2


class Workspace(NamedTuple):
    """Scratch of one step, reused so that the loop allocates nothing, and its results.

    F (13, 13) transition, H (2, 13), y (2,), S_inv (2, 2), K (13, 2) of the last update
    """

    F: Floats
    Q: Floats
    H: Floats
    y: Floats
    R: Floats
    S_inv: Floats
    K: Floats
    PH: Floats
    A: Floats


@compiled
def new_workspace() -> Workspace:
    """Scratch for one thread."""
    return Workspace(
        np.eye(STATES),
        np.zeros((3, 3)),
        np.zeros((2, STATES)),
        np.zeros(2),
        np.zeros(2),
        np.zeros((2, 2)),
        np.zeros((STATES, 2)),
        np.zeros((STATES, 2)),
        np.zeros((STATES, STATES)),
    )


@compiled
def times_transpose(P: Floats, H: Floats, m: int, out: Floats) -> None:
    """P (13, 13), H (2, 13) -> P Hᵀ (13, m)."""
    for i in range(STATES):
        for a in range(m):
            total = 0.0
            for j in range(STATES):
                total += P[i, j] * H[a, j]
            out[i, a] = total


@compiled
def innovation_covariance(P: Floats, m: int, work: Workspace) -> float:
    """Covariance and the innovation y in `work` -> NIS yᵀ S⁻¹ y; S⁻¹ and P Hᵀ go into `work`."""
    times_transpose(P, work.H, m, work.PH)
    s00, s01, s11 = work.R[0], 0.0, work.R[1]
    for j in range(STATES):
        s00 += work.H[0, j] * work.PH[j, 0]
    if m == 1:
        work.S_inv[:] = 0.0
        work.S_inv[0, 0] = 1.0 / s00
        return float(work.y[0] * work.y[0] / s00)
    for j in range(STATES):
        s01 += work.H[0, j] * work.PH[j, 1]
        s11 += work.H[1, j] * work.PH[j, 1]
    determinant = s00 * s11 - s01 * s01
    work.S_inv[0, 0], work.S_inv[1, 1] = s11 / determinant, s00 / determinant
    work.S_inv[0, 1] = work.S_inv[1, 0] = -s01 / determinant
    y0, y1 = work.y[0], work.y[1]
    return float((s11 * y0 * y0 - 2.0 * s01 * y0 * y1 + s00 * y1 * y1) / determinant)


@compiled
def update(x: Floats, P: Floats, m: int, work: Workspace) -> None:
    """State (13,) and covariance (13, 13) updated by the innovation in `work`, in place."""
    K, PH, A = work.K, work.PH, work.A
    for i in range(STATES):
        for a in range(m):
            K[i, a] = PH[i, 0] * work.S_inv[0, a]
            if m == 2:
                K[i, a] += PH[i, 1] * work.S_inv[1, a]
            x[i] += K[i, a] * work.y[a]
    for i in range(STATES):
        for j in range(STATES):
            A[i, j] = P[i, j] - K[i, 0] * PH[j, 0]
            if m == 2:
                A[i, j] -= K[i, 1] * PH[j, 1]
    times_transpose(A, work.H, m, PH)
    for i in range(STATES):
        for j in range(STATES):
            P[i, j] = A[i, j] - (PH[i, 0] - K[i, 0] * work.R[0]) * K[j, 0]
            if m == 2:
                P[i, j] -= (PH[i, 1] - K[i, 1] * work.R[1]) * K[j, 1]
    symmetrise(P)


@compiled
def symmetrise(P: Floats) -> None:
    """P (n, n) becomes the mean of itself and its transpose."""
    for i in range(len(P)):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
