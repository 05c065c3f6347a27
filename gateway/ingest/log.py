"""An opened recording: messages as columns, what was odd while reading them, and its boats.

Its tables become samples of one boat on the boat's clock, with a report on that clock:

    tables -> rows of this boat -> stamps (clock) -> facts (mapping) -> samples
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.clock import BoatClock, ClockReport, StampStatus
from gateway.ingest.mapping import Counter, Rule, counter_us, instance_of
from gateway.samples import Quantity, Samples
from sim.state import Floats, Ints

Array = TypeVar("Array", bound=NDArray[np.generic])


def columns(records: NDArray[np.void], fields: Iterable[str]) -> dict[str, NDArray[np.generic]]:
    """Records (K,) -> field -> (K,) or (K, n), aligned, read-only; text ends at its first NUL."""
    return {name: frozen(column(records[name])) for name in fields}


def column(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """One field of packed records -> the same values side by side."""
    aligned = np.ascontiguousarray(values)
    return until_nul(aligned) if aligned.dtype.kind == "S" else aligned


def until_nul(raw: NDArray[np.bytes_]) -> NDArray[np.bytes_]:
    """Text (K,) without what stands behind a NUL."""
    characters = raw.view(np.uint8).reshape(-1, raw.dtype.itemsize)
    inside = np.logical_and.accumulate(characters != 0, axis=1)
    return np.where(inside, characters, 0).astype(np.uint8).view(raw.dtype).reshape(-1)


def frozen(array: Array) -> Array:
    """The same array, read-only."""
    array.setflags(write=False)
    return array


def text(value: Any) -> str:
    """One field -> str without what stands behind a NUL; bytes that are no UTF-8 become marks."""
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    return str(value).split("\0", 1)[0].strip()


USUAL_COMPONENTS = (0, 1)  # no address at all, and MAV_COMP_ID_AUTOPILOT1


@dataclass(frozen=True)
class Boat:
    """One vehicle of a log: its address and its type."""

    system: int
    component: int
    autopilot: str = ""  # "ArduPilot", "PX4", …; empty where the log has none
    type: str = ""  # "surface boat", "ground rover", …

    def __str__(self) -> str:
        kind = f"{self.autopilot} {self.type}".strip() or "unknown vehicle"
        component = "" if self.component in USUAL_COMPONENTS else f", component {self.component}"
        return f"system {self.system}{component} ({kind})"


def numbers(column: NDArray[np.generic]) -> Floats:
    """A column as numbers; NaN throughout where a damaged definition declares it to be text."""
    if column.dtype.kind in "SUO":
        return np.full(len(column), np.nan)
    return np.asarray(column, np.float64)


class ListedParameter(NamedTuple):
    """One parameter as a message of the log told it; order and receipt as in `Table`.

    changed  the log itself says that it had another value before, which need not be in it
    """

    order: int
    receive_time_ns: int
    name: str
    value: float
    changed: bool = False


@dataclass(frozen=True)
class Table:
    """All messages of one name, as columns.

    order            (K,)  position of each message among all accepted ones of the log
    receive_time_ns  (K,)  int64 Unix ns of receipt (boat time in a log that has no receiver)
    system           (K,)  MAVLink system id (0 in formats without addresses)
    component        (K,)  MAVLink component id (0 in formats without addresses)
    columns          name -> (K,) or (K, n): fields under the names and in the units of the
                     definition, not scaled; text fields are arrays of bytes or str
    """

    name: str
    order: Ints
    receive_time_ns: Ints
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    columns: Mapping[str, NDArray[np.generic]]

    @classmethod
    def unaddressed(
        cls, name: str, order: Ints, time_ns: Ints, columns: Mapping[str, NDArray[np.generic]]
    ) -> "Table":
        """Messages of a format that knows one vehicle and no receiver."""
        zeros = frozen(np.zeros(len(order), np.uint8))
        return cls(name, frozen(order), frozen(time_ns), zeros, zeros, columns)

    def __len__(self) -> int:
        return len(self.order)

    def sent_by(self, boat: Boat) -> NDArray[np.bool_]:
        """(K,): the messages of that boat."""
        return np.asarray((self.system == boat.system) & (self.component == boat.component))

    def texts(self, field: str, boat: Boat) -> list[str]:
        """A text field of that boat's messages."""
        if field not in self.columns:
            return []
        return [text(value) for value in self.columns[field][self.sent_by(boat)]]

    def listed(self, names: str, values: str, boat: Boat) -> list["ListedParameter"]:
        """Two columns of that boat's messages: each parameter as often as it was listed."""
        if not {names, values} <= set(self.columns):
            return []
        own = self.sent_by(boat)
        found = zip(
            self.order[own].tolist(),
            self.receive_time_ns[own].tolist(),
            self.texts(names, boat),
            numbers(self.columns[values])[own].tolist(),
            strict=True,
        )
        return [ListedParameter(*row) for row in found if row[2] and np.isfinite(row[3])]


@dataclass(frozen=True)
class Statistics:
    """What was found while reading: shown by `shadow info`, never hidden."""

    size_bytes: int = 0
    accepted: int = 0
    bad_checksum: int = 0
    junk_bytes: int = 0
    unknown_messages: int = 0
    signed: int = 0
    mavlink1: int = 0
    mavlink2: int = 0
    truncated_tail: bool = False
    lost: int = 0  # gaps in the sequence numbers, per system and component, summed
    duplicates: int = 0
    time_backwards: int = 0  # receive clock stepped back
    notes: tuple[str, ...] = ()


class LaneSwitch(NamedTuple):
    """The autopilot's filter goes on with another one of its lanes, at two clocks [ns]."""

    vehicle_time_ns: int
    receive_time_ns: int
    before: int
    after: int

    def __str__(self) -> str:
        return f"the autopilot's EKF switches from lane {self.before} to lane {self.after}"


def lanes_notice(switches: Sequence[LaneSwitch], log: "Log") -> tuple[str, ...]:
    """That the filter switched, with the seconds of `info --events`; nothing without that."""
    if not switches:
        return ()
    more = f", the first of {len(switches)} times" if len(switches) > 1 else ""
    at = (switches[0].receive_time_ns - log_start_ns(log)) * 1e-9
    return (f"{switches[0]} at {at:.0f} s of the log{more}: the lane in use is read, and time "
            "around each switch is left out",)  # fmt: skip


@dataclass(frozen=True)
class BoatSamples:
    """All samples of one boat of a log, on the boat's clock.

    sessions  ((from, to), …)  vehicle time [ns] of the first and last message of each boot
    tabular   all sources lie on the rows of one table: values may be held or smoothed
    notices   messages that could not be read, and what else was odd, a sentence each
    """

    boat: Boat
    samples: tuple[Samples, ...]
    clock: ClockReport
    sessions: tuple[tuple[int, int], ...]
    tabular: bool = False
    notices: tuple[str, ...] = ()
    lane_switches: tuple[LaneSwitch, ...] = ()  # of the autopilot's filter

    def of(self, quantity: Quantity) -> tuple[Samples, ...]:
        """All samples of a quantity, one per source."""
        return tuple(samples for samples in self.samples if samples.quantity == quantity)

    def times_at(self, order: Ints) -> Ints | None:
        """Places in the log (K,) -> the boat's clock [ns], on a line between messages whose time is
        known; None where none is.
        """
        if not self.samples:
            return None
        known, first = np.unique(np.concatenate([s.order for s in self.samples]), return_index=True)
        time = np.concatenate([s.vehicle_time_ns for s in self.samples])[first]
        since = np.interp(order, known, (time - time[0]).astype(np.float64))
        return np.asarray(np.rint(since), np.int64) + time[0]

    def equivalent(self, message: str) -> str:
        """The known message that a message of this log equals; itself where there is none."""
        sources = (s for s in self.samples if s.source.partition("/")[0] == message)
        return next((samples.equivalent for samples in sources), message)


class Log(ABC):
    """A recording opened for reading; each format has one final class.

    kind        name of the format as `shadow info` prints it
    statistics  what was found while reading
    """

    path: str
    kind: str
    statistics: Statistics

    @abstractmethod
    def counts(self) -> Mapping[str, int]:
        """Message name -> number of accepted messages, by name."""

    @abstractmethod
    def table(self, name: str) -> Table:
        """All messages of that name (an empty table where there is none)."""

    @abstractmethod
    def boats(self) -> tuple[Boat, ...]:
        """All boats of the log, ordered by their address."""

    @abstractmethod
    def decode(self, boat: Boat) -> BoatSamples:
        """All samples of one boat."""

    def listed_parameters(self, boat: Boat) -> list[ListedParameter]:
        """The autopilot's parameters in the order in which the log lists them, again and again."""
        return []

    def parameters(self, boat: Boat) -> dict[str, float]:
        """The autopilot's parameters: name -> last value."""
        return {one.name: one.value for one in self.listed_parameters(boat)}

    def firmware(self, boat: Boat) -> str:
        """Name and version of the autopilot's software; empty where the log has none."""
        return ""

    def channel_names(self) -> Mapping[int, str]:
        """Actuator channel, from 1 -> its name, where the log names channels."""
        return {}


def log_start_ns(log: Log) -> int:
    """Receipt of the first message [ns]: seconds of a log count from there. Decodes all tables."""
    receipts = [log.table(name).receive_time_ns for name in log.counts()]
    return min((int(times.min()) for times in receipts if len(times)), default=0)


NOT_FLOATING = (  # words of vehicle types that no model of a boat fits
    "copter", "rotor", "wing", "plane", "VTOL", "submarine", "helicopter", "airship", "balloon",
    "rocket", "kite", "parafoil",
)  # fmt: skip


def not_a_boat(boat: Boat) -> str:
    """That the vehicle says it is no boat, as a sentence; empty where it may be one."""
    if not any(word in boat.type for word in NOT_FLOATING):
        return ""
    return f"the vehicle says that it is a {boat.type}: no model of a boat fits it"


def choose_floating(log: Log, system: int | None = None, anyway: bool = False) -> Boat:
    """The boat asked for; BadInput where it says that it is none, unless taken `anyway`."""
    boat = choose_boat(log, system)
    if not anyway and not_a_boat(boat):
        raise BadInput(f"{log.path}: {not_a_boat(boat)}: --anyway takes it as one")
    return boat


MAX_LISTED = 20  # boats that a message names
MAX_BOATS = 255  # that are looked at without being asked for: one for each system id


def boats_of(log: Log) -> tuple[Boat, ...]:
    """All boats; BadInput where there are more than a log can hold that nobody made up."""
    present = log.boats()
    if len(present) > MAX_BOATS:
        raise BadInput(
            f"{log.path}: {len(present):,} vehicles in it, more than {MAX_BOATS} (MAX_BOATS): "
            "choose one with --system"
        )
    return present


def choose_boat(log: Log, system: int | None = None) -> Boat:
    """The boat asked for, or the only one; else BadInput with those present."""
    present = log.boats()
    if not present:
        raise BadInput(f"{log.path}: no vehicle in it (no HEARTBEAT of an autopilot, no motion)")
    if system is None and len({boat.system for boat in present}) == 1:
        return present[0]
    chosen = [boat for boat in present if boat.system == system]
    if chosen:
        return chosen[0]
    systems = list({boat.system: str(boat) for boat in reversed(present)}.values())[::-1]
    more = f" and {len(systems) - MAX_LISTED} more" if len(systems) > MAX_LISTED else ""
    listed = ", ".join(systems[:MAX_LISTED]) + more
    if system is None:
        raise BadInput(f"{log.path}: several boats in it, choose one: {listed}")
    raise BadInput(f"{log.path}: no boat with system id {system}; present: {listed}")


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


Instances = Mapping[str, Callable[[Ints], Ints]]


def decode_tables(
    log: Log, boat: Boat, rules: Sequence[Rule], instances: Instances | None = None
) -> BoatSamples:
    """All samples of one boat by the rules of its log's format.

    `instances` gives for some instance columns, of all messages or of one (MESSAGE.COLUMN), the
    number that counts instead of the rule's own, at each place in the log (K,).
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


def _rows(table: Table, rule: Rule, boat: Boat, instances: Instances) -> _RuleRows:
    """The rows of this boat and of the instance that counts."""
    message = SimpleNamespace(**table.columns)
    names = [key for name in rule.instance for key in (f"{rule.message}.{name}", name)]
    chosen = next((instances[name] for name in names if name in instances), None)
    number = np.full(len(table), rule.number) if chosen is None else chosen(table.order)
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
    counter = np.repeat([int(part.rule.counter) for part in parts], sizes)[by_log]
    vehicle, status, session = clock.stamp_all(
        np.repeat(np.arange(len(parts)), sizes)[by_log],
        counter,
        np.concatenate([part.counter_us for part in parts])[by_log],
        np.concatenate([part.receive for part in parts])[by_log],
    )
    placed = status != StampStatus.UNPLACED
    spans = tuple(
        _span(vehicle[mine], counter[mine] != Counter.RECEIPT)
        for number in np.unique(session[placed])
        for mine in [placed & (session == number)]
    )
    back = np.empty(len(by_log), np.int64)
    back[by_log] = np.arange(len(by_log))
    cuts = np.cumsum(sizes)[:-1]
    return np.split(vehicle[back], cuts), np.split(status[back], cuts), spans


def _span(vehicle: Ints, counted: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last time of a session's messages, in the order of the log.

    Until the clock is sure of a new boot, messages without a counter lie where the receiver's clock
    was set to: those that go back behind the last counter are none of this session.
    """
    if counted.any():
        last = int(np.flatnonzero(counted)[-1])
        behind = (np.arange(len(vehicle)) > last) & (vehicle < vehicle[last])
        vehicle = vehicle[~behind]
    return int(vehicle.min()), int(vehicle.max())


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
