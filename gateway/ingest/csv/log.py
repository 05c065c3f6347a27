"""Tables (.csv) as logs: a mapping file (see `mapping_file`) names what the columns are."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from gateway.ingest.clock import BoatClock
from gateway.ingest.csv.mapping_file import WIDTHS, CsvMapping, beside, read_mapping
from gateway.ingest.log import Boat, BoatSamples, Log, Statistics, Table
from gateway.samples import Quantity, Samples
from sim.state import Floats, Ints

SOURCE = "CSV"
DELIMITERS = ",;\t"
LATEST_S = 9e9  # a later time does not fit into nanoseconds


@dataclass(frozen=True)
class CsvLog(Log):
    """An opened table: the columns that its mapping names, row by row of known time."""

    path: str
    mapping: CsvMapping
    time_s: Floats
    columns: Mapping[str, Floats]
    statistics: Statistics
    kind: str = "csv"

    @classmethod
    def from_bytes(cls, raw: bytes, path: str, mapping: str | Path | None = None) -> "CsvLog":
        """A table with its mapping file (`mapping`, or the one beside it)."""
        file = Path(path)
        header, rows = _parse(file, raw)
        plan = read_mapping(Path(mapping) if mapping is not None else beside(file))
        wanted = {plan.time_column, *(column.column for column in plan.columns)}
        missing = sorted(wanted - set(header))
        if missing:
            raise BadInput(
                f"{file}: no column {missing[0]!r}, which {plan.path} names; "
                f"there are: {', '.join(name for name in header if name)}"
            )
        values = {name: _numbers(file, name, rows, header.index(name)) for name in wanted}
        return cls._of(file, plan, values, len(raw))

    @classmethod
    def _of(cls, file: Path, plan: CsvMapping, values: Mapping[str, Floats], size: int) -> "CsvLog":
        time = values[plan.time_column] * plan.time_unit_s
        known = np.abs(time) < LATEST_S  # NaN is not
        if known.sum() < 2:
            raise BadInput(f"{file}: fewer than two rows with a time in {plan.time_column!r}")
        kept = time[known]
        statistics = Statistics(
            size_bytes=size,
            accepted=int(known.sum()),
            duplicates=int((np.diff(kept) == 0).sum()),
            time_backwards=int((np.diff(kept) < 0).sum()),
            notes=() if known.all() else (f"{int((~known).sum())} rows without a time left out",),
        )
        columns = {name: column[known] for name, column in values.items()}
        return cls(str(file), plan, kept, columns, statistics)

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
        """The mapped columns; the one clock of a table needs no repair."""
        times = self.time_ns()
        span = (int(times.min()), int(times.max()))
        report = BoatClock(streams=1).report()
        return BoatSamples(boat, self.samples(), report, (span,), tabular=True)

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


def _parse(file: Path, raw: bytes) -> tuple[list[str], list[list[str]]]:
    """Header, rows."""
    try:
        content = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput(f"{file}: not a text table (UTF-8 with one line of column names)") from None
    first = content.split("\n", 1)[0]
    delimiter = max(DELIMITERS, key=first.count)
    try:
        rows = list(csv.reader(io.StringIO(content), delimiter=delimiter))
    except csv.Error as error:
        raise BadInput(f"{file}: not a table: {error}") from None
    if not rows:
        raise BadInput(f"{file} is empty: it holds no table")
    return [name.strip() for name in rows[0]], [row for row in rows[1:] if row]


def _numbers(file: Path, name: str, rows: list[list[str]], index: int) -> Floats:
    """One column as numbers; NaN for an empty or missing cell."""
    values = np.full(len(rows), np.nan)
    for number, row in enumerate(rows):
        cell = row[index].strip() if index < len(row) else ""
        try:
            values[number] = float(cell) if cell else np.nan
        except ValueError:
            raise BadInput(f"{file}: line {number + 2}, {name}: {cell!r} is no number") from None
    return values
