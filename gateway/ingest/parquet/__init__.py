"""Tables as Parquet, as `shadow export --to parquet` writes them: a mapping names the columns."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import LogFormat

if TYPE_CHECKING:
    from gateway.ingest.log import Log

MAGIC = b"PAR1"


def recognises(head: bytes, path: Path) -> bool:
    """A Parquet file begins with its magic bytes."""
    return head.startswith(MAGIC)


def open_parquet(path: str, raw: bytes, mapping: str | Path | None = None) -> "Log":
    """The table with its mapping: the one given, the one inside, or the one beside it."""
    from gateway.ingest.parquet.log import parquet_log

    return parquet_log(path, raw, mapping)


FORMAT = LogFormat("a .parquet table", (".parquet",), recognises, open_parquet)
