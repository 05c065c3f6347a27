"""Outputs of one boat: zenoh, its recording, players; each may be absent."""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from gateway.bus import Bus
from gateway.config import Settings, as_tables
from gateway.errors import ShadowError
from gateway.json_rows import TopicRows
from gateway.links.inbox import Datagram
from gateway.live.boats import BoatPlan, LiveBoat
from gateway.recording.foxglove_server import BoatView
from gateway.recording.recorder import Recorder
from gateway.recording.thread import RecordingThread
from gateway.shadow.topic_rows import attachments_of, metadata_of

MAX_EARLY, MAX_EARLY_BYTES = 60_000, 64_000_000  # datagrams that came before any boat was known


@dataclass
class BoatOutputs:
    """Publishes and records; a recording that fails is reported once and leaves the rest alone."""

    bus: Bus | None = None
    recording: RecordingThread | None = None
    view: BoatView | None = None  # for Foxglove and its kin
    failure: str | None = None  # of a recording that could not begin
    _reported: bool = False

    def publish(self, rows: Sequence[TopicRows]) -> None:
        """To zenoh."""
        if self.bus is not None:
            for part in rows:
                for payload in part.payloads:
                    self.bus.publish(part.topic, payload)

    def record(self, rows: Sequence[TopicRows]) -> None:
        """To disk."""
        if self.recording is not None:
            self.recording.rows(rows)

    def show(self, rows: Sequence[TopicRows]) -> None:
        """To players."""
        if self.view is not None:
            self.view.show(rows)

    def send(self, rows: Sequence[TopicRows]) -> None:
        """To all of them."""
        self.publish(rows)
        self.record(rows)
        self.show(rows)

    def record_frames(self, link: str, receive_time_ns: int, frames: Sequence[bytes]) -> None:
        """Frames as they came, to disk."""
        if self.recording is not None and frames:
            self.recording.raw(link, receive_time_ns, frames)

    @property
    def backlog(self) -> int:
        """Messages that wait to be recorded."""
        return self.recording.backlog if self.recording is not None else 0

    @property
    def drops(self) -> int:
        """Messages that were not recorded though they should have been."""
        return self.recording.drops if self.recording is not None else 0

    def new_failure(self) -> str | None:
        """Why recording failed, once."""
        failure = self.failure or (self.recording.failure if self.recording is not None else None)
        if failure is None or self._reported:
            return None
        self._reported = True
        return failure


class EarlyDatagrams:
    """Datagrams from before any boat was known: kept for its recording, within bounds."""

    def __init__(self) -> None:
        self._datagrams: deque[Datagram] = deque()
        self._bytes = 0

    def add(self, datagram: Datagram) -> None:
        """Keep one; the oldest go where there is no room."""
        self._datagrams.append(datagram)
        self._bytes += _bytes(datagram)
        while len(self._datagrams) > MAX_EARLY or self._bytes > MAX_EARLY_BYTES:
            self._bytes -= _bytes(self._datagrams.popleft())

    def take_all(self) -> Iterator[Datagram]:
        """All that are kept, in order; then none."""
        while self._datagrams:
            yield self._datagrams.popleft()
        self._bytes = 0


def start_recording(
    boat: LiveBoat, plan: BoatPlan, folder: Path, settings: Settings, scope: ExitStack
) -> RecordingThread:
    """A recording of that boat, open until `scope` closes; ShadowError where it cannot begin."""
    recorder = Recorder(
        unused_path(folder, f"{boat.name}-{datetime.now(UTC):%Y%m%d-%H%M%S}"),
        attachments=attachments_of(plan.vessel, plan.plant, as_tables(settings)),
        metadata=metadata_of(boat.name, boat.boat, plant=plan.plant, live=True),
        settings=settings.recording,
        live=True,
    )
    return scope.enter_context(RecordingThread(recorder))


def unused_path(folder: Path, stem: str) -> Path:
    """A path in the folder that no recording has, nor any part of one that rotates."""
    for number in range(1, 1000):
        path = folder / (f"{stem}.mcap" if number == 1 else f"{stem}_{number}.mcap")
        if not path.exists():
            return path
    raise ShadowError(f"{folder / stem}.mcap: there are too many of that name")


def _bytes(datagram: Datagram) -> int:
    return sum(len(frame.raw) for frame in datagram.frames)
