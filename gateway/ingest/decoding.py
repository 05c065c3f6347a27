"""A log's tables -> samples of one boat on the boat's clock, and what the clock had to put up with.

tables -> rows of this boat -> stamps (clock) -> facts (mapping) -> samples
"""

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.clock import BoatClock, ClockReport
from gateway.ingest.clock_step import UNIX_FROM_US, Verdict
from gateway.ingest.csv.log import CsvLog
from gateway.ingest.dataflash.log import primary_lane, without_bias
from gateway.ingest.log import Log, Table
from gateway.ingest.mapping.rule import Counter, Rule, instance_of
from gateway.ingest.mapping.table import rules
from gateway.ingest.mavlink.boats import Boat
from gateway.samples import Quantity, Samples
from sim.state import Ints


@dataclass(frozen=True)
class Decoded:
    """What one boat of a log said.

    sessions  ((from, to), …)  vehicle time [ns] of the first and last message of each boot
    """

    boat: Boat
    samples: tuple[Samples, ...]
    clock: ClockReport
    sessions: tuple[tuple[int, int], ...]

    def of(self, quantity: Quantity) -> tuple[Samples, ...]:
        """All samples of a quantity, one per source."""
        return tuple(samples for samples in self.samples if samples.quantity == quantity)


@dataclass(frozen=True)
class _Rows:
    """The rows of a table that one rule is about, stamped or not yet."""

    rule: Rule
    order: Ints
    receive: Ints
    counter_us: Ints
    message: SimpleNamespace


def decode(log: Log, boat: Boat) -> Decoded:
    """All samples of one boat."""
    if isinstance(log, CsvLog):
        return _of_table(log, boat)
    lane = primary_lane(log)
    parts = [_rows(log.table(rule.message), rule, boat, lane) for rule in rules(log.kind)]
    parts = [part for part in parts if len(part.order)]
    clock = BoatClock(streams=max(len(parts), 1))
    vehicle, verdict, sessions = _stamped(clock, parts)
    samples: list[Samples] = []
    for part, times, worth in zip(parts, vehicle, verdict, strict=True):
        samples += _samples(part, times, (worth == Verdict.FRESH) | (worth == Verdict.LATE))
    if log.kind == "dataflash":
        samples = [
            without_bias(s, log, lane) if s.quantity is Quantity.YAW_RATE else s for s in samples
        ]
    return Decoded(boat, tuple(samples), clock.report(), sessions)


def _of_table(log: CsvLog, boat: Boat) -> Decoded:
    """A table has one clock, and its mapping file has said everything else."""
    times = log.time_ns()
    span = (int(times.min()), int(times.max()))
    return Decoded(boat, log.samples(), BoatClock(streams=1).report(), (span,))


def _rows(table: Table, rule: Rule, boat: Boat, lane: int) -> _Rows:
    """The rows of this boat and of the instance that counts."""
    message = SimpleNamespace(**table.columns)
    number = lane if "C" in rule.instance else rule.number
    mine = (table.system == boat.system) & (table.component == boat.component)
    mine = mine & (np.asarray(instance_of(message, rule, number)) == number)
    picked = SimpleNamespace(
        **{name: _as_live(column[mine]) for name, column in table.columns.items()}
    )
    return _Rows(
        rule,
        np.asarray(table.order[mine], np.int64),
        np.asarray(table.receive_time_ns[mine], np.int64),
        counter_us(picked, rule, int(mine.sum())),
        picked,
    )


def _as_live(column: NDArray[np.generic]) -> NDArray[np.generic]:
    """Single precision as double: a live message comes as Python floats, and both must agree."""
    return column.astype(np.float64) if column.dtype.kind == "f" else column


def counter_us(message: Any, rule: Rule, count: int) -> Ints:
    """The boat's counter in µs: (K,); 0 where the message has none."""
    if not rule.field or not hasattr(message, rule.field):
        return np.zeros(count, np.int64)
    raw = np.asarray(getattr(message, rule.field)).astype(np.uint64)
    unit = np.uint64(1000 if rule.counter == Counter.BOOT_MS else 1)
    return np.minimum(raw, np.uint64(UNIX_FROM_US)).astype(np.int64) * np.int64(unit)


def _stamped(
    clock: BoatClock, parts: Sequence[_Rows]
) -> tuple[list[Ints], list[Ints], tuple[tuple[int, int], ...]]:
    """All messages through the clock in the order of the log -> times, verdicts, sessions."""
    if not parts:
        return [], [], ()
    sizes = [len(part.order) for part in parts]
    by_log = np.argsort(np.concatenate([part.order for part in parts]), kind="stable")
    vehicle, verdict, session = clock.stamp_all(
        np.repeat(np.arange(len(parts)), sizes)[by_log],
        np.repeat([int(part.rule.counter) for part in parts], sizes)[by_log],
        np.concatenate([part.counter_us for part in parts])[by_log],
        np.concatenate([part.receive for part in parts])[by_log],
    )
    placed = verdict != Verdict.UNPLACED
    spans = tuple(
        (int(times.min()), int(times.max()))
        for number in np.unique(session[placed])
        for times in [vehicle[placed & (session == number)]]
    )
    back = np.empty(len(by_log), np.int64)
    back[by_log] = np.arange(len(by_log))
    cuts = np.cumsum(sizes)[:-1]
    return np.split(vehicle[back], cuts), np.split(verdict[back], cuts), spans


def _samples(part: _Rows, vehicle: Ints, good: NDArray[np.bool_]) -> list[Samples]:
    """One rule's facts as samples; rows in which a value is missing are left out."""
    found = []
    for quantity, columns in part.rule.facts(part.message):
        values = np.stack([np.asarray(column, np.float64) for column in columns], axis=1)
        keep = good.copy()
        if quantity is not Quantity.ACTUATORS:
            keep &= np.isfinite(values).all(axis=1)
        if keep.any():
            found.append(
                Samples(
                    quantity,
                    part.rule.source,
                    part.order[keep],
                    vehicle[keep],
                    part.receive[keep],
                    values[keep],
                )
            )
    return found
