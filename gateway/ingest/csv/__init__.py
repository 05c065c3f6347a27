"""Tables (.csv) as recordings: a mapping file names what the columns are."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import LogFormat, is_text

if TYPE_CHECKING:
    from gateway.ingest.log import Log


def recognises(head: bytes, path: Path) -> bool:
    """A text whose name ends in .csv, be it in another encoding than it should: without zeros."""
    return path.suffix.lower() == ".csv" and (is_text(head) or b"\0" not in head)


def open_csv(path: str, raw: bytes, mapping: str | Path | None = None) -> "Log":
    """The table with its mapping file: the one that is given, or the one beside it."""
    from gateway.ingest.csv.log import CsvLog

    return CsvLog.from_bytes(raw, path, mapping)


FORMAT = LogFormat("a .csv table", (".csv",), recognises, open_csv)
