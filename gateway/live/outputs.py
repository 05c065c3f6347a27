"""Outputs of one boat: zenoh, its recording, players; each may be absent."""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from gateway.bus import Bus
from gateway.config import Settings, as_tables
from gateway.errors import BadInput, ShadowError
from gateway.json_rows import TopicRows
from gateway.links.inbox import Datagram
from gateway.live.boats import BoatPlan, LiveBoat
from gateway.recording.foxglove_server import BoatView
from gateway.recording.recorder import Recorder
from gateway.recording.thread import RecordingThread
from gateway.shadow.topic_rows import attachments_of, metadata_of

MAX_EARLY, MAX_EARLY_BYTES = 60_000, 64_000_000  # datagrams that came before any boat was known


STUCK_S = 3.0  # without a write, though the thread writes ten times a second
FIRST_RETRY_S, LAST_RETRY_S = 2.0, 120.0  # from a failed recording to the next
PROOF_S = 1.5  # that the next one must last to be told
LASTED_S = 60.0  # after which a failure is another matter


@dataclass
class BoatOutputs:
    """Publishes and records; a recording that fails is reported once and leaves the rest alone."""

    bus: Bus | None = None
    recording: RecordingThread | None = None
    view: BoatView | None = None  # for Foxglove and its kin
    failure: str | None = None  # of a recording that could not begin
    retry_s: float | None = None  # when recording is tried again, after a failure
    failures: int = 0  # in a row
    _reported: bool = False
    _begun_s: float = 0.0  # when the recording began that followed one that failed
    _earlier_drops: int = 0  # of recordings that failed
    _stuck: bool = False

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
        now = self.recording.drops if self.recording is not None else 0
        return self._earlier_drops + now

    def wants_retry(self, now_s: float) -> bool:
        """Is it time to begin another recording, after one that failed?"""
        failed = self.failure or (self.recording is not None and self.recording.failure)
        if not failed:
            return False
        if self.retry_s is None:
            if now_s - self._begun_s > LASTED_S:
                self.failures = 0
            self.retry_s = now_s + min(FIRST_RETRY_S * 2.0**self.failures, LAST_RETRY_S)
        return now_s >= self.retry_s

    def record_with(self, recording: RecordingThread, now_s: float) -> None:
        """Another recording instead of one that failed."""
        if self.recording is not None:
            self._earlier_drops += self.recording.drops
            self.recording.leave()
        self.recording, self.failure, self.retry_s = recording, None, None
        self.failures += 1
        self._begun_s = now_s

    def new_recovery(self, now_s: float) -> str | None:
        """Where it is recorded again, once that has lasted for a moment."""
        recording = self.recording
        if not self._reported or recording is None or recording.failure or self.failure:
            return None
        if now_s - self._begun_s < PROOF_S:
            return None
        self._reported = False
        return f"recording again: {recording.paths[-1]}"

    def new_stall(self) -> str | None:
        """That the disk does not take anything any more, or does so again, once each."""
        if self.recording is None or self.recording.failure is not None:
            return None
        stuck_s = self.recording.stuck_s
        if stuck_s > STUCK_S and not self._stuck:
            self._stuck = True
            return f"the disk has taken nothing for {stuck_s:.0f} s: what comes waits in memory"
        if stuck_s <= STUCK_S and self._stuck:
            self._stuck = False
            return "the disk takes what is recorded again"
        return None

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


def make_folder(folder: Path) -> None:
    """BadInput at the start rather than when the first boat is found."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(
            f"--out {folder}: cannot record there: {error.strerror}: choose another folder"
        ) from None


def start_recording(
    boat: LiveBoat, plan: BoatPlan, folder: Path, settings: Settings, scope: ExitStack
) -> RecordingThread:
    """A recording of that boat, open until `scope` closes; ShadowError where it cannot begin."""
    path = unused_path(folder, f"{boat.name}-{datetime.now(UTC):%Y%m%d-%H%M%S}")
    recorder = Recorder(
        path,
        attachments=attachments_of(plan.vessel, plan.plant, as_tables(settings)),
        metadata=metadata_of(boat.name, boat.boat, plant=plan.plant, live=True),
        settings=settings.recording,
        live=True,
    )
    try:
        return scope.enter_context(RecordingThread(recorder))
    except ShadowError:
        with suppress(OSError):
            path.unlink(missing_ok=True)  # nothing but an empty beginning
        raise


def unused_path(folder: Path, stem: str) -> Path:
    """A path in the folder that no recording has, nor any part of one that rotates."""
    for number in range(1, 1000):
        path = folder / (f"{stem}.mcap" if number == 1 else f"{stem}_{number}.mcap")
        if not path.exists():
            return path
    raise ShadowError(f"{folder / stem}.mcap: there are too many of that name")


def _bytes(datagram: Datagram) -> int:
    return sum(len(frame.raw) for frame in datagram.frames)
