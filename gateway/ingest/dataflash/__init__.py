"""DataFlash logs (.BIN): what an ArduPilot autopilot wrote on board."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import SAMPLE, LogFormat

if TYPE_CHECKING:
    from gateway.ingest.log import Log

MAGIC = b"\xa3\x95"
FMT_RECORD = MAGIC + b"\x80"  # behind junk, this is how a DataFlash log begins


def recognises(head: bytes, path: Path) -> bool:
    """A DataFlash log begins with a message, or holds a first FMT record near its start."""
    return head.startswith(MAGIC) or FMT_RECORD in head[:SAMPLE]


def open_dataflash(path: str, raw: bytes, mapping: str | Path | None = None) -> "Log":
    """The messages of a DataFlash log."""
    from gateway.ingest.dataflash.log import DataflashLog

    return DataflashLog.from_bytes(raw, path)


FORMAT = LogFormat("a DataFlash .BIN", (".bin",), recognises, open_dataflash, mapped=False)
