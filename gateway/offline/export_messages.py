"""Chosen messages of a log as a .tlog, byte for byte, or as an MCAP for players.

At most so many a second are kept of each. A .tlog holds each frame behind its time of receipt
(8 bytes, big-endian Unix µs). An MCAP holds chosen messages of a recording, or a log packed with
its motion: that of the aligned trial, as the topic `measured`, smoothed, with all data before and
after each moment.
"""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from gateway.errors import BadInput
from gateway.ingest.csv.log import CsvLog
from gateway.ingest.log import Log
from gateway.ingest.mavlink.frames import MAGIC_2, definitions, ids_by_name
from gateway.ingest.mavlink.log import MavlinkLog
from gateway.ingest.mcap.log import FOLDER, enclosure_of_file
from gateway.json_rows import encode_rows
from gateway.offline.export_table import not_in
from gateway.offline.trials import TrialOptions, trials_of
from gateway.recording.blocks import Block
from gateway.recording.foxglove import PlayerRows
from gateway.recording.reader import Integers, RawFrames, Recording, copy_messages
from gateway.recording.recorder import RAW, RecordingFile
from gateway.recording.writer import Compression
from gateway.shadow.topic_rows import MOTION_FIELDS

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


CHUNK_BYTES = 2 * 1024 * 1024
SHOWN_HZ = 10.0  # of what players draw


def copied_recording(
    recording: Recording,
    stream: IO[bytes],
    names: Collection[str],
    rate_hz: float | None,
    system: int | None,
) -> int:
    """Chosen topics and messages of a recording, at most so many a second -> how many."""
    writer = Writer(stream, compression=CompressionType.ZSTD)
    writer.start(profile="")
    for name, entries in recording.metadata.items():
        writer.add_metadata(name, dict(entries))
    for item in recording.attachments.values():
        if not (names and item.name.startswith(FOLDER)):  # the log itself holds all messages
            writer.add_attachment(0, 0, item.name, item.media_type, item.data)
    present = recording.counts()
    messages = {name for name in names if name not in present}
    unknown = sorted(messages - set(ids_by_name())) or (
        sorted(messages) if RAW not in present else []
    )
    if unknown:
        raise not_in(recording.path, unknown[0], sorted(present))
    wanted = {ids_by_name()[name] for name in messages}
    return copy_messages(recording, writer, _Choice(set(names), wanted, rate_hz, system))


class _Choice:
    """Which messages of a block are copied; remembers what went before, for the rate."""

    def __init__(
        self, topics: set[str], messages: set[int], rate_hz: float | None, system: int | None
    ) -> None:
        self._topics, self._messages = topics, messages
        self._rate_hz, self._system = rate_hz, system
        self._last: dict[tuple[int, ...], int] = {}

    def __call__(self, block: Block) -> NDArray[np.bool_]:
        topic_of = {number: channel.topic for number, channel in block.channels.items()}
        everything = not self._topics
        numbers = [n for n, topic in topic_of.items() if everything or topic in self._topics]
        keep = np.isin(block.channel, numbers)
        raw = np.isin(block.channel, [n for n, topic in topic_of.items() if topic == RAW])
        keys = np.full((len(keep), 4), -1, np.int64)
        keys[:, 0] = block.channel
        keys[raw, 1:] = message_keys(block.data, block.start[raw], block.end[raw])
        keep |= raw & np.isin(keys[:, 3], list(self._messages))
        if self._system is not None:
            keep &= ~raw | (keys[:, 1] == self._system)
        if self._rate_hz is not None:
            rows = np.flatnonzero(keep)
            rows = rows[thinned(keys[rows], block.log_time_ns[rows], self._rate_hz)]
            keep[:] = False
            keep[rows[self._new(keys[rows], block.log_time_ns[rows])]] = True
        return keep

    def _new(self, keys: NDArray[np.int64], time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(K,): the first of its key in its time step, blocks before this one counted."""
        assert self._rate_hz is not None
        step = max(round(1e9 / self._rate_hz), 1)
        new = np.ones(len(keys), np.bool_)
        for k, (key, at) in enumerate(zip(keys.tolist(), (time_ns // step).tolist(), strict=True)):
            new[k] = self._last.get(tuple(key)) != at
            self._last[tuple(key)] = at
        return new


def packed_log(
    log: Log,
    stream: IO[bytes],
    messages: Collection[str],
    rate_hz: float | None,
    system: int | None,
    mapping: Path | None,
    anyway: bool,
) -> tuple[int, tuple[str, ...]]:
    """A log as an MCAP -> number of messages, and what could not be shown, a sentence each."""
    file = RecordingFile(stream, Compression.ZSTD, CHUNK_BYTES)
    if isinstance(log, MavlinkLog):
        frames = frames_of(log)
        absent = sorted(set(messages) - set(names_in(frames)))
        if absent:
            raise BadInput(f"{log.path}: no {absent[0]} in it")
        chosen = chosen_frames(frames, messages, rate_hz, system)
        file.start((), {})
        times = chosen.receive_time_ns
        file.write(file.raw(""), times, times, chosen.frames())
        count = len(chosen)
    elif messages or rate_hz is not None:
        raise BadInput(
            f"{log.path}: a {log.kind} log goes whole into an MCAP: without --topic and --rate, or "
            "with --to csv or parquet"
        )
    else:
        beside = isinstance(log, CsvLog) and log.mapping.path != log.path and log.mapping.path
        file.start(enclosure_of_file(Path(log.path), Path(beside) if beside else mapping), {})
        count = 0
    notes: tuple[str, ...] = ()
    if not messages:
        shown, notes = _write_motion(file, log, system, anyway)
        count += shown
    file.complete()
    return count, notes


def _write_motion(
    file: RecordingFile, log: Log, system: int | None, anyway: bool
) -> tuple[int, tuple[str, ...]]:
    """The aligned trials as `measured` -> rows; a sentence where there are none."""
    options = TrialOptions(system=system, motion_only=True, anyway=anyway)
    try:
        trials = trials_of(log, options)
    except BadInput as error:
        return 0, (f"without its motion: {error}",)
    count, players = 0, PlayerRows(SHOWN_HZ)
    for trial in trials:
        times = trial.start_time_ns + np.round(trial.time * 1e9).astype(np.int64)
        motion = np.concatenate([trial.eta, trial.nu, trial.nu_dot], axis=1)
        values = np.hstack([motion[:, MOTION_FIELDS], trial.std()[:, MOTION_FIELDS]])
        rows = encode_rows("measured", times, times, values, {"source": "measured"})
        stamps = rows.receive_time_ns
        file.write(file.topic("measured"), stamps, stamps, rows.payloads)
        count += len(rows)
        for shown in players.of(rows):
            at = stamps[shown.rows]
            file.write(file.well_known(shown.channel), at, at, shown.payloads)
            count += len(shown.payloads)
    return count, ()
