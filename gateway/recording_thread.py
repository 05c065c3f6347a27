"""A recorder behind a bounded queue: recording never delays the loop.

Raw frames and ticks are kept longest; derived topics go first when the disk is slow, they can be
computed again. What went wrong on the disk is told to the loop, which runs on without recording.
"""

import queue
import threading
from collections.abc import Sequence
from types import TracebackType
from typing import NamedTuple, Self

from gateway.errors import ShadowError
from gateway.messages import Rows
from gateway.recorder import Recorder
from gateway.recording import TICK_LINK

WAIT_S = 0.1  # so often what came is written; a flush follows each half second
DERIVED_LIMIT = 20_000  # messages waiting beyond which derived topics are dropped
RAW_LIMIT = 200_000  # … beyond which raw frames are: minutes of a busy link


class _Raw(NamedTuple):
    link: str
    receive_time_ns: int
    frames: tuple[bytes, ...]


class RecordingThread:
    """Owns a recorder on a thread of its own. Everything put before `__exit__` is written."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._queue: queue.SimpleQueue[_Raw | Rows | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="recorder")
        self._waiting = 0  # messages; written by the loop, read down by the thread
        self._written = 0
        self.drops = 0
        self.failure: str | None = None

    def __enter__(self) -> Self:
        self._recorder.__enter__()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._queue.put(None)
        self._thread.join()

    @property
    def backlog(self) -> int:
        """Messages that wait to be written."""
        return self._waiting - self._written

    def raw(self, link: str, receive_time_ns: int, frames: Sequence[bytes]) -> None:
        """Frames of one datagram, byte for byte."""
        if self.failure is None and self.backlog < RAW_LIMIT:
            self._waiting += len(frames)
            self._queue.put(_Raw(link, receive_time_ns, tuple(frames)))
        else:
            self.drops += len(frames)

    def tick(self, now_ns: int) -> None:
        """A moment at which the loop ran on without telemetry: part of its inputs."""
        self.raw(TICK_LINK, now_ns, (b"",))

    def rows(self, rows: Sequence[Rows]) -> None:
        """Messages of topics."""
        for part in rows:
            if self.failure is None and self.backlog < DERIVED_LIMIT:
                self._waiting += len(part.payloads)
                self._queue.put(part)
            else:
                self.drops += len(part.payloads)

    def _run(self) -> None:
        """Write until the end is put; after a failure only count."""
        going = True
        while going:
            batch, going = self._batch()
            if self.failure is None:
                try:
                    self._write(batch)
                    self._recorder.flush_if_due()
                    if not going:
                        self._recorder.finish()
                except ShadowError as error:
                    self.failure = str(error)
            self._written += sum(_size(item) for item in batch)

    def _batch(self) -> tuple[list[_Raw | Rows], bool]:
        """What came within a moment, and whether more is to come."""
        batch: list[_Raw | Rows] = []
        try:
            item = self._queue.get(timeout=WAIT_S)
            while item is not None:
                batch.append(item)
                if len(batch) >= 5000:
                    return batch, True
                item = self._queue.get_nowait()
        except queue.Empty:
            return batch, True
        return batch, False

    def _write(self, batch: list[_Raw | Rows]) -> None:
        for item in batch:
            if isinstance(item, Rows):
                self._recorder.write_rows(*item)
            else:
                times = [item.receive_time_ns] * len(item.frames)
                self._recorder.write_raw(item.frames, times, link=item.link)


def _size(item: _Raw | Rows) -> int:
    return len(item.payloads) if isinstance(item, Rows) else len(item.frames)
