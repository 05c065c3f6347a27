"""The text of a table: one line of column names, then rows of cells; what is wrong with either.

Rows with more cells than there are names are left out, since nobody knows which cell is the odd
one; cells that are missing at the end of a row are empty ones. Where most rows have more the table
is not what it looks like.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gateway.errors import BadInput, counted, shell_path
from gateway.ingest import is_utf16
from sim.state import Floats

DELIMITERS = ",;\t"


@dataclass(frozen=True)
class TextTable:
    """A table as text.

    header     names of the columns, those at the end that have none left out
    lines      (K,) line of the file on which each row ends
    rows       (K,) cells of each
    delimiter  between cells
    notes      a sentence for each thing that was wrong
    """

    file: Path
    header: tuple[str, ...]
    lines: tuple[int, ...]
    rows: tuple[Sequence[str], ...]
    delimiter: str
    notes: tuple[str, ...] = ()

    def cells(self, name: str) -> list[str]:
        """One column (K,) as text; "" for a missing cell."""
        index = self.header.index(name)
        return [row[index].strip() if index < len(row) else "" for row in self.rows]

    def numbers(self, name: str, mapping: str) -> Floats:
        """One column (K,) as numbers; NaN for an empty or missing cell.

        mapping  the file that says what the columns are, for hints
        """
        values = np.full(len(self.rows), np.nan)
        for number, cell in enumerate(self.cells(name)):
            try:
                values[number] = float(cell) if cell else np.nan
            except ValueError:
                raise BadInput(
                    f"{self.file}: line {self.lines[number]}, {name}: {cell!r} is no number"
                    f"{self._hint(cell, mapping)}"
                ) from None
        return values

    def _hint(self, cell: str, mapping: str) -> str:
        """How a cell that is no number becomes one, where that is known."""
        try:
            float(cell.replace(",", ".", 1))
        except ValueError:
            return ""
        how = (
            ""
            if self.delimiter == ","
            else f": tr , . < {shell_path(self.file)} > points.csv, then read points.csv with "
            f"--mapping {shell_path(mapping)}"
        )
        return f"; decimal commas have to become points{how}"


def read_text(file: Path, raw: bytes) -> TextTable:
    """The bytes of a table -> its cells."""
    if is_utf16(raw):
        raise BadInput(
            f"{file} is UTF-16 text: a table is read as UTF-8: "
            f"iconv -f UTF-16 -t UTF-8 {shell_path(file)} > utf8.csv, then read "
            "utf8.csv with --mapping FILE"
        )
    try:
        content = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, byte = raw.count(b"\n", 0, error.start) + 1, raw[error.start]
        raise BadInput(
            f"{file}: line {line} is not UTF-8 (byte 0x{byte:02x}), as a table has to be; if it is "
            f"Latin-1: iconv -f LATIN1 -t UTF-8 {shell_path(file)} > utf8.csv, then read "
            "utf8.csv with --mapping FILE"
        ) from None
    content = io.StringIO(content, newline=None).read()  # any line ends
    comments = _leading_comments(content)
    content = content.split("\n", comments)[-1]
    first = content.split("\n", 1)[0]
    delimiter = max(DELIMITERS, key=first.count)
    reader = csv.reader(io.StringIO(content), delimiter=delimiter)
    try:
        rows = [(comments + reader.line_num, row) for row in reader]
    except csv.Error as error:
        raise BadInput(f"{file}: not a table: {error}") from None
    if not rows:
        raise BadInput(f"{file} is empty: it holds no table")
    header = _without_empty_end([name.strip() for name in rows[0][1]], 0)
    found = [(line, _without_empty_end(row, len(header))) for line, row in rows[1:] if row]
    kept, notes = _of_width(file, len(header), found, delimiter)
    lines, cells = tuple(line for line, _ in kept), tuple(row for _, row in kept)
    return TextTable(file, tuple(header), lines, cells, delimiter, notes)


def _leading_comments(content: str) -> int:
    """How many lines before the header are comments or empty; none where all are."""
    lines = content.split("\n")
    table = (k for k, line in enumerate(lines) if line.strip() and not line.startswith("#"))
    return next(table, 0)


def _without_empty_end(cells: list[str], width: int) -> list[str]:
    """Cells without the empty ones at the end, `width` kept: a delimiter may end each line."""
    end = len(cells)
    while end > width and not cells[end - 1].strip():
        end -= 1
    return cells[:end]


Row = tuple[int, list[str]]


def _of_width(
    file: Path, width: int, rows: list[Row], delimiter: str
) -> tuple[list[Row], tuple[str, ...]]:
    """Rows that have no more cells than there are names, and a sentence about the others."""
    longer = [(line, row) for line, row in rows if len(row) > width]
    shorter = [(line, row) for line, row in rows if len(row) < width]
    if 2 * len(longer) > len(rows):
        hint = ": decimal commas between commas? Write points" if delimiter == "," else ""
        raise BadInput(
            f"{file}: {_first(longer[0], width)}, and {len(longer)} of {len(rows)} rows have more "
            f"than that{hint}"
        )
    said = ((longer, "left out"), (shorter, "taken as empty at their end"))
    notes = [
        f"{_first(odd[0], width)}: {counted(len(odd), 'row')} with {than} cells, {done}"
        for (odd, done), than in zip(said, ("more", "fewer"), strict=True)
        if odd
    ]
    return [(line, row) for line, row in rows if len(row) <= width], tuple(notes)


def _first(row: Row, width: int) -> str:
    return f"line {row[0]} has {len(row[1])} cells, the header {width}"
