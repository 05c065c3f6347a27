"""One event of the filter: prediction to its time, gate, measurement update.

A measurement that fails the gate again and again, for long enough, is a discontinuity of its
source (a yaw reset, a lane switch, a shifted origin) and not motion: noise is added to the states
that it measures, and it is used. A gyro has no discontinuities: when a few of its measurements in a
row fail, the boat has begun to turn faster than was assumed, and they are used.
"""

import numpy as np

from gateway.estimation.measurement import Workspace, innovation_covariance, linearise, update
from gateway.estimation.motion import predict
from gateway.estimation.names import STATES, Flag, GateRecord, MeasurementKind, State
from gateway.estimation.settings import FilterModel
from gateway.jit import compiled
from sim.state import Floats, wrap

# Chosen, not measured: what follows is far beyond the motion of a boat.
LOST_YAW = 0.5  # rad, std of a heading with which nothing that turns with it can be used
JUMP_POSITION = 1e3  # m, std that is added after a discontinuity
JUMP_SPEED = 5.0  # m/s
JUMP_YAW = 3.0  # rad
JUMP_YAW_RATE = 2.0  # rad/s
TURN_RUN = 2  # gated yaw rates in a row that are a turn

# Largest credible measurement by kind [rad, rad/s, m/s, m, m/s, m/s²]
IMPLAUSIBLE = np.array([0.0, 1e4, 50.0, 100.0, 1e7, 100.0, 200.0])

USED, GATED, WAITING = int(Flag.USED), int(Flag.GATED), int(Flag.WAITING)
VALID, JUMP = int(Flag.VALID), int(Flag.JUMP)


@compiled
def initialise(x: Floats, P: Floats, gates: Floats, model: FilterModel) -> None:
    """State (13,), covariance (13, 13), gates (7, 3) become those before any measurement."""
    x[:] = 0.0
    P[:] = 0.0
    gates[:] = 0.0
    P[State.NORTH, State.NORTH] = P[State.EAST, State.EAST] = model.prior_position_m**2
    P[State.YAW, State.YAW] = np.pi**2
    P[State.U, State.U] = P[State.V, State.V] = model.prior_speed_mps**2
    P[State.R, State.R] = model.prior_yaw_rate_radps**2
    P[State.U_DOT, State.U_DOT] = model.surge_acceleration_mps2**2
    P[State.V_DOT, State.V_DOT] = model.sway_acceleration_mps2**2
    P[State.R_DOT, State.R_DOT] = model.yaw_acceleration_radps2**2
    P[State.POSITION_ERROR_NORTH, State.POSITION_ERROR_NORTH] = model.position_error_m**2
    P[State.POSITION_ERROR_EAST, State.POSITION_ERROR_EAST] = model.position_error_m**2
    P[State.VELOCITY_ERROR_FIRST, State.VELOCITY_ERROR_FIRST] = model.velocity_error_mps**2
    P[State.VELOCITY_ERROR_SECOND, State.VELOCITY_ERROR_SECOND] = model.velocity_error_mps**2


@compiled
def valid(gates: Floats) -> int:
    """Flag.VALID once yaw and velocity or position are known, else 0."""
    seen = gates[:, GateRecord.SEEN]
    moving = seen[MeasurementKind.VELOCITY] + seen[MeasurementKind.BODY_VELOCITY]
    if seen[MeasurementKind.YAW] > 0.0 and moving + seen[MeasurementKind.POSITION] > 0.0:
        return VALID
    return 0


@compiled
def predict_over(x: Floats, P: Floats, span: float, model: FilterModel, work: Workspace) -> None:
    """Predicts over span [s] in steps short enough for the linearisation."""
    steps = int(np.ceil(span / model.max_step_s - 1e-9))
    for _ in range(steps):
        predict(x, P, span / steps, model, work.F, work.Q)


@compiled
def implausible(kind: int, z: Floats, std: Floats, m: int) -> bool:
    """Whether a measurement (2,) of m components or its std is no number or beyond any boat."""
    for a in range(m):
        if not (np.isfinite(z[a]) and np.abs(z[a]) <= IMPLAUSIBLE[kind]):
            return True
        if not (np.isfinite(std[a]) and std[a] > 0.0):
            return True
    return False


@compiled
def inflate_covariance(kind: int, since: float, P: Floats) -> None:
    """Adds the noise of a discontinuity, gated for `since` [s], to the states that are measured."""
    if kind == MeasurementKind.YAW:
        P[State.YAW, State.YAW] += JUMP_YAW**2
    elif kind == MeasurementKind.YAW_RATE:
        P[State.R, State.R] += JUMP_YAW_RATE**2
        P[State.YAW, State.YAW] += (JUMP_YAW_RATE * since) ** 2
    elif kind == MeasurementKind.POSITION:
        P[State.NORTH, State.NORTH] += JUMP_POSITION**2
        P[State.EAST, State.EAST] += JUMP_POSITION**2
    else:
        P[State.U, State.U] += JUMP_SPEED**2
        P[State.V, State.V] += JUMP_SPEED**2


@compiled
def is_discontinuity(kind: int, record: Floats, time: float, model: FilterModel) -> bool:
    """Counts one more outlier of a kind; whether it is a discontinuity by now."""
    if record[GateRecord.GATED_RUN] == 0.0:
        record[GateRecord.GATED_SINCE] = time
    record[GateRecord.GATED_RUN] += 1.0
    if kind == MeasurementKind.YAW_RATE:
        return bool(record[GateRecord.GATED_RUN] >= TURN_RUN)
    long_enough = time - record[GateRecord.GATED_SINCE] >= model.gated_for_s
    return bool(long_enough and record[GateRecord.GATED_RUN] >= model.gated_in_a_row)


@compiled
def move_innovation(x: Floats, at: Floats, m: int, work: Workspace) -> None:
    """The innovation in `work`, taken at another state (13,), becomes that at x (13,)."""
    for a in range(m):
        for i in range(STATES):
            work.y[a] -= work.H[a, i] * (x[i] - at[i])


@compiled
def update_gated(
    x: Floats,
    P: Floats,
    gates: Floats,
    time: float,
    kind: int,
    z: Floats,
    std: Floats,
    at: Floats,
    model: FilterModel,
    work: Workspace,
) -> tuple[float, int, int]:
    """Gates and uses one measurement at its time -> NIS, components used (0: none), flags.

    `at` is the state (13,) to linearise at: x itself, or one that is known better.
    """
    m = linearise(kind, at, z, model.gyro_delay_s, work.H, work.y)
    if m == 0:
        return 0.0, 0, 0
    move_innovation(x, at, m, work)
    if implausible(kind, z, std, m):
        return 0.0, 0, GATED
    if kind == MeasurementKind.YAW and gates[kind, GateRecord.SEEN] == 0.0:
        x[State.YAW] = wrap(z[0])
        work.y[0] = 0.0
    elif kind != MeasurementKind.YAW and (
        gates[MeasurementKind.YAW, GateRecord.SEEN] == 0.0 or P[State.YAW, State.YAW] > LOST_YAW**2
    ):
        return 0.0, 0, WAITING
    work.R[0], work.R[1] = std[0] * std[0], std[1] * std[1]
    nis = innovation_covariance(P, m, work)
    flags = USED
    gate = model.gate_one if m == 1 else model.gate_two
    if nis > gate and gates[kind, GateRecord.SEEN] > 0.0:
        if not is_discontinuity(kind, gates[kind], time, model):
            return nis, 0, GATED
        inflate_covariance(kind, time - gates[kind, GateRecord.GATED_SINCE], P)
        innovation_covariance(P, m, work)
        flags |= JUMP
    gates[kind, GateRecord.SEEN] = 1.0
    gates[kind, GateRecord.GATED_RUN] = 0.0
    update(x, P, m, work)
    return nis, m, flags
