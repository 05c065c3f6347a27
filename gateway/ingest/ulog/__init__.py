"""ULog (.ulg): what a PX4 autopilot wrote on board."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import LogFormat

if TYPE_CHECKING:
    from gateway.ingest.log import Log

MAGIC = b"ULog"


def recognises(head: bytes, path: Path) -> bool:
    """A ULog begins with its name."""
    return head.startswith(MAGIC)


def open_ulog(path: str, raw: bytes, mapping: str | Path | None = None) -> "Log":
    """The topics of a ULog."""
    from gateway.ingest.ulog.log import ulog_from_bytes

    return ulog_from_bytes(raw, path)


FORMAT = LogFormat("a PX4 .ulg", (".ulg",), recognises, open_ulog, mapped=False)
