"""The last events with the filter after each of them: a late event is inserted where it belongs.

A ring: event number n (the first ever is the beginning, number 0) is in slot n modulo the
capacity. The newest slot is the filter's state.
"""

from typing import NamedTuple

import numpy as np

from gateway.estimation.measurement import Workspace
from gateway.estimation.names import GATE_RECORDS, KINDS, STATES
from gateway.estimation.settings import FilterModel
from gateway.estimation.step import (
    Event,
    KalmanState,
    initialise,
    predict_over,
    update_gated,
)
from sim.kernel.compiled import compiled
from sim.state import Floats, Ints


class History(NamedTuple):
    """Events and the filter after each of them, M slots.

    time (M,) [s], kind (M,), z (M, 2), std (M, 2), x (M, 13), P (M, 13, 13), gates (M, 7, 3);
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
    history.z[slot], history.std[slot] = event.z, event.std


@compiled
def restart(history: History, model: FilterModel) -> None:
    """Back to the state before the first event."""
    history.time[0] = -np.inf
    initialise(state_after(history, 0), model)
    history.counts[COUNT] = 1
    history.counts[REFUSED_RUN] = 0


@compiled
def reprocess(
    history: History, number: int, model: FilterModel, work: Workspace
) -> tuple[float, int, int]:
    """The state after event `number` from the one before it -> NIS, components used, flags."""
    event, state = event_of(history, number), state_after(history, number)
    before = state_after(history, number - 1)
    state.x[:], state.P[:], state.gates[:] = before.x, before.P, before.gates
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
