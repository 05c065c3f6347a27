"""Pages without a server and without a browser: what they would show, as text."""

from pathlib import Path
from typing import Any

from gateway.config import StudioSettings
from gateway.monitor import MonitorOptions
from gateway.studio.live_history import LiveHistory
from gateway.studio.page import StudioContext
from gateway.studio.session import Session


def context_of(session: Session) -> StudioContext:
    """A context whose live history does not watch."""
    return StudioContext(session, LiveHistory(MonitorOptions("tcp/127.0.0.1:1")),
                         StudioSettings(), ())  # fmt: skip


def message_of(page: Any) -> str:
    """What the page says of the last thing that was done on it."""
    notice = page._notice
    return notice.text if notice is not None else ""


def write_log(folder: Path, name: str) -> Path:
    """A file that is called a recording and is none."""
    file = folder / name
    file.write_bytes(b"this is no recording")
    return file
