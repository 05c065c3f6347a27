"""Recording on a thread of its own: in order, bounded, and never in the loop's way."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from gateway.errors import ShadowError
from gateway.json_rows import TopicRows
from gateway.recording import thread as thread_module
from gateway.recording.reader import Recording
from gateway.recording.recorder import TICK_LINK, Recorder, RecordingSettings, TopicsKept, open_new
from gateway.recording.thread import Raw, RecordingThread, merged
from tests.gateway.voyages import event, rows_of

START = 1_700_000_000_000_000_000
SETTINGS = RecordingSettings(minimum_free_bytes=1, topics=TopicsKept.ALL)


def recorder(path: Path, **more: Any) -> Recorder:
    return Recorder(path, settings=SETTINGS, live=True, **more)


def row(k: int) -> TopicRows:
    """The k-th message of a topic."""
    rows = rows_of("control", 1)
    time_ns = np.array([START + k])
    return TopicRows(
        "control", time_ns, time_ns, [rows.payloads[0].replace(b"0", str(k % 10).encode())]
    )


def test_what_was_put_is_written_in_order(tmp_path: Path) -> None:
    with RecordingThread(recorder(tmp_path / "a.mcap")) as thread:
        for k in range(3000):
            thread.raw(f"link{k % 3 // 2}", START + k, [b"%d" % k, b"x"][: 1 + k % 2])
            thread.rows([row(k), row(k)])
            if k % 10 == 0:
                thread.raw(TICK_LINK, START + k, (b"",))
    assert (thread.backlog, thread.drops, thread.failure) == (0, 0, None)
    recording = Recording.open(tmp_path / "a.mcap")
    assert recording.finished
    raw = recording.raw()
    frames = [frame for frame in raw.frames() if frame not in (b"x", b"")]
    assert frames == [b"%d" % k for k in range(3000)]
    names = [raw.links[link] for link in raw.link.tolist()]
    assert names.count(TICK_LINK) == 300
    assert np.array_equal(raw.receive_time_ns, np.sort(raw.receive_time_ns))
    times = np.concatenate([rows.receive_time_ns for rows in recording.rows("control")])
    assert times.tolist() == [START + k for k in range(3000) for _ in range(2)]


def test_merging_keeps_every_message_and_the_order_of_frames_over_links() -> None:
    items = [
        Raw("a", [1], [b"1"]), row(1), Raw("a", [2], [b"2"]), Raw(TICK_LINK, [3], [b""]),
        event(), row(2), Raw("a", [4], [b"4"]), row(3),
    ]  # fmt: skip
    together = list(merged(items))
    raws = [item for item in together if isinstance(item, Raw)]
    assert raws == [
        Raw("a", [1, 2], [b"1", b"2"]), Raw(TICK_LINK, [3], [b""]), Raw("a", [4], [b"4"]),
    ]  # fmt: skip
    topics = {item.topic: item for item in together if isinstance(item, TopicRows)}
    assert topics["control"].receive_time_ns.tolist() == [START + k for k in (1, 2, 3)]
    assert len(topics["event"].payloads) == 1


class Stuck:
    """A file on a disk that hangs until it is let go."""

    def __init__(self, stream: IO[bytes], go: threading.Event) -> None:
        self._stream, self._go = stream, go

    def write(self, data: Any) -> int:
        self._go.wait()
        return self._stream.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@pytest.fixture
def go() -> Iterator[threading.Event]:
    """Lets a disk go on; set at the latest when the test is over."""
    event = threading.Event()
    event.set()
    yield event
    event.set()


def stuck(path: Path, go: threading.Event) -> Recorder:
    """A recorder whose disk hangs while `go` is cleared."""
    return recorder(path, opener=lambda where: Stuck(open_new(where), go))


def test_a_disk_that_hangs_delays_nobody_and_nothing_is_lost(
    tmp_path: Path, go: threading.Event
) -> None:
    with RecordingThread(stuck(tmp_path / "a.mcap", go)) as thread:
        go.clear()
        for k in range(5000):
            thread.raw("a", START + k, [b"frame"])
            thread.rows([row(k)])
        time.sleep(0.7)  # … past the first flush, that hangs
        thread.raw("a", START, [b"last"])
        assert thread.backlog > 0
        assert thread.drops == 0
        go.set()
    assert Recording.open(tmp_path / "a.mcap").counts()["mavlink/raw"] == 5001


def test_derived_topics_go_first_and_drops_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread_module, "DERIVED_LIMIT", 100)
    monkeypatch.setattr(thread_module, "RAW_LIMIT", 200)
    monkeypatch.setattr(thread_module, "WRITE_S", 60.0)
    with RecordingThread(recorder(tmp_path / "a.mcap")) as thread:
        for k in range(150):
            thread.rows([row(k)])
        assert (thread.backlog, thread.drops) == (100, 50)
        for k in range(150):
            thread.raw("a", START + k, [b"frame"])
        assert (thread.backlog, thread.drops) == (200, 100)
    counts = Recording.open(tmp_path / "a.mcap").counts()
    assert (counts["mavlink/raw"], counts["control"]) == (100, 100)
    assert (thread.backlog, thread.drops) == (0, 100)


@pytest.mark.parametrize("error", [ShadowError("the disk is full"), ValueError("a defect")])
def test_after_a_failure_it_only_counts(
    tmp_path: Path, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread_module, "WRITE_S", 0.001)
    broken = recorder(tmp_path / "a.mcap")

    def fail(*_: Any) -> None:
        raise error

    monkeypatch.setattr(broken, "write_thinned", fail)
    with RecordingThread(broken) as thread:
        thread.rows([row(1), row(2)])
        end = time.monotonic() + 10.0
        while thread.failure is None and time.monotonic() < end:
            time.sleep(0.001)
        thread.rows([row(3)])
        thread.raw("a", START, [b"frame"])
    assert thread.failure is not None
    assert str(error) in thread.failure
    assert (thread.backlog, thread.drops) == (0, 4)


def test_what_waited_for_a_disk_that_then_fails_is_counted_as_lost(
    tmp_path: Path, go: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread_module, "WRITE_S", 0.001)
    monkeypatch.setattr(thread_module, "AT_ONCE", 10)
    reached, streams = threading.Event(), list[IO[bytes]]()

    def kept(where: Path) -> IO[bytes]:
        streams.append(open_new(where))
        return streams[-1]

    broken = recorder(tmp_path / "a.mcap", opener=kept)

    def fail(*_: Any, **__: Any) -> None:
        reached.set()
        go.wait()
        raise ShadowError("the disk is full")

    monkeypatch.setattr(broken, "write_raw", fail)
    with RecordingThread(broken) as thread:
        go.clear()
        thread.raw("a", START, [b"first"])
        assert reached.wait(10.0)
        for k in range(100):
            thread.raw("a", START + k, [b"frame"])
        assert (thread.backlog, thread.drops) == (101, 0)
        go.set()
    streams[0].close()
    assert thread.failure == "the disk is full"
    assert (thread.backlog, thread.drops) == (0, 101)


def test_a_disk_that_never_finishes_is_left_behind(
    tmp_path: Path, go: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread_module, "FINISH_S", 0.2)
    with RecordingThread(stuck(tmp_path / "a.mcap", go)) as thread:
        go.clear()
        thread.raw("a", START, [b"frame"])
    assert thread.failure is not None
    assert "did not finish" in thread.failure
    go.set()
    thread._thread.join()


def test_what_nobody_encoded_is_joined_without_being_encoded() -> None:
    parts = [rows_of("measured", 2, first=k) for k in range(3)]
    (joined,) = merged(parts)
    assert isinstance(joined, TopicRows)
    assert [part._payloads for part in (joined, *parts)] == [None] * 4
    assert len(joined) == 6
    assert joined.payloads == [payload for part in parts for payload in part.payloads]
    (again,) = merged(parts)  # encoded by now, for a subscriber
    assert isinstance(again, TopicRows)
    assert again._payloads == joined.payloads
    assert again.rounded().payloads == joined.rounded().payloads
    mixed = TopicRows.joined([parts[0], rows_of("measured", 1, first=7)])
    assert len(mixed.payloads) == 3


def test_a_thinned_topic_is_encoded_where_it_is_kept_alone(tmp_path: Path) -> None:
    settings = RecordingSettings(minimum_free_bytes=1)
    parts = [rows_of("measured", 100, first=k) for k in (0, 100)]
    with RecordingThread(Recorder(tmp_path / "a.mcap", settings=settings, live=True)) as thread:
        thread.rows(parts)
    assert [part._payloads for part in parts] == [None, None]
    kept = Recording.open(tmp_path / "a.mcap").counts()["measured"]
    assert 0 < kept < 100


def test_what_is_thinned_does_not_wait_for_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread_module, "WRITE_S", 60.0)
    settings = RecordingSettings(minimum_free_bytes=1)
    with RecordingThread(Recorder(tmp_path / "a.mcap", settings=settings, live=True)) as thread:
        for k in range(100):
            thread.rows([rows_of("measured", 1, first=k)])
        kept = thread.backlog
    assert 0 < kept < 20
    assert Recording.open(tmp_path / "a.mcap").counts()["measured"] == kept
