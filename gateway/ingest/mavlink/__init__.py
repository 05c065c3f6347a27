"""Telemetry logs (.tlog), and what all sources of MAVLink share: frames, definitions, rules."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import LogFormat, is_text

if TYPE_CHECKING:
    from gateway.ingest.log import Log


def recognises(head: bytes, path: Path) -> bool:
    """Anything but text: frames are found wherever they stand, behind junk too."""
    return not is_text(head)


def open_tlog(path: str, raw: bytes, mapping: str | Path | None = None) -> "Log":
    """The frames of a telemetry log."""
    from gateway.ingest.mavlink.log import tlog_from_bytes

    return tlog_from_bytes(raw, path)


FORMAT = LogFormat("a .tlog", (".tlog",), recognises, open_tlog, mapped=False)
