"""What one event does to the filter: predict to its time, gate it, take it in.

A reading that fails the gate again and again, for long enough, is a discontinuity of its source
(a yaw reset, a lane switch, a shifted origin) and not motion: the states it reads are opened up by
added noise, and the reading taken in. A gyro has no discontinuities: when a few of its readings in
a row fail, the boat has begun to turn faster than was assumed, and the turn is taken in.
"""

import numpy as np

from gateway.estimation.measurement import Work, observe, update, weigh
from gateway.estimation.motion import predict
from gateway.estimation.names import STATES, Flag, Kind, Record, State
from gateway.estimation.settings import Model
from gateway.jit import compiled
from sim.state import Floats, wrap

LOST_YAW = 0.5  # rad: with a worse heading nothing that turns with it can be used
JUMP_POSITION = 1e3  # m: how far the states open up after a discontinuity
JUMP_SPEED = 5.0  # m/s
JUMP_YAW = 3.0  # rad
JUMP_YAW_RATE = 2.0  # rad/s
TURN_RUN = 2  # gated yaw rates in a row that are a turn

# No boat reads more than this: rad, rad/s, m/s, m, m/s, m/s² by kind.
ABSURD = np.array([0.0, 1e4, 50.0, 100.0, 1e7, 100.0, 200.0])

USED, GATED, WAITING = int(Flag.USED), int(Flag.GATED), int(Flag.WAITING)
VALID, JUMP = int(Flag.VALID), int(Flag.JUMP)


@compiled
def begin(x: Floats, P: Floats, book: Floats, model: Model) -> None:
    """State (13,), covariance (13, 13), book (7, 3) become those of a filter that knows nothing."""
    x[:] = 0.0
    P[:] = 0.0
    book[:] = 0.0
    P[State.NORTH, State.NORTH] = P[State.EAST, State.EAST] = model.prior_position**2
    P[State.YAW, State.YAW] = np.pi**2
    P[State.U, State.U] = P[State.V, State.V] = model.prior_speed**2
    P[State.R, State.R] = model.prior_yaw_rate**2
    P[State.U_DOT, State.U_DOT] = model.surge_sigma**2
    P[State.V_DOT, State.V_DOT] = model.sway_sigma**2
    P[State.R_DOT, State.R_DOT] = model.yaw_sigma**2
    P[State.POSITION_ERROR_NORTH, State.POSITION_ERROR_NORTH] = model.position_sigma**2
    P[State.POSITION_ERROR_EAST, State.POSITION_ERROR_EAST] = model.position_sigma**2
    P[State.VELOCITY_ERROR_FIRST, State.VELOCITY_ERROR_FIRST] = model.velocity_sigma**2
    P[State.VELOCITY_ERROR_SECOND, State.VELOCITY_ERROR_SECOND] = model.velocity_sigma**2


@compiled
def valid(book: Floats) -> int:
    """Flag.VALID once yaw and velocity or position are known, else 0."""
    moving = book[Kind.VELOCITY, Record.SEEN] + book[Kind.BODY_VELOCITY, Record.SEEN]
    if book[Kind.YAW, Record.SEEN] > 0.0 and moving + book[Kind.POSITION, Record.SEEN] > 0.0:
        return VALID
    return 0


@compiled
def advance_to(x: Floats, P: Floats, span: float, model: Model, work: Work) -> None:
    """Predicts over span [s] in steps short enough for the linearisation."""
    steps = int(np.ceil(span / model.max_step - 1e-9))
    for _ in range(steps):
        predict(x, P, span / steps, model, work.F, work.Q)


@compiled
def absurd(kind: int, z: Floats, std: Floats, m: int) -> bool:
    """Whether a reading (2,) of m components or its std is no number or beyond any boat."""
    for a in range(m):
        if not (np.isfinite(z[a]) and np.abs(z[a]) <= ABSURD[kind]):
            return True
        if not (np.isfinite(std[a]) and std[a] > 0.0):
            return True
    return False


@compiled
def open_up(kind: int, since: float, P: Floats) -> None:
    """Adds the noise of a discontinuity, gated for `since` [s], to the states that a kind reads."""
    if kind == Kind.YAW:
        P[State.YAW, State.YAW] += JUMP_YAW**2
    elif kind == Kind.YAW_RATE:
        P[State.R, State.R] += JUMP_YAW_RATE**2
        P[State.YAW, State.YAW] += (JUMP_YAW_RATE * since) ** 2
    elif kind == Kind.POSITION:
        P[State.NORTH, State.NORTH] += JUMP_POSITION**2
        P[State.EAST, State.EAST] += JUMP_POSITION**2
    else:
        P[State.U, State.U] += JUMP_SPEED**2
        P[State.V, State.V] += JUMP_SPEED**2


@compiled
def persists(kind: int, record: Floats, time: float, model: Model) -> bool:
    """Counts one more outlier of a kind; whether it is a discontinuity by now."""
    if record[Record.GATED_RUN] == 0.0:
        record[Record.GATED_SINCE] = time
    record[Record.GATED_RUN] += 1.0
    if kind == Kind.YAW_RATE:
        return bool(record[Record.GATED_RUN] >= TURN_RUN)
    long_enough = time - record[Record.GATED_SINCE] >= model.gated_for
    return bool(long_enough and record[Record.GATED_RUN] >= model.gated_run)


@compiled
def shift(x: Floats, at: Floats, m: int, work: Work) -> None:
    """The innovation in `work`, taken at another state (13,), becomes that at x (13,)."""
    for a in range(m):
        for i in range(STATES):
            work.y[a] -= work.H[a, i] * (x[i] - at[i])


@compiled
def take_in(
    x: Floats,
    P: Floats,
    book: Floats,
    time: float,
    kind: int,
    z: Floats,
    std: Floats,
    at: Floats,
    model: Model,
    work: Work,
) -> tuple[float, int, int]:
    """Gates and uses one reading at its time -> NIS, components used (0: none), flags.

    `at` is the state (13,) to linearise at: x itself, or one that is known better.
    """
    m = observe(kind, at, z, model.gyro_delay, work.H, work.y)
    if m == 0:
        return 0.0, 0, 0
    shift(x, at, m, work)
    if absurd(kind, z, std, m):
        return 0.0, 0, GATED
    if kind == Kind.YAW and book[kind, Record.SEEN] == 0.0:
        x[State.YAW] = wrap(z[0])
        work.y[0] = 0.0
    elif kind != Kind.YAW and (
        book[Kind.YAW, Record.SEEN] == 0.0 or P[State.YAW, State.YAW] > LOST_YAW**2
    ):
        return 0.0, 0, WAITING
    work.R[0], work.R[1] = std[0] * std[0], std[1] * std[1]
    nis = weigh(P, m, work)
    flags = USED
    if nis > (model.gate_one if m == 1 else model.gate_two) and book[kind, Record.SEEN] > 0.0:
        if not persists(kind, book[kind], time, model):
            return nis, 0, GATED
        open_up(kind, time - book[kind, Record.GATED_SINCE], P)
        weigh(P, m, work)
        flags |= JUMP
    book[kind, Record.SEEN] = 1.0
    book[kind, Record.GATED_RUN] = 0.0
    update(x, P, m, work)
    return nis, m, flags
