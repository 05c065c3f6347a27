"""A recorder behind a queue on a thread of its own: recording never delays the loop.

Raw frames and ticks are kept longest; derived topics go first when the disk is slow, they can be
computed again. What went wrong on the disk is told to the loop, which runs on without recording.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from gateway.errors import ShadowError
from gateway.json_rows import TopicRows
from gateway.recording.foxglove import RowThinning
from gateway.recording.recorder import Recorder, thinned

WRITE_S = 0.25  # so often what came is written; a flush follows each half second
AT_ONCE = 2000  # items written before the disk is looked after again
FINISH_S = 10.0  # a disk that takes longer to finish is left behind
DERIVED_LIMIT = 20_000  # messages waiting beyond which derived topics are dropped
RAW_LIMIT = 200_000  # … beyond which raw frames are: minutes of a busy link


class Raw(NamedTuple):
    """Frames of one link, byte for byte, each with its receipt."""

    link: str
    receive_time_ns: list[int]
    frames: list[bytes]


Item = Raw | TopicRows


class RecordingThread:
    """Owns a recorder. Everything put before `__exit__` is written.

    The thread looks into the queue at intervals: to wake it with each message would make the loop
    share the interpreter with it just when the next datagram may come.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._thinning = RowThinning(recorder.settings.topics_hz)
        self._queue: deque[Item] = deque()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._put = self._refused = 0  # messages; counted by the loop …
        self._done = self._lost = 0  # … and by the thread
        self._moved_s = time.monotonic()  # when the thread last did something
        self.failure: str | None = None

    def __enter__(self) -> Self:
        self._recorder.__enter__()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._end.set()
        self._thread.join(FINISH_S)
        if self._thread.is_alive():
            self.failure = f"the disk did not finish the recording within {FINISH_S:.0f} s"

    def leave(self) -> None:
        """End without waiting: what failed is not written to any more."""
        self._end.set()

    @property
    def stuck_s(self) -> float:
        """For how long the disk has kept the thread waiting [s]."""
        return time.monotonic() - self._moved_s

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files so far, in order."""
        return self._recorder.paths

    @property
    def backlog(self) -> int:
        """Messages that wait to be written."""
        return self._put - self._done

    @property
    def drops(self) -> int:
        """Messages that were not and will not be written."""
        return self._refused + self._lost

    def raw(self, link: str, receive_time_ns: int, frames: Sequence[bytes]) -> None:
        """Frames of one datagram, byte for byte."""
        times = [receive_time_ns] * len(frames)
        self._offer(Raw(link, times, list(frames)), RAW_LIMIT)

    def rows(self, rows: Sequence[TopicRows]) -> None:
        """Messages of topics. Those that are thinned are so here: most need not change threads."""
        for part in rows:
            kept = thinned(part, self._recorder.settings, self._thinning)
            if kept is not None:
                self._offer(kept, DERIVED_LIMIT)

    def _offer(self, item: Item, limit: int) -> None:
        size = _size(item)
        if self.failure is None and self.backlog + size <= limit:
            self._put += size
            self._queue.append(item)
        else:
            self._refused += size

    def _run(self) -> None:
        """Write until the end; after a failure only count."""
        ended = False
        while not ended:
            ended = self._end.wait(WRITE_S)
            while self._queue:
                count = min(len(self._queue), AT_ONCE)
                for item in merged([self._queue.popleft() for _ in range(count)]):
                    self._lost += 0 if self._guarded(self._write, item) else _size(item)
                    self._done += _size(item)
                    self._moved_s = time.monotonic()
            self._guarded(self._recorder.finish if ended else self._recorder.flush_if_due)
            self._moved_s = time.monotonic()

    def _write(self, item: Item) -> None:
        if isinstance(item, TopicRows):
            self._recorder.write_thinned(item)
        else:
            self._recorder.write_raw(item.frames, item.receive_time_ns, link=item.link)

    def _guarded(self, work: Callable[..., object], *given: object) -> bool:
        """Whether it was done: nothing is any more once something has failed."""
        if self.failure is None:
            try:
                work(*given)
            except ShadowError as error:
                self.failure = str(error)
            except Exception as error:  # a defect here must not take the shadow with it
                self.failure = f"the recorder failed: {error!r}"
        return self.failure is None


def merged(items: Iterable[Item]) -> Iterator[Item]:
    """The same messages in fewer calls: raw frames in their order first, then topic by topic."""
    raws, topics = list[Raw](), dict[str, list[TopicRows]]()
    for item in items:
        if isinstance(item, TopicRows):
            topics.setdefault(item.topic, []).append(item)
        else:
            raws.append(item)
    for link, parts in groupby(raws, lambda raw: raw.link):
        together = list(parts)
        yield Raw(
            link,
            [time for part in together for time in part.receive_time_ns],
            [frame for part in together for frame in part.frames],
        )
    yield from map(TopicRows.joined, topics.values())


def _size(item: Item) -> int:
    return len(item) if isinstance(item, TopicRows) else len(item.frames)
