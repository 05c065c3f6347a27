"""MCAP recordings as logs: the gateway's own, and those of the BlueOS recorder.

Of its own the gateway reads the raw frames, or the log that they enclose.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.errors import BadInput
from gateway.ingest.format import LogFormat

if TYPE_CHECKING:
    from gateway.ingest.log import Log, Statistics
    from gateway.ingest.mavlink.log import Frames
    from gateway.recording.reader import Recording

MAGIC = b"\x89MCAP0\r\n"


def recognises(head: bytes, path: Path) -> bool:
    """An MCAP file begins with its magic bytes."""
    return head.startswith(MAGIC)


def open_mcap(path: str | Path, raw: bytes = b"", mapping: str | Path | None = None) -> "Log":
    """All frames of a recording in order of handling, or the log that it encloses.

    BadInput where it holds neither.
    """
    from gateway.ingest.mavlink.log import Frames, MavlinkLog
    from gateway.ingest.mcap.blueos import is_blueos
    from gateway.ingest.mcap.enclosed import open_enclosed
    from gateway.recording.reader import Recording

    recording = Recording.open(Path(path))
    rows = recording.raw()
    filled = rows.end > rows.start  # a tick of a live recording is an empty frame
    if not filled.any():
        if is_blueos(recording):
            return _blueos_log(recording)
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
    return MavlinkLog(str(path), frames, _statistics(recording, frames), "mcap", recording)


def _blueos_log(recording: "Recording") -> "Log":
    """A recording of the BlueOS recorder; BadInput where none of its messages can be read."""
    from gateway.ingest.mavlink.log import MavlinkLog
    from gateway.ingest.mcap.blueos import blueos_frames

    frames, unreadable = blueos_frames(recording)
    if not len(frames):
        raise BadInput(f"{recording.path}: none of its MAVLink messages can be read")
    found = _statistics(recording, frames)
    notes = [*found.notes, "messages were recorded as JSON (BlueOS): frames are made from them"]
    if unreadable:
        notes.append(f"{unreadable} message(s) cannot be read: they are left out")
    statistics = replace(found, notes=tuple(notes))
    return MavlinkLog(str(recording.path), frames, statistics, "mcap of BlueOS")


def _statistics(recording: "Recording", frames: "Frames") -> "Statistics":
    """What was found in the frames, and that the file was not finished."""
    notes = frames.statistics.notes
    if not recording.finished:
        notes += ("the recording was not finished: `shadow repair` makes it whole",)
    return replace(
        frames.statistics,
        size_bytes=recording.path.stat().st_size,
        truncated_tail=not recording.finished,
        notes=notes,
    )


FORMAT = LogFormat("an MCAP recording", (".mcap",), recognises, open_mcap)
