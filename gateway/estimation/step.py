"""One event of the filter: prediction to its time, gate, measurement update.

A measurement that fails the gate again and again, for long enough, is a discontinuity of its
source (a yaw reset, a lane switch, a shifted origin) and not motion: noise is added to the states
that it measures, and it is used. A gyro has no discontinuities: when a few of its measurements in a
row fail, the boat has begun to turn faster than was assumed, and they are used.
"""

from typing import NamedTuple

import numpy as np

from gateway.estimation.measurement import Workspace, innovation_covariance, linearise, update
from gateway.estimation.motion import predict
from gateway.estimation.names import STATES, Flag, GateRecord, MeasurementKind, State
from gateway.estimation.settings import FilterModel
from sim.kernel.compiled import compiled
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


class KalmanState(NamedTuple):
    """Mean x (13,), covariance P (13, 13) and gates (7, 3) of the filter at one time."""

    x: Floats
    P: Floats
    gates: Floats


class Event(NamedTuple):
    """One measurement: time [s], kind, values z (2,), std (2,) of their white errors."""

    time: float
    kind: int
    z: Floats
    std: Floats


USED, GATED, WAITING = int(Flag.USED), int(Flag.GATED), int(Flag.WAITING)
VALID, JUMP = int(Flag.VALID), int(Flag.JUMP)


@compiled
def initialise(state: KalmanState, model: FilterModel) -> None:
    """The state becomes that before any measurement."""
    P = state.P
    state.x[:] = 0.0
    P[:] = 0.0
    state.gates[:] = 0.0
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
def predict_over(state: KalmanState, span: float, model: FilterModel, work: Workspace) -> None:
    """Predicts over span [s] in steps short enough for the linearisation."""
    steps = int(np.ceil(span / model.max_step_s - 1e-9))
    for _ in range(steps):
        predict(state.x, state.P, span / steps, model, work.F, work.Q)


@compiled
def implausible(event: Event, components: int) -> bool:
    """Whether a measurement or its std is no number or beyond any boat."""
    for a in range(components):
        if not (np.isfinite(event.z[a]) and np.abs(event.z[a]) <= IMPLAUSIBLE[event.kind]):
            return True
        if not (np.isfinite(event.std[a]) and event.std[a] > 0.0):
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
def is_discontinuity(event: Event, gate: Floats, model: FilterModel) -> bool:
    """Counts an outlier in the gate (3,) of its kind; whether that is a discontinuity by now."""
    if gate[GateRecord.GATED_RUN] == 0.0:
        gate[GateRecord.GATED_SINCE] = event.time
    gate[GateRecord.GATED_RUN] += 1.0
    if event.kind == MeasurementKind.YAW_RATE:
        return bool(gate[GateRecord.GATED_RUN] >= TURN_RUN)
    long_enough = event.time - gate[GateRecord.GATED_SINCE] >= model.gated_for_s
    return bool(long_enough and gate[GateRecord.GATED_RUN] >= model.gated_in_a_row)


@compiled
def move_innovation(x: Floats, at: Floats, m: int, work: Workspace) -> None:
    """The innovation in `work`, taken at another state (13,), becomes that at x (13,)."""
    for a in range(m):
        for i in range(STATES):
            work.y[a] -= work.H[a, i] * (x[i] - at[i])


@compiled
def update_gated(
    state: KalmanState, event: Event, at: Floats, model: FilterModel, work: Workspace
) -> tuple[float, int, int]:
    """Gates and uses one measurement at its time -> NIS, components used (0: none), flags.

    `at` is the mean (13,) to linearise at: the state's own, or one that is known better.
    """
    x, P, kind = state.x, state.P, event.kind
    yaw_seen, gate = state.gates[MeasurementKind.YAW, GateRecord.SEEN], state.gates[kind]
    m = linearise(kind, at, event.z, model.gyro_delay_s, work.H, work.y)
    if m == 0:
        return 0.0, 0, 0
    move_innovation(x, at, m, work)
    if implausible(event, m):
        return 0.0, 0, GATED
    if kind == MeasurementKind.YAW and yaw_seen == 0.0:
        x[State.YAW] = wrap(event.z[0])
        work.y[0] = 0.0
    elif kind != MeasurementKind.YAW and (yaw_seen == 0.0 or P[State.YAW, State.YAW] > LOST_YAW**2):
        return 0.0, 0, WAITING
    work.R[0], work.R[1] = event.std[0] * event.std[0], event.std[1] * event.std[1]
    nis = innovation_covariance(P, m, work)
    flags = USED
    bound = model.gate_one if m == 1 else model.gate_two
    if nis > bound and gate[GateRecord.SEEN] > 0.0:
        if not is_discontinuity(event, gate, model):
            return nis, 0, GATED
        inflate_covariance(kind, event.time - gate[GateRecord.GATED_SINCE], P)
        innovation_covariance(P, m, work)
        flags |= JUMP
    gate[GateRecord.SEEN] = 1.0
    gate[GateRecord.GATED_RUN] = 0.0
    update(x, P, m, work)
    return nis, m, flags
