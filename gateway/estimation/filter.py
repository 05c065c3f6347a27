"""The extended Kalman filter over events in order of receipt, live and in replay.

Its state is a value, and a pure function of the ordered events: it does not matter how they are cut
into chunks. Live gives chunks of a few events, replay whole arrays, to the same compiled loop.

The last events are kept with the filter after each of them: a late event is inserted where it
belongs. They stand in a ring: event number n (the first ever is the beginning, number 0) is in slot
n modulo the capacity. The newest slot is the filter's state.

The covariance of the filter leaves out a heading that is off by a slowly changing angle e:

    ψ + e    (u + e v, v − e u)    (u̇ + e v̇, v̇ − e u̇)         [rad, m/s, m/s²]

are estimated where ψ, (u, v), (u̇, v̇) are true. e is not observable, so it is no state: a
linearised filter would seem to observe it, and turn a good sway into a bad one. Its variance is
added to what is reported.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.estimation import GATE_RECORDS, KINDS, STATES, FilterModel, FilterSettings, Flag, State
from gateway.estimation.events import (
    Events,
    KalmanState,
    initialise,
    predict_over,
    update_gated,
    valid,
)
from gateway.estimation.model import Event, Workspace, copy_matrix, new_workspace
from sim.kernel.compiled import compiled
from sim.kernel.rows import set_row
from sim.state import Floats, Ints
from sim.trial import MOTION


class History(NamedTuple):
    """Events and the filter after each of them, M slots.

    time (M,) [s], kind (M,), z (M, 2), std (M, 2), x (M, 13), P (M, 13, 13), gates (M, 7, 13);
    counts (2,): events so far with the beginning, events refused in a row
    """

    time: Floats
    kind: Ints
    z: Floats
    std: Floats
    x: Floats
    P: Floats
    gates: Floats
    counts: Ints


COUNT, REFUSED_RUN = 0, 1


def new_history(capacity: int, model: FilterModel) -> History:
    """A filter before its first event."""
    history = History(
        np.zeros(capacity),
        np.zeros(capacity, np.int64),
        np.zeros((capacity, 2)),
        np.ones((capacity, 2)),
        np.zeros((capacity, STATES)),
        np.zeros((capacity, STATES, STATES)),
        np.zeros((capacity, KINDS, GATE_RECORDS)),
        np.zeros(2, np.int64),
    )
    restart(history, model)
    return history


def copy_of(history: History) -> History:
    """The same content in arrays of its own."""
    return History._make(part.copy() for part in history)


@compiled
def state_after(history: History, number: int) -> KalmanState:
    """The filter after event `number`: views into its slot."""
    slot = number % len(history.time)
    return KalmanState(history.x[slot], history.P[slot], history.gates[slot])


@compiled
def event_of(history: History, number: int) -> Event:
    """Event `number`."""
    slot = number % len(history.time)
    return Event(history.time[slot], history.kind[slot], history.z[slot], history.std[slot])


@compiled
def write_event(history: History, number: int, event: Event) -> None:
    """Writes an event into its slot."""
    slot = number % len(history.time)
    history.time[slot], history.kind[slot] = event.time, event.kind
    set_row(history.z[slot], event.z)
    set_row(history.std[slot], event.std)


@compiled
def restart(history: History, model: FilterModel) -> None:
    """Back to the state before the first event."""
    history.time[0] = -np.inf
    initialise(state_after(history, 0), model)
    history.counts[COUNT] = 1
    history.counts[REFUSED_RUN] = 0


@compiled
def copy_state(source: KalmanState, to: KalmanState) -> None:
    """One state becomes another."""
    set_row(to.x, source.x)
    copy_matrix(source.P, to.P)
    copy_matrix(source.gates, to.gates)


@compiled
def reprocess(
    history: History, number: int, model: FilterModel, work: Workspace
) -> tuple[float, int, int]:
    """The state after event `number` from the one before it -> NIS, components used, flags."""
    event, state = event_of(history, number), state_after(history, number)
    before = state_after(history, number - 1)
    copy_state(before, state)
    span = event.time - event_of(history, number - 1).time
    if 0.0 < span < np.inf and state.gates[:, 0].any():
        predict_over(state, span, model, work)
    return update_gated(state, event, state.x, model, work)


@compiled
def insertion_number(history: History, time: float, kind: int) -> int:
    """Number of an event among those kept; −1 where it is too old.

    Order is by time, then by kind, then by receipt: it does not depend on the order in which two
    messages of one moment came.
    """
    capacity, count = len(history.time), history.counts[COUNT]
    oldest = max(0, count - capacity)
    number = int(count)
    while number > oldest:
        before = (number - 1) % capacity
        if history.time[before] < time:
            break
        if history.time[before] == time and history.kind[before] <= kind:
            break
        number -= 1
    # The event before it must survive when the newest takes the oldest slot.
    if number == oldest or (number - 1 == oldest and count >= capacity):
        return -1
    return number


@compiled
def insert(
    history: History, number: int, event: Event, model: FilterModel, work: Workspace
) -> tuple[float, int, int]:
    """Inserts an event at `number`, repeats what followed -> NIS, components used, flags."""
    count = history.counts[COUNT]
    for n in range(count, number, -1):
        write_event(history, n, event_of(history, n - 1))
    write_event(history, number, event)
    outcome = reprocess(history, number, model, work)
    for n in range(number + 1, count + 1):
        reprocess(history, n, model, work)
    history.counts[COUNT] = count + 1
    return outcome


LATE, REFUSED, RESTART = int(Flag.LATE), int(Flag.REFUSED), int(Flag.RESTART)


@compiled
def admit(history: History, time: float, kind: int, model: FilterModel) -> tuple[int, int]:
    """Admits an event by its time -> its number among those kept (−1: refused), flags."""
    if not np.isfinite(time) or kind < 0 or kind >= KINDS:
        return -1, REFUSED
    count = history.counts[COUNT]
    newest = history.time[(count - 1) % len(history.time)]
    step = time - newest if np.isfinite(newest) else 0.0
    if np.abs(step) > model.gap_s:
        restart(history, model)
        return 1, RESTART
    number = insertion_number(history, time, kind) if -step <= model.max_late_s else -1
    if number > 0:
        history.counts[REFUSED_RUN] = 0
        return number, LATE if step < 0.0 else 0
    history.counts[REFUSED_RUN] += 1
    if history.counts[REFUSED_RUN] >= model.refused_in_a_row:
        restart(history, model)
        return 1, RESTART
    return -1, REFUSED


@compiled
def write_estimate(history: History, model: FilterModel, out: tuple[Floats, ...], k: int) -> int:
    """The newest state into row k of time (K,), motion, std (K, 9), covariance (K, 9, 9 or 0, 0).

    Returns Flag.VALID or 0.
    """
    time, motion, std, covariance = out
    newest = history.counts[COUNT] - 1
    state = state_after(history, newest)
    x, P = state.x, state.P
    time[k] = event_of(history, newest).time
    for i in range(MOTION):
        motion[k, i] = x[i]
        std[k, i] = np.sqrt(P[i, i] + (model.heading_error_rad * heading_slope(i, x)) ** 2)
    if len(covariance[k]):
        copy_matrix(P[:MOTION, :MOTION], covariance[k])
        add_heading_error(x, model.heading_error_rad, covariance[k])
    return valid(state.gates)


@compiled
def process_events(
    kept: tuple[Any, ...],
    events: tuple[Floats, Ints, Floats, Floats],
    settings: tuple[float, ...],
    estimates: tuple[Floats, ...],
    outcomes: tuple[Floats, NDArray[np.int8], NDArray[np.uint8]],
) -> None:
    """K events as received through the filter, in place; one row of output per event.

    kept        a `History`, and
    settings    a `FilterModel`, as plain tuples: those numba tells apart in a moment, named ones
                take it longer than what is done here for a few events
    events      columns of `Events`
    estimates   time, motion, std, covariance of `FilterRows`
    outcomes    its NIS, components used, flags
    """
    history, model, work = History(*kept), FilterModel(*settings), new_workspace()
    time, kind, z, std = events
    for k in range(len(time)):
        nis, used = 0.0, 0
        number, flags = admit(history, time[k], kind[k], model)
        if number >= 0:
            event = Event(time[k], kind[k], z[k], std[k])
            nis, used, outcome = insert(history, number, event, model, work)
            flags |= outcome
        flags |= write_estimate(history, model, estimates, k)
        outcomes[0][k], outcomes[1][k], outcomes[2][k] = nis, used, flags


@compiled
def heading_slope(i: int, x: Floats) -> float:
    """How component i of the motion (9,) moves with the heading error: unit of i per rad."""
    if i == State.YAW:
        return 1.0
    if i == State.U:
        return float(x[State.V])
    if i == State.V:
        return float(-x[State.U])
    if i == State.U_DOT:
        return float(x[State.V_DOT])
    if i == State.V_DOT:
        return float(-x[State.U_DOT])
    return 0.0


@compiled
def add_heading_error(x: Floats, sigma: float, covariance: Floats) -> None:
    """Adds to the covariance (9, 9) of the motion x (9,) that of a heading error of std sigma."""
    for i in range(MOTION):
        slope = heading_slope(i, x)
        if slope != 0.0:
            for j in range(MOTION):
                covariance[i, j] += sigma * sigma * slope * heading_slope(j, x)


@dataclass(frozen=True)
class FilterState:
    """The state of the filter. Never changed: `advance` returns a new one."""

    history: History


@dataclass(frozen=True)
class FilterRows:
    """The estimate after each event.

    time_s      (K,)       of the estimate: of the newest event so far, not of a late one
    motion      (K, 9)     eta, nu, nu_dot, columns as in `State`
    std         (K, 9)     their standard deviations
    covariance  (K, 9, 9)  of the motion, or (K, 0, 0) where it was not asked for
    nis         (K,)       normalised innovation squared of the event
    used        (K,)       components used: degrees of freedom of `nis`; 0 where none was
    flags       (K,)       bits of `Flag`
    faults      (K,)       bits of `SensorFault`: what makes the boat's data unfit then
    """

    time_s: Floats
    motion: Floats
    std: Floats
    covariance: Floats
    nis: Floats
    used: NDArray[np.int8]
    flags: NDArray[np.uint8]
    faults: Ints

    def __len__(self) -> int:
        return len(self.time_s)

    def with_faults(self, faults: Ints) -> "FilterRows":
        """The same rows, with what makes the boat's data unfit (K,)."""
        if not np.count_nonzero(faults) and not np.count_nonzero(self.faults):
            return self  # as mostly
        return FilterRows(
            self.time_s, self.motion, self.std, self.covariance, self.nis, self.used, self.flags,
            faults,
        )  # fmt: skip

    def has(self, flag: Flag) -> NDArray[np.bool_]:
        """Which rows carry that flag: (K,)."""
        return np.asarray((self.flags & int(flag)) != 0)


class Estimator:
    """A filter with its settings; it holds no state of its own."""

    def __init__(self, settings: FilterSettings | None = None) -> None:
        self.settings = settings or FilterSettings()
        self._model = self.settings.kernel_model()
        self._numbers = tuple(self._model)

    def start(self) -> FilterState:
        """The state before the first event."""
        return FilterState(new_history(self.settings.history_events, self._model))

    def advance(
        self, state: FilterState, events: Events, covariance: bool = False, spend: bool = False
    ) -> tuple[FilterState, FilterRows]:
        """Takes K events in the order of their receipt -> the state after them, K rows.

        `spend`: `state` is not used again, its memory (0.4 MB) becomes the new one's.
        """
        history = state.history if spend else copy_of(state.history)
        rows = _empty_rows(len(events), MOTION if covariance else 0)
        columns = events.time_s, events.kind, events.z, events.std
        estimates = rows.time_s, rows.motion, rows.std, rows.covariance
        outcomes = rows.nis, rows.used, rows.flags
        process_events(tuple(history), columns, self._numbers, estimates, outcomes)
        return FilterState(history), rows


def _empty_rows(count: int, size: int) -> FilterRows:
    return FilterRows(
        np.empty(count),
        np.empty((count, MOTION)),
        np.empty((count, MOTION)),
        np.empty((count, size, size)),
        np.empty(count),
        np.empty(count, np.int8),
        np.empty(count, np.uint8),
        np.zeros(count, np.int64),
    )
