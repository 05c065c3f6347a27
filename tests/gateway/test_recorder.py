"""What is recorded is what came, readable by the mcap library's own reader; no half files."""

import errno
import io
import json
import math
import stat
from collections import defaultdict
from pathlib import Path
from typing import IO, Any

import numpy as np
import orjson
import pytest
from mcap.reader import make_reader

from gateway.errors import ShadowError
from gateway.json_rows import DECIMALS, TopicRows
from gateway.recording import foxglove
from gateway.recording.reader import Recording
from gateway.recording.recorder import TICK_LINK, Recorder, RecordingSettings, TopicsKept
from gateway.recording.writer import Compression, Payloads
from gateway.topics import TOPICS, FieldType
from tests.gateway.json_schema import validator_of
from tests.gateway.voyages import (
    LATE,
    METADATA,
    START,
    VESSEL,
    event,
    frames_of,
    record,
    rows_of,
    times,
)


def plenty(_: Path) -> int:
    return 10**12


def messages(path: Path) -> dict[str, list[tuple[Any, Any]]]:
    """Topic -> (schema, message) by the library's own reader."""
    found = defaultdict(list)
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            found[channel.topic].append((schema, message))
    return found


@pytest.mark.parametrize("compression", Compression)
def test_raw_frames_come_out_byte_for_byte_with_both_clocks(
    tmp_path: Path, compression: Compression
) -> None:
    (path,) = record(tmp_path / "a.mcap", settings=RecordingSettings(compression=compression))
    found = [message for _, message in messages(path)["mavlink/raw"]]
    assert [message.data for message in found] == frames_of(100)
    assert [message.publish_time for message in found] == times(100).tolist()
    assert [message.log_time for message in found] == (times(100) + LATE).tolist()
    assert [message.sequence for message in found] == list(range(100))


def test_every_message_is_accepted_by_the_schema_in_the_file(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap")
    checked = 0
    for topic, found in messages(path).items():
        for schema, message in found:
            if topic != "mavlink/raw":
                assert schema.encoding == "jsonschema"
                fits = validator_of(schema.data)
                assert fits.schema["title"] == schema.name
                fits.validate(json.loads(message.data))
                checked += 1
    assert checked > 400


def test_topics_are_recorded_as_they_are_published(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap")
    found = messages(path)
    rows = rows_of("measured", 100)
    assert [message.data for _, message in found["measured"]] == rows.payloads
    assert {schema.name for schema, _ in found["measured"]} == {TOPICS["measured"].schema}


def test_players_get_boat_and_shadow_ten_times_a_second_and_every_event(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap", rows=200)  # four seconds
    found = messages(path)
    counts = {topic: len(found[topic]) for topic in found if topic.startswith("foxglove/")}
    assert counts.pop("foxglove/log") == 1
    assert len(counts) == 6
    assert all(40 <= count <= 41 for count in counts.values()), counts


def test_north_of_ned_is_the_second_axis_of_the_players_world(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap", rows=1)
    found = messages(path)
    row = json.loads(found["measured"][0][1].data)
    pose = json.loads(found["foxglove/boat_pose"][0][1].data)["pose"]
    assert (pose["position"]["x"], pose["position"]["y"]) == (row["east_m"], row["north_m"])


@pytest.mark.parametrize(
    ("yaw", "forward"), [(0.0, (0.0, 1.0)), (math.pi / 2, (1.0, 0.0)), (math.pi, (0.0, -1.0))]
)
def test_the_bow_points_where_the_heading_says(yaw: float, forward: tuple[float, float]) -> None:
    row = {"receive_time_ns": START, "north_m": 0.0, "east_m": 0.0, "yaw_rad": yaw}
    q = foxglove.pose(row)["pose"]["orientation"]
    east, north = 1.0 - 2.0 * q["z"] ** 2, 2.0 * q["w"] * q["z"]  # the x axis, turned by q
    assert (east, north) == pytest.approx(forward, abs=2e-7)  # seven decimals


def test_vessel_and_versions_travel_in_the_file(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap")
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [(VESSEL.name, VESSEL.data)]
        assert {m.name: m.metadata for m in reader.iter_metadata()} == METADATA
        assert reader.get_header().profile == ""


def test_the_same_voyage_gives_the_same_bytes(tmp_path: Path) -> None:
    (a,), (b,) = record(tmp_path / "a.mcap"), record(tmp_path / "b.mcap")
    assert a.read_bytes() == b.read_bytes()


def test_links_keep_channels_of_their_own(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", free=plenty) as recorder:
        recorder.write_raw([b"one"], [1], link="udpin:a")
        recorder.write_raw([b"two"], [2], link="serial:b")
    with (tmp_path / "a.mcap").open("rb") as stream:
        links = [c.metadata["link"] for _, c, _ in make_reader(stream).iter_messages()]
    assert links == ["udpin:a", "serial:b"]


def test_rotation_by_size_gives_files_that_stand_alone(tmp_path: Path) -> None:
    settings = RecordingSettings(
        rotate_bytes=20_000,
        chunk_bytes=1000,
        compression=Compression.NONE,
        topics=TopicsKept.ALL,
    )
    with Recorder(
        tmp_path / "a.mcap", settings=settings, free=plenty, attachments=[VESSEL]
    ) as recorder:
        for block in range(10):
            recorder.write_rows(rows_of("measured", 20, first=20 * block))
    assert [path.name for path in recorder.paths][:3] == ["a.mcap", "a-2.mcap", "a-3.mcap"]
    total = 0
    for path in recorder.paths:
        total += len(messages(path)["measured"])
        with path.open("rb") as stream:
            assert len(list(make_reader(stream).iter_attachments())) == 1
    assert total == 200


def test_rotation_by_time_counts_the_time_of_receipt(tmp_path: Path) -> None:
    settings = RecordingSettings(rotate_seconds=1.0, topics=TopicsKept.ALL)
    with Recorder(tmp_path / "a.mcap", settings=settings, free=plenty) as recorder:
        for block in range(30):  # twelve seconds, in blocks of 0.4 s
            recorder.write_rows(rows_of("control", 20, first=20 * block))
    assert len(recorder.paths) == 10  # three blocks each
    assert all(messages(path)["control"] for path in recorder.paths)


def fail_midway(recorder: Recorder) -> None:
    with recorder:
        recorder.write_rows(event())
        raise ZeroDivisionError


def test_a_replay_that_fails_leaves_nothing_and_harms_no_older_file(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap")
    before = path.read_bytes()
    with pytest.raises(ZeroDivisionError):
        fail_midway(Recorder(path, free=plenty))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


class Interrupted(io.BytesIO):
    """Someone presses Ctrl-C while so many bytes are being written."""

    def __init__(self, after: int) -> None:
        super().__init__()
        self.after = after

    def write(self, data: Any, /) -> int:
        self.after -= len(data)
        if self.after < 0:
            raise KeyboardInterrupt
        return super().write(data)


@pytest.mark.parametrize("after", [0, 50, 5_000, 60_000, "the last byte"])
def test_a_replay_interrupted_anywhere_leaves_nothing(tmp_path: Path, after: int | str) -> None:
    whole = io.BytesIO()
    whole.close = lambda: None  # type: ignore[method-assign]  # its size is read afterwards
    folder = tmp_path / "whole"
    folder.mkdir()

    def opener(path: Path) -> IO[bytes]:
        path.touch()
        return whole if path.parent == folder else Interrupted(at)

    settings = RecordingSettings(chunk_bytes=1000, topics=TopicsKept.ALL)
    write_much(Recorder(folder / "a.mcap", opener=opener, free=plenty, settings=settings))
    at = len(whole.getvalue()) - 1 if isinstance(after, str) else after
    with pytest.raises(KeyboardInterrupt):
        write_much(Recorder(tmp_path / "a.mcap", opener=opener, free=plenty, settings=settings))
    assert list(tmp_path.iterdir()) == [folder]


def test_a_live_recording_is_finished_even_when_the_loop_fails(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        fail_midway(Recorder(tmp_path / "a.mcap", live=True, free=plenty))
    assert len(messages(tmp_path / "a.mcap")["event"]) == 1


def test_a_live_recording_never_overwrites_another(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap")
    before = path.read_bytes()
    with pytest.raises(ShadowError, match="there is a recording already"):
        Recorder(path, live=True, free=plenty).__enter__()
    assert path.read_bytes() == before


def test_live_flushes_by_the_clock_it_is_given(tmp_path: Path) -> None:
    now = 0.0
    path = tmp_path / "a.mcap"
    with Recorder(path, live=True, free=plenty, clock=lambda: now) as recorder:
        recorder.write_rows(event())
        empty = path.stat().st_size
        now = 0.49
        recorder.flush_if_due()
        assert path.stat().st_size == empty
        now = 0.51
        recorder.flush_if_due()
        assert path.stat().st_size > empty


class Full(io.BytesIO):
    """A disk on which only so many bytes find room."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data: Any, /) -> int:
        self.room -= len(data)
        if self.room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data)


def write_much(recorder: Recorder) -> None:
    with recorder:
        for block in range(100):
            recorder.write_rows(rows_of("measured", 20, first=20 * block))


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("room", [0, 5_000, 60_000])
def test_a_full_disk_is_one_clear_line(tmp_path: Path, room: int, live: bool) -> None:
    def opener(path: Path) -> IO[bytes]:
        path.touch()
        return Full(room)

    settings = RecordingSettings(chunk_bytes=1000, topics=TopicsKept.ALL)
    path = tmp_path / "a.mcap"
    recorder = Recorder(path, opener=opener, free=plenty, live=live, settings=settings)
    with pytest.raises(ShadowError, match="No space left on device: make room") as caught:
        write_much(recorder)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_status == 1
    if not live:
        assert list(tmp_path.iterdir()) == []


def test_the_disk_guard_stops_while_the_file_can_still_be_finished(tmp_path: Path) -> None:
    room, now = 10**12, 0.0
    path = tmp_path / "a.mcap"
    with Recorder(path, live=True, free=lambda _: room, clock=lambda: now) as recorder:
        recorder.write_rows(event())
        room, now = 1_000_000, 1.0
        with pytest.raises(ShadowError, match="only 1 MB left"):
            recorder.write_rows(event())
    assert len(messages(path)["event"]) == 2


def test_no_room_from_the_start_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ShadowError, match="not recording"):
        Recorder(tmp_path / "a.mcap", free=lambda _: 0).__enter__()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ShadowError, match="cannot record: "):
        Recorder(tmp_path / "file" / "a.mcap").__enter__()


def test_no_permission_is_one_clear_line(tmp_path: Path) -> None:
    def refused(path: Path) -> IO[bytes]:
        raise PermissionError(errno.EACCES, "Permission denied")

    with pytest.raises(ShadowError, match="cannot record: Permission denied"):
        Recorder(tmp_path / "a.mcap", opener=refused, free=plenty).__enter__()


def test_a_finished_recorder_takes_no_more(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", free=plenty) as recorder:
        recorder.write_rows(event())
    with pytest.raises(ShadowError, match="the recording is closed"):
        recorder.write_rows(event())


def test_a_boat_without_a_clock_does_not_stop_the_recording(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", free=plenty) as recorder:
        recorder.write_raw([b"frame"], [START], [-5])
    assert messages(tmp_path / "a.mcap")["mavlink/raw"][0][1].publish_time == 0


def test_recordings_are_ordinary_files(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "deep" / "down" / "a.mcap")
    assert stat.S_ISREG(path.stat().st_mode)
    assert list(path.parent.iterdir()) == [path]


def test_players_know_the_encoding_of_every_channel(tmp_path: Path) -> None:
    """As Lichtblick's and Foxglove's `parseChannel`: of other pairs they show an error."""
    known = {("json", "jsonschema"), ("ros1", "ros1msg")}
    with Recorder(tmp_path / "a.mcap", free=lambda _: 10**12) as recorder:
        recorder.write_rows(rows_of("shadow", 3))
        recorder.write_raw([b"\xfd" + bytes(11)], [1], link="udpin:a")
        recorder.write_raw([b""], [2], link=TICK_LINK)
    with (tmp_path / "a.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    found = {
        (channel.topic, channel.metadata.get("link")): (channel, summary.schemas[channel.schema_id])
        for channel in summary.channels.values()
    }
    assert {(c.message_encoding, schema.encoding) for c, schema in found.values()} == known
    frames, frame = found["mavlink/raw", "udpin:a"]
    assert frames.metadata["encoding"] == "mavlink"
    fields = [line for line in frame.data.decode().splitlines() if not line.startswith("#")]
    sizes = {"uint8": 1, "uint8[6]": 6}
    assert sum(sizes[line.split()[0]] for line in fields) == 8  # no frame is shorter
    _, tick = found["mavlink/raw", TICK_LINK]
    assert all(line.startswith(b"#") for line in tick.data.splitlines())  # an empty one fits


def test_topics_are_thinned_and_rounded_frames_are_not(tmp_path: Path) -> None:
    """Also the same from messages that were encoded before and from those that were not."""
    given = rows_of("measured", 500)  # ten seconds at 50 Hz
    spoken = TopicRows("measured", given.vehicle_time_ns, given.receive_time_ns, given.payloads)
    found = []
    for k, rows in enumerate([rows_of("measured", 500), spoken]):
        with Recorder(tmp_path / f"{k}.mcap", free=plenty) as recorder:
            recorder.write_rows(rows)
            recorder.write_rows(event())
            recorder.write_raw(frames_of(500), times(500) + LATE)
        found.append([message.data for _, message in messages(recorder.paths[0])["measured"]])
        seen = messages(recorder.paths[0])
        assert [message.data for _, message in seen["mavlink/raw"]] == frames_of(500)
        assert len(seen["event"]) == 1
        assert len(seen["foxglove/boat_pose"]) == len(found[-1])
    assert found[0] == found[1]
    step = np.diff([orjson.loads(payload)["receive_time_ns"] for payload in found[0]])
    assert (len(found[0]), np.median(step)) == (20, 5e8)  # two a second
    exact = {orjson.loads(p)["receive_time_ns"]: orjson.loads(p) for p in given.payloads}
    for payload in found[0]:
        row = orjson.loads(payload)
        whole = exact[row["receive_time_ns"]]
        assert row["north_m"] == round(whole["north_m"], 3) + 0.0
        assert row["yaw_rad"] == pytest.approx(whole["yaw_rad"], abs=0.51e-5)
        assert row["source"] == "measured"


def test_without_topics_frames_events_and_health_are_left(tmp_path: Path) -> None:
    settings = RecordingSettings(topics=TopicsKept.NONE)
    with Recorder(tmp_path / "a.mcap", settings=settings, free=plenty) as recorder:
        for topic in TOPICS:
            if TOPICS[topic].derived:
                recorder.write_rows(rows_of(topic, 5))
        recorder.write_rows(event())
        recorder.write_raw(frames_of(5), times(5))
    assert set(messages(recorder.paths[0])) == {"event", "foxglove/log", "mavlink/raw"}


def test_every_topic_that_is_thinned_can_be_rounded() -> None:
    for name, topic in TOPICS.items():
        if topic.derived:
            assert {f.unit for f in topic.fields if f.type is FieldType.NUMBER} <= DECIMALS.keys()
            assert not topic.names(FieldType.INTEGER)
            assert rows_of(name, 1).rounded().payloads != rows_of(name, 1).payloads


def test_messages_of_one_topic_stay_in_the_order_in_which_they_came(tmp_path: Path) -> None:
    """Whatever their links, their sizes and how they were packed: a replay runs in this order."""
    frames = [bytes([k]) * (50 + 40 * k) for k in range(60)]
    settings = RecordingSettings(chunk_bytes=2000)
    with Recorder(tmp_path / "a.mcap", settings=settings, free=plenty) as recorder:
        for k in range(0, 60, 4):
            recorder.write_raw(frames[k : k + 1], [k], link="a")
            recorder.write_rows(event())
            recorder.write_raw(frames[k + 1 : k + 2], [k + 1], link="b")
            packed = Payloads.of(frames[k + 2 : k + 4])
            recorder.write_raw(packed, [k + 2, k + 3], link="a")
    raw = Recording.open(recorder.paths[0]).raw()
    assert raw.frames() == frames
    assert raw.receive_time_ns.tolist() == list(range(60))
    assert [raw.links[k] for k in raw.link.tolist()] == ["a", "b", "a", "a"] * 15
    with recorder.paths[0].open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 60 + 2 * 15
    assert len(summary.chunk_indexes) > 10
