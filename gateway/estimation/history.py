"""The last events with the state after each: so that a late event can be put where it belongs.

A ring: event number n (the first ever is the beginning, number 0) sits in slot n modulo the
capacity. The newest slot is the filter's state.
"""

from typing import NamedTuple

import numpy as np

from gateway.estimation.measurement import Work
from gateway.estimation.names import KINDS, RECORDS, STATES
from gateway.estimation.settings import Model
from gateway.estimation.step import advance_to, begin, take_in
from gateway.jit import compiled
from sim.state import Floats, Ints


class History(NamedTuple):
    """Events and the filter after each of them, M slots.

    time (M,) [s], kind (M,), z (M, 2), std (M, 2), x (M, 13), P (M, 13, 13), book (M, 7, 3);
    counts (2,): events so far with the beginning, events refused in a row
    """

    time: Floats
    kind: Ints
    z: Floats
    std: Floats
    x: Floats
    P: Floats
    book: Floats
    counts: Ints


COUNT, REFUSED_RUN = 0, 1


def new_history(capacity: int, model: Model) -> History:
    """A filter that knows nothing yet."""
    history = History(
        np.zeros(capacity),
        np.zeros(capacity, np.int64),
        np.zeros((capacity, 2)),
        np.ones((capacity, 2)),
        np.zeros((capacity, STATES)),
        np.zeros((capacity, STATES, STATES)),
        np.zeros((capacity, KINDS, RECORDS)),
        np.zeros(2, np.int64),
    )
    restart(history, model)
    return history


def copied(history: History) -> History:
    """The same content in arrays of its own."""
    return History._make(part.copy() for part in history)


@compiled
def restart(history: History, model: Model) -> None:
    """Forgets everything."""
    history.time[0] = -np.inf
    begin(history.x[0], history.P[0], history.book[0], model)
    history.counts[COUNT] = 1
    history.counts[REFUSED_RUN] = 0


@compiled
def apply(history: History, number: int, model: Model, work: Work) -> tuple[float, int, int]:
    """The state after event `number` from the one before it -> NIS, components used, flags."""
    capacity = len(history.time)
    here, before = number % capacity, (number - 1) % capacity
    x, P, book = history.x[here], history.P[here], history.book[here]
    x[:] = history.x[before]
    P[:] = history.P[before]
    book[:] = history.book[before]
    time = history.time[here]
    span = time - history.time[before]
    if 0.0 < span < np.inf and book[:, 0].any():
        advance_to(x, P, span, model, work)
    return take_in(
        x, P, book, time, history.kind[here], history.z[here], history.std[here], x, model, work
    )


@compiled
def write(history: History, number: int, time: float, kind: int, z: Floats, std: Floats) -> None:
    """Puts an event into its slot."""
    here = number % len(history.time)
    history.time[here] = time
    history.kind[here] = kind
    history.z[here] = z
    history.std[here] = std


@compiled
def place(history: History, time: float, kind: int) -> int:
    """The number that an event gets among those kept; −1 where it is too old.

    Order is by time, then by kind, then by receipt: so that it does not depend on the way in
    which two messages of one moment came.
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
    history: History,
    number: int,
    time: float,
    kind: int,
    z: Floats,
    std: Floats,
    model: Model,
    work: Work,
) -> tuple[float, int, int]:
    """Puts an event in at `number` and redoes what followed -> NIS, components used, flags."""
    capacity, count = len(history.time), history.counts[COUNT]
    for n in range(count, number, -1):
        before = (n - 1) % capacity
        write(history, n, history.time[before], history.kind[before], history.z[before],
              history.std[before])  # fmt: skip
    write(history, number, time, kind, z, std)
    outcome = apply(history, number, model, work)
    for n in range(number + 1, count + 1):
        apply(history, n, model, work)
    history.counts[COUNT] = count + 1
    return outcome
