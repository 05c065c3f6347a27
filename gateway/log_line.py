"""Lines that a long-running command prints: text for people, JSON for programs (`--log json`).

A line is a string, so that whoever only prints needs to know no more; its level, kind and vessel
are those of the event that it tells.
"""

import sys
from datetime import UTC, datetime
from enum import StrEnum
from typing import Self

import orjson

from gateway.errors import one_line


class LogFormat(StrEnum):
    """How lines are printed."""

    TEXT = "text"
    JSON = "json"


class LogLine(str):
    """A line with what programs want to know of it; kind and vessel empty where there is none."""

    level: str
    kind: str
    vessel: str

    def __new__(cls, text: str, level: str = "info", kind: str = "", vessel: str = "") -> Self:
        line = super().__new__(cls, text)
        line.level, line.kind, line.vessel = level, kind, vessel
        return line


def print_line(text: str, form: LogFormat = LogFormat.TEXT) -> None:
    """Print on standard error: text, or one JSON object of time, level, kind, vessel, message."""
    shown = one_line(text)
    if form is LogFormat.JSON:
        line = text if isinstance(text, LogLine) else LogLine(text)
        now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        shown = orjson.dumps({
            "time": now, "level": line.level, "kind": line.kind, "vessel": line.vessel,
            "message": shown,
        }).decode()  # fmt: skip
    print(shown, file=sys.stderr, flush=True)
