"""MCAP recordings as logs: the gateway's own, and those of the BlueOS recorder."""

from pathlib import Path
from typing import TYPE_CHECKING

from gateway.ingest import LogFormat

if TYPE_CHECKING:
    from gateway.ingest.log import Log

MAGIC = b"\x89MCAP0\r\n"


def recognises(head: bytes, path: Path) -> bool:
    """An MCAP file begins with its magic bytes."""
    return head.startswith(MAGIC)


def open_mcap(path: str | Path, raw: bytes = b"", mapping: str | Path | None = None) -> "Log":
    """All frames of a recording in order of handling, or the log that it encloses."""
    from gateway.ingest.mcap.log import mcap_log

    return mcap_log(path, mapping)


FORMAT = LogFormat("an MCAP recording", (".mcap",), recognises, open_mcap)
