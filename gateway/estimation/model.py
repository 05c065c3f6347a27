"""The models of the filter: how boat and sensor errors move, and what each measurement reads.

**Process model**, one prediction step:

    north' = u cos ψ − v sin ψ    east' = u sin ψ + v cos ψ    ψ' = r      [m/s, rad/s]
    u' = a,  a' = −a/τ + w        for surge, sway and yaw alike            [m/s², rad/s²]
    e' = −e/T + w                 for each coloured sensor error

Exact for velocity, acceleration, yaw and errors; the position turns with the yaw of mid-step.
Valid for: steps of 0.1 s or less. Source: R. A. Singer, IEEE Transactions on Aerospace and
Electronic Systems 6(4), 1970.

**Measurement models** h(x), and the update by one or two components in Joseph's form:

    yaw: ψ    rate: r − d ṙ    position: (N, E) + e_p
    velocity: R(ψ) (u, v) + e_v    body velocity: (u, v) + e_v
    acceleration: (u̇ − r v, v̇ + r u)

Units rad, rad/s, m, m/s, m/s²; the e are the coloured errors of the sensors, d is the delay of
the gyro's low-pass filter; what is not known of it, of std σ_d, adds σ_d² E[ṙ²] to R.

    y = z − h(x)    S = H P Hᵀ + R    K = P Hᵀ S⁻¹
    x ← x + K y     P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ      R diagonal

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, §5.2 and §10.3.
"""

from typing import NamedTuple

import numpy as np

from gateway.estimation import STATES, FilterModel, MeasurementKind, State
from sim.kernel.compiled import compiled
from sim.kernel.rows import set_row
from sim.state import Floats, wrap

# Gauss-Legendre on [0, 1]: the noise of a step is an integral whose closed form cancels badly for
# short steps; a sum of squares cannot become negative.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
NODES, WEIGHTS = 0.5 + 0.5 * _NODES, 0.5 * _WEIGHTS

# Where the transition matrix can be non-zero off its diagonal. It is upper triangular.
_COUPLED = [
    *((row, column) for row in (State.NORTH, State.EAST) for column in range(2, 9)),
    (State.YAW, State.R),
    (State.YAW, State.R_DOT),
    (State.U, State.U_DOT),
    (State.V, State.V_DOT),
    (State.R, State.R_DOT),
]
ROWS = np.array([int(row) for row, _ in _COUPLED])
COLUMNS = np.array([int(column) for _, column in _COUPLED])


@compiled
def copy_matrix(source: Floats, to: Floats) -> None:
    """Numbers (n, m) into another array, see `sim.kernel.rows.set_row`."""
    for i in range(len(source)):
        set_row(to[i], source[i])


@compiled
def axis_response(t: float, tau: float) -> tuple[float, float, float]:
    """Time [s], time constant [s] -> displacement [s²], velocity [s], acceleration [1] per a."""
    velocity = -tau * np.expm1(-t / tau)
    return tau * (t - velocity), velocity, np.exp(-t / tau)


@compiled
def axis_noise(dt: float, sigma: float, tau: float, Q: Floats) -> None:
    """Noise of (displacement, velocity, acceleration) of one axis over a step into Q (3, 3)."""
    Q[:] = 0.0
    density = 2.0 * sigma * sigma / tau
    for k in range(len(NODES)):
        g = axis_response(dt * NODES[k], tau)
        for i in range(3):
            for j in range(3):
                Q[i, j] += density * dt * WEIGHTS[k] * g[i] * g[j]


@compiled
def transition(x: Floats, dt: float, model: FilterModel, F: Floats) -> None:
    """State (13,) moves on by dt [s] in place; its Jacobian goes into F (13, 13)."""
    F[:] = 0.0
    surge_d, surge_v, surge_a = axis_response(dt, model.surge_tau_s)
    sway_d, sway_v, sway_a = axis_response(dt, model.sway_tau_s)
    yaw_d, yaw_v, yaw_a = axis_response(dt, model.yaw_tau_s)
    half, eighth = 0.5 * dt, 0.125 * dt * dt
    middle = x[State.YAW] + half * x[State.R] + eighth * x[State.R_DOT]
    c, s = np.cos(middle), np.sin(middle)
    ahead = dt * x[State.U] + surge_d * x[State.U_DOT]
    aside = dt * x[State.V] + sway_d * x[State.V_DOT]
    north, east = c * ahead - s * aside, s * ahead + c * aside

    for i in range(State.POSITION_ERROR_NORTH):
        F[i, i] = 1.0
    _position_row(F, State.NORTH, -east, half, eighth)
    _position_row(F, State.EAST, north, half, eighth)
    F[State.NORTH, State.U], F[State.NORTH, State.U_DOT] = c * dt, c * surge_d
    F[State.NORTH, State.V], F[State.NORTH, State.V_DOT] = -s * dt, -s * sway_d
    F[State.EAST, State.U], F[State.EAST, State.U_DOT] = s * dt, s * surge_d
    F[State.EAST, State.V], F[State.EAST, State.V_DOT] = c * dt, c * sway_d
    F[State.YAW, State.R], F[State.YAW, State.R_DOT] = dt, yaw_d
    F[State.U, State.U_DOT], F[State.U_DOT, State.U_DOT] = surge_v, surge_a
    F[State.V, State.V_DOT], F[State.V_DOT, State.V_DOT] = sway_v, sway_a
    F[State.R, State.R_DOT], F[State.R_DOT, State.R_DOT] = yaw_v, yaw_a
    _error_rows(F, dt, model)

    x[State.NORTH] += north
    x[State.EAST] += east
    x[State.YAW] += dt * x[State.R] + yaw_d * x[State.R_DOT]
    x[State.U] += surge_v * x[State.U_DOT]
    x[State.V] += sway_v * x[State.V_DOT]
    x[State.R] += yaw_v * x[State.R_DOT]
    for i in range(State.U_DOT, STATES):
        x[i] *= F[i, i]


@compiled
def _position_row(F: Floats, row: int, per_yaw: float, half: float, eighth: float) -> None:
    """How a position depends on yaw and turning in mid-step."""
    F[row, State.YAW] = per_yaw
    F[row, State.R] = per_yaw * half
    F[row, State.R_DOT] = per_yaw * eighth


@compiled
def _error_rows(F: Floats, dt: float, model: FilterModel) -> None:
    """Decay of the coloured errors."""
    position = np.exp(-dt / model.position_error_tau_s)
    velocity = np.exp(-dt / model.velocity_error_tau_s)
    F[State.POSITION_ERROR_NORTH, State.POSITION_ERROR_NORTH] = position
    F[State.POSITION_ERROR_EAST, State.POSITION_ERROR_EAST] = position
    F[State.VELOCITY_ERROR_FIRST, State.VELOCITY_ERROR_FIRST] = velocity
    F[State.VELOCITY_ERROR_SECOND, State.VELOCITY_ERROR_SECOND] = velocity


@compiled
def add_noise(P: Floats, yaw: float, dt: float, model: FilterModel, Q: Floats) -> None:
    """Process noise of a step dt [s] at that yaw [rad] added to P (13, 13); Q (3, 3) is scratch."""
    c, s = np.cos(yaw), np.sin(yaw)
    axis_noise(dt, model.surge_acceleration_mps2, model.surge_tau_s, Q)
    _add_axis(P, Q, c, s, State.U, State.U_DOT)
    axis_noise(dt, model.sway_acceleration_mps2, model.sway_tau_s, Q)
    _add_axis(P, Q, -s, c, State.V, State.V_DOT)
    axis_noise(dt, model.yaw_acceleration_radps2, model.yaw_tau_s, Q)
    chain = (State.YAW, State.R, State.R_DOT)
    for i in range(3):
        for j in range(3):
            P[chain[i], chain[j]] += Q[i, j]
    sigma, steps = model.position_error_m, dt / model.position_error_tau_s
    _add_error_noise(P, State.POSITION_ERROR_NORTH, sigma, steps)
    _add_error_noise(P, State.POSITION_ERROR_EAST, sigma, steps)
    sigma, steps = model.velocity_error_mps, dt / model.velocity_error_tau_s
    _add_error_noise(P, State.VELOCITY_ERROR_FIRST, sigma, steps)
    _add_error_noise(P, State.VELOCITY_ERROR_SECOND, sigma, steps)


@compiled
def _add_axis(P: Floats, Q: Floats, north: float, east: float, speed: int, rate: int) -> None:
    """Noise of surge or sway, which moves the boat along the unit vector (north, east)."""
    world = (north, east)
    for i in range(2):
        for j in range(2):
            P[i, j] += world[i] * world[j] * Q[0, 0]
        P[i, speed] += world[i] * Q[0, 1]
        P[speed, i] += world[i] * Q[0, 1]
        P[i, rate] += world[i] * Q[0, 2]
        P[rate, i] += world[i] * Q[0, 2]
    P[speed, speed] += Q[1, 1]
    P[speed, rate] += Q[1, 2]
    P[rate, speed] += Q[1, 2]
    P[rate, rate] += Q[2, 2]


@compiled
def _add_error_noise(P: Floats, i: int, sigma: float, steps: float) -> None:
    """Noise that keeps a decaying error at its std; `steps` = dt over its time constant."""
    P[i, i] += -np.expm1(-2.0 * steps) * sigma * sigma


@compiled
def propagate(P: Floats, F: Floats) -> None:
    """P (13, 13) becomes F P Fᵀ in place: F is upper triangular and mostly zero."""
    for k in range(STATES):
        _upper_times(F, P[k, :])
    for k in range(STATES):
        _upper_times(F, P[:, k])


@compiled
def _upper_times(F: Floats, x: Floats) -> None:
    """x (13,) becomes F x in place, top row first: each row needs only rows below it."""
    last = -1
    for n in range(len(ROWS)):
        i = ROWS[n]
        if i != last:
            x[i] *= F[i, i]
            last = i
        x[i] += F[i, COLUMNS[n]] * x[COLUMNS[n]]
    for i in range(State.U_DOT, STATES):
        x[i] *= F[i, i]


@compiled
def predict_about(
    x: Floats,
    P: Floats,
    at: Floats,
    dt: float,
    model: FilterModel,
    F: Floats,
    Q: Floats,
    moved: Floats,
) -> None:
    """As `predict`, but linearised at another state (13,); `moved` (13,) is scratch."""
    yaw = at[State.YAW] + 0.5 * dt * at[State.R] + 0.125 * dt * dt * at[State.R_DOT]
    set_row(moved, at)
    transition(moved, dt, model, F)
    for i in range(STATES):
        x[i] -= at[i]
    _upper_times(F, x)
    for i in range(STATES):
        x[i] += moved[i]
    propagate(P, F)
    add_noise(P, yaw, dt, model, Q)


@compiled
def predict(x: Floats, P: Floats, dt: float, model: FilterModel, F: Floats, Q: Floats) -> None:
    """State (13,) and covariance (13, 13) move on by one step dt [s] in place; F, Q: scratch."""
    yaw = x[State.YAW] + 0.5 * dt * x[State.R] + 0.125 * dt * dt * x[State.R_DOT]
    transition(x, dt, model, F)
    propagate(P, F)
    add_noise(P, yaw, dt, model, Q)


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


class Event(NamedTuple):
    """One measurement: time [s], kind, values z (2,), std (2,) of their white errors."""

    time: float
    kind: int
    z: Floats
    std: Floats


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
    """P (13, 13), H (2, 13) -> P Hᵀ (13, m). A measurement reads one to four states."""
    for a in range(m):
        for i in range(STATES):
            out[i, a] = 0.0
        for j in range(STATES):
            if H[a, j] != 0.0:
                for i in range(STATES):
                    out[i, a] += P[i, j] * H[a, j]


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
