"""The gateway's own recording as a log: its raw frames, decoded like any other."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from gateway.errors import BadInput
from gateway.ingest.log import Statistics, Table
from gateway.ingest.mavlink.frames import Frames
from gateway.recording.reader import Recording


@dataclass(frozen=True)
class McapLog:
    """A recording opened for reading. `frames` holds every accepted frame in order of handling."""

    path: str
    frames: Frames
    statistics: Statistics
    kind: ClassVar[str] = "mcap"

    @classmethod
    def open(cls, path: str | Path) -> "McapLog":
        """Read all frames; raises BadInput with one line where that is not possible."""
        recording = Recording.open(Path(path))
        raw = recording.raw()
        told = raw.end > raw.start  # a tick of a live recording is an empty frame
        if not told.any():
            raise BadInput(f"{path}: holds no MAVLink frames: give a recording of a voyage")
        frames = Frames.from_buffer(
            raw.data, raw.start[told], raw.end[told], raw.receive_time_ns[told]
        )
        return cls(str(path), frames, _statistics(recording, frames.statistics))

    def counts(self) -> Mapping[str, int]:
        """Message name -> number of accepted messages."""
        return self.frames.counts()

    def table(self, name: str) -> Table:
        """All messages of that name (an empty table where there is none)."""
        return self.frames.table(name)


def _statistics(recording: Recording, found: Statistics) -> Statistics:
    """What the frames showed, with the size of the whole file and whether it was finished."""
    notes = found.notes
    if not recording.finished:
        notes += ("the recording was not finished: `shadow repair` makes it whole",)
    size = recording.path.stat().st_size
    return replace(found, size_bytes=size, truncated_tail=not recording.finished, notes=notes)
