"""A log's tables -> samples of one boat on the boat's clock, and a report on that clock.

tables -> rows of this boat -> stamps (clock) -> facts (mapping) -> samples
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.clock import BoatClock
from gateway.ingest.clock_step import StampStatus
from gateway.ingest.log import Boat, BoatSamples, Log, Table, numbers
from gateway.ingest.mapping import Rule, counter_us, instance_of
from gateway.samples import Quantity, Samples
from sim.state import Ints

# a field that the log's own definition lacks, or gives another type or shape
UNREADABLE = (AttributeError, IndexError, TypeError, ValueError)


@dataclass(frozen=True)
class _RuleRows:
    """The rows of a table that one rule applies to, not stamped yet."""

    rule: Rule
    order: Ints
    receive: Ints
    counter_us: Ints
    message: SimpleNamespace


def decode_tables(
    log: Log, boat: Boat, rules: Sequence[Rule], instances: Mapping[str, int] | None = None
) -> BoatSamples:
    """All samples of one boat by the rules of its log's format.

    `instances` gives for some instance columns the number that counts instead of the rule's own.
    """
    parts = [_rows(log.table(rule.message), rule, boat, instances or {}) for rule in rules]
    parts = [part for part in parts if len(part.order)]
    clock = BoatClock(streams=max(len(parts), 1))
    vehicle, status, sessions = _stamped(clock, parts)
    samples: list[Samples] = []
    notices: dict[str, None] = {}
    for part, times, worth in zip(parts, vehicle, status, strict=True):
        good = (worth == StampStatus.FRESH) | (worth == StampStatus.LATE)
        try:
            samples += _samples(part, times, good)
        except UNREADABLE:
            name = part.rule.message
            notices[f"{name} cannot be read: its fields are not those that {name} has"] = None
    return BoatSamples(boat, tuple(samples), clock.report(), sessions, notices=tuple(notices))


def _rows(table: Table, rule: Rule, boat: Boat, instances: Mapping[str, int]) -> _RuleRows:
    """The rows of this boat and of the instance that counts."""
    message = SimpleNamespace(**table.columns)
    number = next((instances[n] for n in rule.instance if n in instances), rule.number)
    mine = table.sent_by(boat) & (np.asarray(instance_of(message, rule, number)) == number)
    picked = SimpleNamespace(
        **{name: _as_live(column[mine]) for name, column in table.columns.items()}
    )
    order = np.asarray(table.order[mine], np.int64)
    counter = np.broadcast_to(np.asarray(counter_us(picked, rule), np.int64), order.shape)
    receive = np.asarray(table.receive_time_ns[mine], np.int64)
    return _RuleRows(rule, order, receive, counter, picked)


def _as_live(column: NDArray[np.generic]) -> NDArray[np.generic]:
    """Single precision as double: a live message comes as Python floats, and both must agree.

    No rule reads a text: what a damaged definition declares to be one is missing.
    """
    return numbers(column) if column.dtype.kind in "fSUO" else column


def _stamped(
    clock: BoatClock, parts: Sequence[_RuleRows]
) -> tuple[list[Ints], list[Ints], tuple[tuple[int, int], ...]]:
    """All messages through the clock in the order of the log -> times, statuses, sessions."""
    if not parts:
        return [], [], ()
    sizes = [len(part.order) for part in parts]
    by_log = np.argsort(np.concatenate([part.order for part in parts]), kind="stable")
    vehicle, status, session = clock.stamp_all(
        np.repeat(np.arange(len(parts)), sizes)[by_log],
        np.repeat([int(part.rule.counter) for part in parts], sizes)[by_log],
        np.concatenate([part.counter_us for part in parts])[by_log],
        np.concatenate([part.receive for part in parts])[by_log],
    )
    placed = status != StampStatus.UNPLACED
    spans = tuple(
        (int(times.min()), int(times.max()))
        for number in np.unique(session[placed])
        for times in [vehicle[placed & (session == number)]]
    )
    back = np.empty(len(by_log), np.int64)
    back[by_log] = np.arange(len(by_log))
    cuts = np.cumsum(sizes)[:-1]
    return np.split(vehicle[back], cuts), np.split(status[back], cuts), spans


def _samples(part: _RuleRows, vehicle: Ints, good: NDArray[np.bool_]) -> list[Samples]:
    """One rule's facts as samples; rows in which a value is missing are left out."""
    found, rule = [], part.rule
    for quantity, columns in rule.facts(part.message):
        values = np.stack([np.asarray(column, np.float64) for column in columns], axis=1)
        keep = good.copy()
        if quantity is not Quantity.ACTUATORS:
            keep &= np.isfinite(values).all(axis=1)
        if keep.any():
            times = part.order[keep], vehicle[keep], part.receive[keep]
            found.append(
                Samples(
                    quantity,
                    rule.source,
                    *times,
                    values[keep],
                    rule.equivalent,
                    rule.channels,
                    rule.on_change,
                )
            )
    return found
