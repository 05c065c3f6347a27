"""The gateway's own MCAP recordings as logs: their raw frames, or the log that they enclose."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.errors import BadInput
from gateway.ingest.format import LogFormat

if TYPE_CHECKING:
    from gateway.ingest.log import Log

MAGIC = b"\x89MCAP0\r\n"


def recognises(head: bytes, path: Path) -> bool:
    """An MCAP file begins with its magic bytes."""
    return head.startswith(MAGIC)


def open_mcap(path: str | Path, raw: bytes = b"", mapping: str | Path | None = None) -> "Log":
    """All frames of a recording in order of handling, or the log that it encloses.

    BadInput where it holds neither.
    """
    from gateway.ingest.mavlink.log import Frames, MavlinkLog
    from gateway.ingest.mcap.enclosed import open_enclosed
    from gateway.recording.reader import Recording

    recording = Recording.open(Path(path))
    rows = recording.raw()
    filled = rows.end > rows.start  # a tick of a live recording is an empty frame
    if not filled.any():
        enclosed = open_enclosed(recording, mapping)
        if enclosed is not None:
            return enclosed
        raise BadInput(
            f"{path}: holds no MAVLink frames and encloses no log: give a recording of a voyage "
            "(`shadow simulate --log` writes one)"
        )
    frames = Frames.from_buffer(
        rows.data, rows.start[filled], rows.end[filled], rows.receive_time_ns[filled]
    )
    notes = frames.statistics.notes
    if not recording.finished:
        notes += ("the recording was not finished: `shadow repair` makes it whole",)
    statistics = replace(
        frames.statistics,
        size_bytes=recording.path.stat().st_size,
        truncated_tail=not recording.finished,
        notes=notes,
    )
    return MavlinkLog(str(path), frames, statistics, "mcap", recording)


FORMAT = LogFormat("an MCAP recording", (".mcap",), recognises, open_mcap)
