"""The MAVLink frames of a log, byte for byte: chosen messages, at most so many a second.

A .tlog holds each frame behind its time of receipt (8 bytes, big-endian Unix µs).
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.log import Log
from gateway.ingest.mavlink.definitions import definitions, ids_by_name
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.ingest.mavlink.walk import MAGIC_2
from gateway.recording.reader import Integers, RawFrames

SHORTEST = 8  # bytes of a frame of MAVLink 1 without payload


def frames_of(log: Log) -> RawFrames:
    """All accepted frames of a log in order of receipt; BadInput where it has none."""
    if not isinstance(log, MavlinkLog):
        raise BadInput(
            f"{log.path}: a {log.kind} log holds no MAVLink frames: export it with --to csv, "
            "parquet or mcap"
        )
    h, receive = log.frames.headers, log.frames.receive_time_ns
    start, end = h.offset, h.offset + h.length
    found = RawFrames(log.frames.data.tobytes(), start, end, receive, receive, 0 * start, ("",))
    return found if log.recording is None else _as_recorded(found, log.recording.raw())


def _as_recorded(accepted: RawFrames, recorded: RawFrames) -> RawFrames:
    """The accepted frames of a recording, with the boat's times and the links that it knows."""
    filled = np.flatnonzero(recorded.end > recorded.start)
    place = filled[np.searchsorted(recorded.start[filled], accepted.start)]
    return replace(
        accepted,
        vehicle_time_ns=recorded.vehicle_time_ns[place],
        link=recorded.link[place],
        links=recorded.links,
    )


def message_keys(data: bytes, start: Integers, end: Integers) -> Integers:
    """System, component and message id of each frame data[start:end]: (K, 3); −1: no frame."""
    raw = np.frombuffer(data, np.uint8)
    if not len(raw):
        return np.empty((0, 3), np.int64)

    def byte(offset: int) -> Integers:
        return raw[np.minimum(start + offset, len(raw) - 1)].astype(np.int64)

    second = byte(0) == MAGIC_2
    wide = byte(7) | byte(8) << 8 | byte(9) << 16
    keys = np.column_stack(
        [np.where(second, byte(5), byte(3)), np.where(second, byte(6), byte(4)),
         np.where(second, wide, byte(5))]
    )  # fmt: skip
    keys[end - start < SHORTEST] = -1
    return keys


def chosen_frames(
    frames: RawFrames, messages: Collection[str], rate_hz: float | None, system: int | None
) -> RawFrames:
    """Frames of these messages (of all where none is named) and of that system, thinned."""
    keys = message_keys(frames.data, frames.start, frames.end)
    keep = np.ones(len(frames), np.bool_)
    if messages:
        keep &= np.isin(keys[:, 2], [ids_by_name()[name] for name in messages])
    if system is not None:
        keep &= keys[:, 0] == system
    rows = np.flatnonzero(keep)
    if rate_hz is not None:
        rows = rows[thinned(keys[rows], frames.receive_time_ns[rows], rate_hz)]
    return replace(
        frames,
        start=frames.start[rows],
        end=frames.end[rows],
        receive_time_ns=frames.receive_time_ns[rows],
        vehicle_time_ns=frames.vehicle_time_ns[rows],
        link=frames.link[rows],
    )


def names_in(frames: RawFrames) -> list[str]:
    """Names of the messages among some frames."""
    known = definitions()
    ids = np.unique(message_keys(frames.data, frames.start, frames.end)[:, 2]).tolist()
    return sorted(known[number].msgname for number in ids if number in known)


def thinned(keys: Integers, time_ns: Integers, rate_hz: float) -> NDArray[np.intp]:
    """Keys (K, n), times (K,) -> rows that are the first of their key in each 1/rate."""
    if not len(keys):
        return np.empty(0, np.intp)
    step = max(round(1e9 / rate_hz), 1)
    marked = np.column_stack([keys, time_ns // step])
    return np.sort(np.unique(marked, axis=0, return_index=True)[1])


def tlog_bytes(frames: RawFrames) -> bytes:
    """Frames as a .tlog."""
    stamps = (frames.receive_time_ns // 1000).astype(">u8").tobytes()
    return b"".join(
        part
        for k, frame in enumerate(frames.frames())
        for part in (stamps[8 * k : 8 * k + 8], frame)
    )
