"""Tables (.csv) as recordings: a small TOML file beside the .csv says what its columns are.

    # mapping.toml
    time = { column = "original_timestamp", unit = "ms" }

    [columns]
    latitude  = { column = "lat", unit = "deg" }
    longitude = { column = "lon", unit = "deg" }
    yaw       = { column = "yaw", unit = "deg" }
    yaw_rate  = { column = "yaw_rate", unit = "rad/s" }
    surge     = { column = "surge", unit = "m/s" }
    sway      = { column = "sway", unit = "m/s" }
    channel_1 = { column = "thr_left", unit = "us" }
    channel_3 = { column = "thr_right", unit = "us" }

Quantities are those of `QUANTITIES` and channel_1 … channel_32; yaw is clockwise from north, surge
and sway are over ground, wind is the velocity of the air towards north and east. Times from 2001 on
are Unix time, smaller ones count from the start of the recording. An empty cell is not a value.

A few rows whose time lies elsewhere than that of the rows before and after them are damaged cells
and left out. Where the rest of the table goes on from another time, a new session begins: one that
steps back goes on a second after the end of the one before, so that time never runs backwards over
sessions; one that leaps ahead further than any boat is silent keeps its times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput, counted
from gateway.ingest.clock import CONFIRM, JUMP, SECOND, SLEEP, BoatClock
from gateway.ingest.csv.text import TextTable, read_text
from gateway.ingest.csv.times import Times, is_descending, spread_whole_seconds, written_times
from gateway.ingest.csv.units import (
    ANGLE,
    LATEST_S,
    PLACE,
    PULSE,
    RATE,
    SPEED,
    TIME,
    Scale,
    about_steps,
    check_steps,
    check_time,
    check_unit,
)
from gateway.ingest.log import Boat, BoatSamples, Log, Statistics, Table
from gateway.samples import CHANNELS, Quantity, Samples
from gateway.toml_file import read_toml
from sim.near_names import did_you_mean
from sim.state import Floats, Ints

JUMP_S, SLEEP_S, CONFIRM_S = JUMP / SECOND, SLEEP / SECOND, CONFIRM / SECOND
LARGEST = 1e12  # of a cell that is no time, in any unit: degrees as integers reach 4e9; chosen


@dataclass(frozen=True)
class TimeColumn:
    """Times of a table repaired.

    kept      (K,) bool  rows whose time can be believed
    time_s    (n,)       of those rows, over sessions ascending
    sessions  (start, end) of each [s]
    notes     a sentence for each thing that was wrong
    """

    kept: NDArray[np.bool_]
    time_s: Floats
    sessions: tuple[tuple[float, float], ...]
    notes: tuple[str, ...]


def repair_time(time_s: Floats) -> TimeColumn:
    """Times (K,) [s] of the rows of a table, all finite -> those that hold, and their sessions."""
    kept = _believed(time_s)
    time = time_s[kept].copy()
    steps = np.diff(time)
    cuts = np.flatnonzero((steps < -JUMP_S) | (steps > SLEEP_S)) + 1
    spread = [spread_whole_seconds(piece) for piece in np.split(time, cuts)]
    pieces = [piece.time_s for piece in spread]
    for before, piece in pairwise(pieces):
        if piece[0] < before.max():
            piece += before.max() + 1.0 - piece.min()
    lost, notes = int((~kept).sum()), []
    if lost:
        notes.append(f"{counted(lost, 'row')} left out: a time far from that of its neighbours")
    if len(pieces) > 1:
        notes.append(f"time leaps within the table: read as {len(pieces)} sessions")
    notes += dict.fromkeys(note for piece in spread for note in piece.notes)
    sessions = tuple((float(p.min()), float(p.max())) for p in pieces if len(p))
    return TimeColumn(kept, np.concatenate(pieces), sessions, tuple(notes))


def _believed(time: Floats) -> NDArray[np.bool_]:
    """Which rows (K,) are no short stretch that lies elsewhere in time than its neighbours."""
    cuts = np.flatnonzero(np.abs(np.diff(time)) > JUMP_S) + 1
    kept, pieces = np.ones(len(time), np.bool_), np.split(np.arange(len(time)), cuts)
    last = -np.inf  # time of the last row that was believed
    for k, rows in enumerate(pieces):
        start, end = time[rows].min(), time[rows].max()
        after = float(time[pieces[k + 1][0]]) if k + 1 < len(pieces) else np.inf
        brief = len(pieces) > 1 and end - start < CONFIRM_S
        between = last <= start and end <= after
        alone = start - last > SLEEP_S and after - end > SLEEP_S
        if brief and (alone if between else last <= after):
            kept[rows] = False
        else:
            last = float(time[rows[-1]])
    return kept if kept.any() else np.ones(len(time), np.bool_)


def without_damaged(columns: Mapping[str, Floats]) -> tuple[dict[str, Floats], tuple[str, ...]]:
    """The same columns, empty where the number is a boat's in no unit; a note that counts them.

    One such number hides all others: its square is larger than the sum of theirs, or infinite.
    """
    out = {name: np.where(np.abs(x) > LARGEST, np.nan, x) for name, x in columns.items()}
    count = sum(int((np.isfinite(x) & np.isnan(out[name])).sum()) for name, x in columns.items())
    note = f"{counted(count, 'cell')} left out whose number no boat has: beyond {LARGEST:g}"
    return out, (note,) if count else ()


T = TypeVar("T")

# name in the file -> quantity, column of its values, units
QUANTITIES: Mapping[str, tuple[Quantity, int, Mapping[str, Scale]]] = {
    "latitude": (Quantity.GLOBAL_POSITION, 0, PLACE),
    "longitude": (Quantity.GLOBAL_POSITION, 1, PLACE),
    "north": (Quantity.POSITION, 0, {"m": (1.0, 0.0)}),
    "east": (Quantity.POSITION, 1, {"m": (1.0, 0.0)}),
    "yaw": (Quantity.YAW, 0, ANGLE),
    "yaw_rate": (Quantity.YAW_RATE, 0, RATE),
    "roll": (Quantity.TILT, 0, ANGLE),
    "pitch": (Quantity.TILT, 1, ANGLE),
    "velocity_north": (Quantity.VELOCITY, 0, SPEED),
    "velocity_east": (Quantity.VELOCITY, 1, SPEED),
    "surge": (Quantity.BODY_VELOCITY, 0, SPEED),
    "sway": (Quantity.BODY_VELOCITY, 1, SPEED),
    "surge_acceleration": (Quantity.ACCELERATION, 0, {"m/s2": (1.0, 0.0)}),
    "sway_acceleration": (Quantity.ACCELERATION, 1, {"m/s2": (1.0, 0.0)}),
    "voltage": (Quantity.VOLTAGE, 0, {"V": (1.0, 0.0), "mV": (1e-3, 0.0)}),
    "wind_north": (Quantity.WIND, 0, SPEED),
    "wind_east": (Quantity.WIND, 1, SPEED),
    "armed": (Quantity.ARMED, 0, {"1": (1.0, 0.0)}),
    **{f"channel_{n}": (Quantity.ACTUATORS, n - 1, PULSE) for n in range(1, CHANNELS + 1)},
}

WIDTHS = {  # quantity -> columns of its values
    quantity: 1 + max(index for other, index, _ in QUANTITIES.values() if other is quantity)
    for quantity, _, _ in QUANTITIES.values()
}


@dataclass(frozen=True)
class Column:
    """One column of the table: what it is, and how it becomes SI."""

    name: str
    column: str
    quantity: Quantity
    index: int
    unit: str
    factor: float
    offset: float


@dataclass(frozen=True)
class CsvMapping:
    """The whole mapping file."""

    path: str
    time_column: str
    time_unit: str  # of TIME
    columns: tuple[Column, ...]

    def names(self) -> tuple[str, ...]:
        """Columns of the table that it names, each once."""
        used = (self.time_column, *(column.column for column in self.columns))
        return tuple(dict.fromkeys(used))


def beside(csv: Path) -> Path:
    """The mapping file of a table that names none: <stem>.toml, else mapping.toml."""
    for candidate in (csv.with_suffix(".toml"), csv.with_name("mapping.toml")):
        if candidate.is_file():
            return candidate
    raise BadInput(
        f"{csv}: needs a mapping file that says which column is what: write "
        f"{csv.with_suffix('.toml').name} or mapping.toml beside it, or give --mapping FILE"
    )


def read_mapping(path: Path) -> CsvMapping:
    """A mapping file, checked."""
    content = read_toml(path, "the mapping file")
    unknown = set(content) - {"time", "columns"}
    if unknown:
        raise BadInput(f"{path}: unknown key {sorted(unknown)[0]!r}: expected time, [columns]")
    column, unit = _entry(path, "time", content.get("time"))
    columns = content.get("columns")
    if not isinstance(columns, dict) or not columns:
        raise BadInput(f"{path}: [columns] is missing: quantity = {{ column = …, unit = … }}")
    found = tuple(_column(path, name, entry) for name, entry in columns.items())
    _unit(path, "time", unit, TIME)
    return CsvMapping(str(path), column, unit, found)


def _column(path: Path, name: str, entry: Any) -> Column:
    if name not in QUANTITIES:
        known = ", ".join(key for key in QUANTITIES if not key.startswith("channel_"))
        meant = did_you_mean(name, QUANTITIES)
        raise BadInput(
            f"{path}: unknown quantity {name!r}: {meant}expected {known}, channel_1 … 32"
        )
    column, unit = _entry(path, name, entry)
    quantity, index, units = QUANTITIES[name]
    factor, offset = _unit(path, name, unit, units)
    return Column(name, column, quantity, index, unit, factor, offset)


def _entry(path: Path, name: str, entry: Any) -> tuple[str, str]:
    """{ column = "…", unit = "…" } -> both."""
    good = isinstance(entry, dict) and set(entry) == {"column", "unit"}
    if not good or not all(isinstance(value, str) for value in entry.values()):
        raise BadInput(f'{path}: {name}: expected {name} = {{ column = "…", unit = "…" }}')
    return entry["column"], entry["unit"]


def _unit(path: Path, name: str, unit: str, units: Mapping[str, T]) -> T:
    if unit not in units:
        raise BadInput(f"{path}: {name}: unknown unit {unit!r}: expected {', '.join(units)}")
    return units[unit]


def check_names(file: Path, plan: CsvMapping, there: Sequence[str]) -> None:
    """BadInput where a column that the mapping names is missing, or there twice."""
    for name in plan.names():
        count = there.count(name)
        if count > 1:
            raise BadInput(
                f"{file}: {count} columns are called {name!r}, which {plan.path} names: rename "
                "one of them"
            )
        if not count:
            known = ", ".join([other for other in there if other][:40])
            meant = did_you_mean(name, there)
            raise BadInput(
                f"{file}: no column {name!r}, which {plan.path} names: {meant}there are: {known}"
            )


def _times(table: TextTable, plan: CsvMapping) -> Times:
    """The column of times [s]: as numbers of its unit, or as dates, which have none."""
    cells = table.cells(plan.time_column)
    first = next(filter(None, cells), "")
    if ":" not in first or written_times([first]) is None:
        return Times(table.numbers(plan.time_column, plan.path) * TIME[plan.time_unit])
    if (found := written_times(cells)) is not None:
        return found
    odd = next((k for k, c in enumerate(cells) if c and written_times([first, c]) is None), 0)
    raise BadInput(
        f"{table.file}: line {table.lines[odd]}, {plan.time_column}: {cells[odd]!r} is no time as "
        f"{first!r} is"
    )


SOURCE = "CSV"


REPEATED_SHARE = 0.9  # of rows with the time of the row before, that say the same as it


def repeated_rows(time_s: Floats, columns: Mapping[str, Floats]) -> NDArray[np.bool_]:
    """Rows (K,) that a writer wrote twice: nearly all that have the time of the row before say the
    same as it. Where only few do, nothing was written twice: a boat that lies still measures the
    same again.
    """
    same_time = np.append(False, time_s[1:] == time_s[:-1])
    same = [
        (column[1:] == column[:-1]) | (np.isnan(column[1:]) & np.isnan(column[:-1]))
        for column in columns.values()
    ]
    again = same_time & np.append(False, np.all(same, axis=0))
    return again if again.sum() >= REPEATED_SHARE * same_time.sum() else np.zeros_like(again)


@dataclass(frozen=True)
class CsvLog(Log):
    """An opened table: the columns that its mapping names, row by row of known time."""

    path: str
    mapping: CsvMapping
    time_s: Floats
    columns: Mapping[str, Floats]
    sessions_s: tuple[tuple[float, float], ...]
    statistics: Statistics
    kind: str = "csv"

    @classmethod
    def from_bytes(cls, raw: bytes, path: str, mapping: str | Path | None = None) -> "CsvLog":
        """A table with its mapping file (`mapping`, or the one beside it)."""
        file = Path(path)
        table = read_text(file, raw)
        plan = read_mapping(Path(mapping) if mapping is not None else beside(file))
        check_names(file, plan, table.header)
        names = [name for name in plan.names() if name != plan.time_column]
        values = {name: table.numbers(name, plan.path) for name in names}
        time = _times(table, plan)
        values[plan.time_column] = time.time_s / TIME[plan.time_unit]
        return cls.from_columns(file, plan, values, len(raw), (*table.notes, *time.notes))

    @classmethod
    def from_columns(
        cls,
        file: Path,
        plan: CsvMapping,
        values: Mapping[str, Floats],
        size: int,
        notes: tuple[str, ...] = (),
    ) -> "CsvLog":
        """Columns (K,) by name, NaN where empty, that a mapping names; `size` of the file [B].

        `notes`: what was wrong with the text that they come from.
        """
        time = values[plan.time_column] * TIME[plan.time_unit]
        others = {name: column for name, column in values.items() if name != plan.time_column}
        others, damaged = without_damaged(others)
        values = {**values, **others}
        check_time(file, plan.time_column, plan.time_unit, time)
        if is_descending(time):
            time, values = time[::-1], {name: column[::-1] for name, column in values.items()}
            notes = (*notes, "its last row comes first: rows are read in the order of their times")
        timed = np.abs(time) < LATEST_S  # NaN is not
        again = repeated_rows(time, values)
        known = timed & ~again
        repaired = repair_time(time[known])
        kept = repaired.time_s
        check_steps(file, plan.time_column, plan.time_unit, kept)
        timeless = counted(int((~timed).sum()), "row")
        absent = () if timed.all() else (f"{timeless} without a time left out",)
        statistics = Statistics(
            size_bytes=size,
            accepted=len(kept),
            duplicates=int(again.sum()) + int((np.diff(kept) == 0).sum()),
            time_backwards=int((np.diff(time[known][repaired.kept]) < 0).sum()),
            notes=(*notes, *absent, *damaged, *repaired.notes, *about_steps(kept, plan.time_unit)),
        )
        columns = {name: column[known][repaired.kept] for name, column in values.items()}
        for column in plan.columns:
            check_unit(file, column.name, column.column, column.unit, columns[column.column])
        return cls(str(file), plan, kept, columns, repaired.sessions, statistics)

    def counts(self) -> Mapping[str, int]:
        """The table is one message."""
        return {SOURCE: len(self.time_s)}

    def table(self, name: str) -> Table:
        """All rows as they stand, for the name "CSV"; else an empty table."""
        count = len(self.time_s) if name == SOURCE else 0
        order = np.arange(count, dtype=np.int64)
        return Table.unaddressed(name, order, self.time_ns()[:count], self.columns if count else {})

    def boats(self) -> tuple[Boat, ...]:
        """The one boat of the table, of unknown type."""
        return (Boat(0, 0, "", "table"),)

    def decode(self, boat: Boat) -> BoatSamples:
        """The mapped columns; the clock of a table is repaired as it is read."""
        spans = tuple((round(a * 1e9), round(b * 1e9)) for a, b in self.sessions_s)
        report = replace(BoatClock(streams=1).report(), sessions=len(spans))
        return BoatSamples(boat, self.samples(), report, spans, tabular=True)

    def channel_names(self) -> Mapping[int, str]:
        """Channel, from 1 -> name of its column."""
        columns = self.mapping.columns
        return {c.index + 1: c.column for c in columns if c.quantity is Quantity.ACTUATORS}

    def time_ns(self) -> Ints:
        """(K,) int64: Unix ns, or ns of the table's own time."""
        return np.round(self.time_s * 1e9).astype(np.int64)

    def samples(self) -> tuple[Samples, ...]:
        """The mapped columns as samples in SI units; rows where a value is missing left out."""
        found = (self._samples(quantity) for quantity in Quantity)
        return tuple(samples for samples in found if samples is not None)

    def _samples(self, quantity: Quantity) -> Samples | None:
        columns = [column for column in self.mapping.columns if column.quantity is quantity]
        if not columns:
            return None
        values = np.full((len(self.time_s), WIDTHS[quantity]), np.nan)
        for column in columns:
            values[:, column.index] = self.columns[column.column] * column.factor + column.offset
        alike = np.concatenate([[False], np.diff(self.time_s) == 0])
        keep = ~alike & (
            np.isfinite(values).any(axis=1)
            if quantity is Quantity.ACTUATORS
            else np.isfinite(values).all(axis=1)
        )
        order, time = np.flatnonzero(keep).astype(np.int64), self.time_ns()[keep]
        return Samples(quantity, SOURCE, order, time, time, values[keep]) if len(order) else None
