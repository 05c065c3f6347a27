"""Tables (.csv) as recordings: a mapping file names what the columns are."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import LogFormat, is_text, is_utf16

if TYPE_CHECKING:
    from gateway.ingest.log import Log


def recognises(head: bytes, path: Path) -> bool:
    """A text whose name ends in .csv, in whatever encoding, so that it is told what to do with it:
    without zeros, but for UTF-16.
    """
    text = is_text(head) or is_utf16(head) or b"\0" not in head
    return path.suffix.lower() == ".csv" and text


def open_csv(path: str, raw: bytes, mapping: str | Path | None = None) -> "Log":
    """The table with its mapping file: the one that is given, or the one beside it."""
    from gateway.ingest.csv.log import CsvLog

    return CsvLog.from_bytes(raw, path, mapping)


FORMAT = LogFormat("a .csv table", (".csv",), recognises, open_csv)
