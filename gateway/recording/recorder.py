"""One MCAP file being written: its channels, and nothing about when to flush, rotate or stop.

Writes a voyage to MCAP: raw frames byte for byte, topics, what players know of both. Topics that
the frames give again are thinned, unless all are asked for: every message at 50 Hz takes six times
the room of the frames.

Live, the file has its final name from the start and is flushed each half second, so that a killed
gateway loses no more and what cannot be repeated is kept. A replay can be repeated: it is written
under another name and takes its own only when it is whole.

One thread uses a recorder. Hand over blocks of ten seconds at most, all topics in turn:
rotation, flushing and the disk guard act between calls, and chunks of a player's file should not
overlap by more than that.
"""

import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple, Self

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.errors import ShadowError
from gateway.files import check_output, note_output
from gateway.json_rows import TopicRows
from gateway.recording import foxglove
from gateway.recording.foxglove import PlayerRows, RowThinning
from gateway.recording.writer import BlockWriter, Compression, Payloads
from gateway.topics import topic_of

RAW = "mavlink/raw"
LINK = "link"
TICK_LINK = "tick"  # its frames are empty: moments at which the loop ran without telemetry
JSON = "json"
JSON_SCHEMA = "jsonschema"


class Attachment(NamedTuple):
    """A file that travels inside a recording."""

    name: str
    media_type: str
    data: bytes


class RecordingFile:
    """An MCAP file with the gateway's channels, registered as they are first used."""

    def __init__(self, stream: IO[bytes], compression: Compression, chunk_bytes: int) -> None:
        self._stream = stream
        self._writer = BlockWriter(stream, compression, chunk_bytes)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}

    def start(
        self, attachments: Iterable[Attachment], metadata: Mapping[str, Mapping[str, str]]
    ) -> None:
        """Write what a reader wants to know before the first message."""
        self._writer.start()
        for name, entries in metadata.items():
            self._writer.add_metadata(name, entries)
        for item in attachments:
            self._writer.add_attachment(item.name, item.media_type, item.data)
        self._writer.flush()

    def write(
        self,
        channel: int,
        log_time_ns: NDArray[np.int64],
        publish_time_ns: NDArray[np.int64],
        payloads: Sequence[bytes] | Payloads,
    ) -> None:
        """Append messages to one channel; a time below 0 is written as 0."""
        times = np.maximum(log_time_ns, 0), np.maximum(publish_time_ns, 0)
        self._writer.add_messages(channel, *times, payloads)

    def topic(self, name: str) -> int:
        """The channel of a topic of the tables."""
        found = self._channels.get((name, ""))
        if found is None:
            entry = topic_of(name)
            found = self._json(name, entry.schema, orjson.dumps(entry.json_schema()))
        return found

    def well_known(self, channel: foxglove.Channel) -> int:
        """The channel of a message that players know."""
        found = self._channels.get((channel.topic, ""))
        if found is None:
            text = foxglove.schema_text(channel.schema)
            found = self._json(channel.topic, channel.schema, text)
        return found

    def raw(self, link: str) -> int:
        """The channel of the frames of one link."""
        found = self._channels.get((RAW, link))
        if found is None:
            name, text = foxglove.TICK_SCHEMA if link == TICK_LINK else foxglove.FRAME_SCHEMA
            schema = self._schema(name, foxglove.FRAME_SCHEMA_ENCODING, text)
            about = {LINK: link, **foxglove.FRAME_METADATA}
            found = self._writer.register_channel(RAW, foxglove.FRAME_ENCODING, schema, about)
            self._channels[RAW, link] = found
        return found

    def _json(self, topic: str, schema: str, text: bytes) -> int:
        number = self._schema(schema, JSON_SCHEMA, text)
        found = self._channels[topic, ""] = self._writer.register_channel(topic, JSON, number)
        return found

    def _schema(self, name: str, encoding: str, text: bytes) -> int:
        """The schema of that name, written when it is first used."""
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, encoding, text)
        return self._schemas[name]

    def size(self) -> int:
        """Bytes written so far, those of the open chunk left out."""
        return self._stream.tell()

    def flush(self) -> None:
        """Close the open chunk and hand everything to the operating system."""
        self._writer.flush()

    def complete(self) -> None:
        """Write the index that makes the file whole."""
        self._writer.finish()

    def finish(self) -> None:
        """Write the index that makes the file whole, and close it."""
        self.complete()
        self._stream.close()


Times = NDArray[np.int64] | Sequence[int]
MEGABYTE = 1_000_000


class TopicsKept(Enum):
    """What is recorded of topics that the raw frames and the vessel file give again.

    all      every message as it was published
    thinned  some, rounded: enough to look at
    none     frames, events, health and the estimates made once a second alone
    """

    ALL = "all"
    THINNED = "thinned"
    NONE = "none"


@dataclass(frozen=True)
class RecordingSettings:
    """How to record; `rotate_…` of 0 means never."""

    compression: Compression = Compression.ZSTD
    chunk_bytes: int = 2 * 1024 * 1024
    flush_seconds: float = 0.5
    rotate_bytes: int = 2_000 * MEGABYTE
    rotate_seconds: float = 0.0
    minimum_free_bytes: int = 200 * MEGABYTE
    foxglove_hz: float = 10.0
    topics: TopicsKept = TopicsKept.THINNED
    topics_hz: float = 2.0  # rows a second of each topic that is thinned


def thinned(
    rows: TopicRows, settings: RecordingSettings, thinning: RowThinning
) -> TopicRows | None:
    """The messages that are recorded: what the frames give again is thinned. None: there are none.

    Live, nearly all rows come one by one and are left out: nothing is made for those.
    """
    count = len(rows)
    if not count:
        return None
    if settings.topics is TopicsKept.ALL or not topic_of(rows.topic).derived:
        return rows
    if settings.topics is TopicsKept.NONE:
        return None
    kept = thinning.of(rows.topic, rows.receive_time_ns)
    if not kept:
        return None
    return rows if len(kept) == count else rows.chosen(kept)


def open_new(path: Path) -> IO[bytes]:
    """A new file, or one that replaces its namesake, for writing."""
    return path.open("wb", buffering=1024 * 1024)


def free_bytes(path: Path) -> int:
    """Room left on the disk that holds `path`."""
    return shutil.disk_usage(path.parent).free


class Recorder:
    """Records into `path`, and into `name-2.mcap`, `name-3.mcap` … after each rotation.

    Leaving the `with` block finishes the recording; leaving it by an exception abandons a replay
    and finishes a live recording as far as that goes.
    """

    def __init__(
        self,
        path: Path,
        *,
        attachments: Sequence[Attachment] = (),
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        settings: RecordingSettings | None = None,
        live: bool = False,
        clock: Callable[[], float] = time.monotonic,
        opener: Callable[[Path], IO[bytes]] = open_new,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        self.settings = settings or RecordingSettings()
        self.paths: tuple[Path, ...] = ()
        self._first = path
        self._attachments = tuple(attachments)
        self._metadata = dict(metadata or {})
        self._live = live
        self._clock, self._opener, self._free = clock, opener, free
        self._stream: IO[bytes] | None = None
        self._file: RecordingFile | None = None
        self._flushed = clock()
        self._checked_bytes = 0
        self._started_ns: int | None = None
        self._rotation_due = False
        self._begin_thinning()

    def __enter__(self) -> Self:
        try:
            self._open()
        except BaseException:  # also whoever interrupts while the first bytes are written
            self.abandon()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        if error is None:
            try:
                self.finish()
            except BaseException:
                if not self._live:
                    self.abandon()
                raise
        elif self._live:
            with suppress(ShadowError):
                self.finish()
        else:
            self.abandon()

    def write_rows(self, rows: TopicRows) -> None:
        """Record messages of one topic, and what players make of them."""
        kept = thinned(rows, self.settings, self._thinning)
        if kept is not None:
            self.write_thinned(kept)

    def write_thinned(self, rows: TopicRows) -> None:
        """The same for messages that `thinned` has chosen before, one at least."""
        if self.settings.topics is not TopicsKept.ALL and topic_of(rows.topic).derived:
            rows = rows.rounded()
        self._rotate_if_due()
        with self._writing() as file:
            log, publish = rows.receive_time_ns, rows.vehicle_time_ns
            file.write(file.topic(rows.topic), log, publish, rows.payloads)
            for shown in self._players.of(rows):
                times = log[shown.rows], publish[shown.rows]
                file.write(file.well_known(shown.channel), *times, shown.payloads)
        self._housekeeping(int(rows.receive_time_ns[0]), int(rows.receive_time_ns[-1]))

    def write_raw(
        self,
        frames: Sequence[bytes] | Payloads,
        receive_time_ns: Times,
        vehicle_time_ns: Times | None = None,
        link: str = "",
    ) -> None:
        """Record frames of one link as they came; where no boat time is known, receipt stands."""
        log_times = np.asarray(receive_time_ns, np.int64)
        if not len(log_times):
            return
        self._rotate_if_due()
        with self._writing() as file:
            known = log_times if vehicle_time_ns is None else np.asarray(vehicle_time_ns, np.int64)
            file.write(file.raw(link), log_times, known, frames)
        self._housekeeping(int(log_times[0]), int(log_times[-1]))

    def flush_if_due(self) -> None:
        """Flush a live recording where half a second has passed: for times without messages."""
        if self._live and self._clock() - self._flushed >= self.settings.flush_seconds:
            with self._writing() as file:
                file.flush()
            self._flushed = self._clock()
            self._guard_disk(self.paths[-1])

    def finish(self) -> tuple[Path, ...]:
        """Make the recording whole and close it -> the files, in order."""
        self._close_file()
        if not self._live:
            with self._disk():
                for path in self.paths:
                    _part(path).replace(path)
                    note_output(path)
        return self.paths

    def abandon(self) -> None:
        """Close and remove what was written: it must not be mistaken for a whole recording."""
        self._drop_stream()
        for path in self.paths:
            (path if self._live else _part(path)).unlink(missing_ok=True)
        self.paths = ()

    def _housekeeping(self, first_ns: int, last_ns: int) -> None:
        """What may be due after a block: flush, disk guard, rotation before the next."""
        self.flush_if_due()
        if self._started_ns is None:
            self._started_ns = first_ns
        size = self._size()
        if size - self._checked_bytes > 16 * MEGABYTE:
            self._checked_bytes = size
            self._guard_disk(self.paths[-1])
        age = (last_ns - self._started_ns) * 1e-9
        by_size = 0 < self.settings.rotate_bytes <= size
        self._rotation_due = by_size or 0 < self.settings.rotate_seconds <= age

    def _rotate_if_due(self) -> None:
        """Go on in a new file; not before there is something to write, so that none is empty."""
        if self._rotation_due and self._file:
            self._close_file()
            self._open()

    def _guard_disk(self, path: Path) -> None:
        """Stop while there is still room to make the file whole."""
        with self._disk():
            free = self._free(path)
        if free < self.settings.minimum_free_bytes:
            self._close_file()
            raise ShadowError(
                f"{path}: not recording, only {free / MEGABYTE:.0f} MB left on the disk and "
                f"{self.settings.minimum_free_bytes / MEGABYTE:.0f} MB are kept free: make room "
                "or record elsewhere"
            )

    def _open(self) -> None:
        path = self._first
        if self.paths:
            path = path.with_name(f"{path.stem}-{len(self.paths) + 1}{path.suffix}")
        if self._live and path.exists():
            raise ShadowError(f"{path}: there is a recording already: choose another name")
        if not self._live:
            check_output(path)
        with self._disk():
            path.parent.mkdir(parents=True, exist_ok=True)
        self._guard_disk(path)
        self.paths += (path,)
        with self._disk():
            self._stream = self._opener(path if self._live else _part(path))
            self._file = RecordingFile(
                self._stream, self.settings.compression, self.settings.chunk_bytes
            )
            self._file.start(self._attachments, self._metadata)
        self._checked_bytes, self._started_ns, self._rotation_due = 0, None, False
        self._begin_thinning()

    def _begin_thinning(self) -> None:
        self._thinning = RowThinning(self.settings.topics_hz)
        self._players = PlayerRows(self.settings.foxglove_hz)

    def _size(self) -> int:
        return self._file.size() if self._file else 0

    def _close_file(self) -> None:
        if self._file:
            with self._writing() as file:
                file.finish()
            self._file = self._stream = None

    def _drop_stream(self) -> None:
        """Let go of the file as it is; a full disk may refuse even the last buffer."""
        if self._stream:
            with suppress(OSError):
                self._stream.close()
        self._file = self._stream = None

    @contextmanager
    def _writing(self) -> Iterator[RecordingFile]:
        if self._file is None:
            raise ShadowError(f"{self._first}: the recording is closed")
        with self._disk():
            yield self._file

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """Turn what the operating system refuses into one clear line, and let go of the file."""
        try:
            yield
        except OSError as error:
            path = self.paths[-1] if self.paths else self._first
            self._drop_stream()
            reason = error.strerror or str(error)
            raise ShadowError(
                f"{path}: cannot record: {reason}: make room there or choose another place"
            ) from error


def _part(path: Path) -> Path:
    """Where a replay writes until it is whole."""
    return path.with_name(path.name + ".part")
