"""Process model of boat and sensor errors: one prediction step of the filter.

    north' = u cos ψ − v sin ψ    east' = u sin ψ + v cos ψ    ψ' = r      [m/s, rad/s]
    u' = a,  a' = −a/τ + w        for surge, sway and yaw alike            [m/s², rad/s²]
    e' = −e/T + w                 for each coloured sensor error

Exact for velocity, acceleration, yaw and errors; the position turns with the yaw of mid-step.
Valid for: steps of 0.1 s or less. Source: R. A. Singer, IEEE Transactions on Aerospace and
Electronic Systems 6(4), 1970.
"""

import numpy as np

from gateway.estimation.names import STATES, State
from gateway.estimation.settings import FilterModel
from sim.kernel.compiled import compiled
from sim.state import Floats

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
    moved[:] = at
    transition(moved, dt, model, F)
    x -= at
    _upper_times(F, x)
    x += moved
    propagate(P, F)
    add_noise(P, yaw, dt, model, Q)


@compiled
def predict(x: Floats, P: Floats, dt: float, model: FilterModel, F: Floats, Q: Floats) -> None:
    """State (13,) and covariance (13, 13) move on by one step dt [s] in place; F, Q: scratch."""
    yaw = x[State.YAW] + 0.5 * dt * x[State.R] + 0.125 * dt * dt * x[State.R_DOT]
    transition(x, dt, model, F)
    propagate(P, F)
    add_noise(P, yaw, dt, model, Q)
