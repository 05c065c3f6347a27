"""Telemetry logs (.tlog): MAVLink frames, each behind the time of its receipt."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gateway.errors import BadInput
from gateway.ingest.files import looks_like, read_bytes
from gateway.ingest.log import Statistics, Table
from gateway.ingest.mavlink.definitions import checksum_seeds
from gateway.ingest.mavlink.frames import Frames
from gateway.ingest.mavlink.walk import GOOD, checksum_table, examine


@dataclass
class TlogFile:
    """An opened .tlog: its accepted frames."""

    path: str
    frames: Frames
    kind: str = "tlog"

    @classmethod
    def open(cls, path: str | Path) -> "TlogFile":
        """Reads a file to its end."""
        return cls.from_bytes(read_bytes(path), str(path))

    @classmethod
    def from_bytes(cls, raw: bytes, path: str = "tlog") -> "TlogFile":
        """The same from bytes in memory; `path` names them in messages."""
        if _unstamped(raw):
            raise BadInput(
                f"{path} is MAVLink without time stamps: a .tlog has one before each frame"
            )
        frames = Frames.from_records(raw)
        if not len(frames):
            raise BadInput(
                f"{path} holds no MAVLink frame with a time stamp: it looks like {looks_like(raw)}"
            )
        return cls(path, frames)

    @property
    def statistics(self) -> Statistics:
        """What was found while reading."""
        return self.frames.statistics

    def counts(self) -> Mapping[str, int]:
        """Message name -> number of accepted messages."""
        return self.frames.counts()

    def table(self, name: str) -> Table:
        """All messages of that name (an empty table where there is none)."""
        return self.frames.table(name)


def _unstamped(raw: bytes) -> bool:
    """Do two good frames stand at the start without a time stamp?"""
    data, at = np.frombuffer(raw, np.uint8), 0
    for _ in range(2):
        verdict, length = examine(data, at, len(data), checksum_seeds(), checksum_table())
        if verdict != GOOD:
            return False
        at += int(length)
    return True
