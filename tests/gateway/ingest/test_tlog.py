"""The .tlog reader against pymavlink, on real logs and on random damaged ones."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.ingest.mavlink.frames import definitions, layout
from gateway.ingest.mavlink.log import MAX_STEPS, Frames, MavlinkLog, tlog_from_bytes
from gateway.ingest.open import open_log
from tests.gateway.ingest.streams import (
    START_US,
    frames_of,
    packer,
    record,
    streams,
    unknown_frame,
)

REAL = (
    "odd-logs/bluerov.tlog",
    "odd-logs/cut-inside-a-frame.tlog",
    "odd-logs/mavlink1-cut-tail.tlog",
    "odd-logs/mixed-mavlink-1-and-2-one-signed.tlog",
    "odd-logs/three-sessions-zero-holes-clock-back.tlog",
    "odd-logs/zero-tail.tlog",
    "sitl/boat_radio.tlog",
)
LONG = ("sitl/boat_calm.tlog", "sitl/boat_gps.tlog", "sitl/otter_calm.tlog")
RANDOM = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)


def heartbeat(mav: Any, status: int = 4) -> bytes:
    """A heartbeat; the packer counts on."""
    frame = bytes(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, status, 3).pack(mav))
    mav.seq = (mav.seq + 1) % 256
    return frame


def tlog(*frames: bytes) -> bytes:
    """Frames received 1 ms apart."""
    return b"".join(record(frame, START_US + 1000 * k) for k, frame in enumerate(frames))


def peer_messages(path: Path) -> dict[str, list[Any]]:
    """What pymavlink reads, by name."""
    found = defaultdict(list)
    link = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while (m := link.recv_match()) is not None:
        if m.get_type() != "BAD_DATA" and not m.get_type().startswith("UNKNOWN"):
            found[m.get_type()].append(m)
    link.close()
    return found


def assert_same(column: np.ndarray, values: list[Any]) -> None:
    """One column against what pymavlink holds in that field."""
    if column.dtype.kind == "S":
        assert [v.decode("ascii", errors="replace") for v in column.tolist()] == values
    else:
        np.testing.assert_array_equal(column, np.array(values, column.dtype))


def assert_agrees(log: MavlinkLog, peer: dict[str, list[Any]]) -> None:
    """Every field, time and address of every message."""
    assert dict(log.counts()) == {name: len(found) for name, found in peer.items()}
    for name, found in peer.items():
        table = log.table(name)
        for field in found[0].get_fieldnames():
            assert_same(table.columns[field], [getattr(m, field) for m in found])
        assert table.system.tolist() == [m.get_srcSystem() for m in found]
        assert table.component.tolist() == [m.get_srcComponent() for m in found]
        stamps = [round(m._timestamp * 1e6) * 1000 for m in found]
        assert table.receive_time_ns.tolist() == stamps


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if "radio" in n else ()) for n in REAL]
)
def test_every_field_agrees_with_pymavlink(shared_data: Path, name: str) -> None:
    assert_agrees(open_log(shared_data / name), peer_messages(shared_data / name))


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_every_field_of_long_logs_agrees_with_pymavlink(shared_data: Path, name: str) -> None:
    assert_agrees(open_log(shared_data / name), peer_messages(shared_data / name))


@pytest.mark.parametrize("name", [n for n in REAL if n.startswith("odd-logs")])
def test_counts_agree_with_the_facts(shared_data: Path, name: str) -> None:
    facts = json.loads((shared_data / "odd-logs/facts.json").read_text())[Path(name).name]
    walk, log = facts["frame_walk"], open_log(shared_data / name)
    found, frames = log.statistics, log.frames
    assert found.size_bytes == walk["size"]
    assert found.bad_checksum == walk["badcrc"]
    assert found.junk_bytes == walk["junk"]
    assert found.unknown_messages == walk["unknown"]
    assert found.signed == walk["signed"]
    assert found.time_backwards == walk["time_backwards"]
    assert found.truncated_tail == bool(walk["truncated_tail"])
    assert frames.receive_time_ns[0] == round(walk["t0"] * 1e6) * 1000
    # the facts count a frame's version and source before they check it: we count what we accept
    assert found.mavlink1 + found.mavlink2 + found.bad_checksum == walk["v1"] + walk["v2"]
    assert found.accepted + found.bad_checksum == sum(walk["sysids"].values())
    sources = set(
        zip(frames.headers.system.tolist(), frames.headers.component.tolist(), strict=True)
    )
    assert {f"{system}/{component}" for system, component in sources} == set(walk["sysids"])
    peer = {k: v for k, v in facts["pymavlink_counts"].items() if k != "BAD_DATA"}
    assert dict(log.counts()) == peer


def test_bogus_frames_of_the_radio_log_are_survived(shared_data: Path) -> None:
    found = open_log(shared_data / "sitl/boat_radio.tlog").statistics
    assert (found.unknown_messages, found.accepted) == (58, 48_851 - 58)


@RANDOM
@given(streams())
def test_every_whole_frame_of_a_damaged_stream_is_found(stream: tuple[bytes, list[bytes]]) -> None:
    raw, expected = stream
    frames = Frames.from_records(raw)
    assert [frames.raw(i) for i in range(len(frames))] == expected
    assert sum(frames.counts().values()) == len(expected)
    assert frames.statistics.signed == sum(f[0] == 0xFD and f[2] & 1 for f in expected)
    assert frames.statistics.mavlink1 == sum(f[0] == 0xFE for f in expected)


@RANDOM
@given(streams())
def test_random_messages_agree_with_pymavlink(stream: tuple[bytes, list[bytes]]) -> None:
    _, raw = stream
    log, peer = frames_of(raw, range(len(raw))), defaultdict(list)
    for frame in raw:
        m = dialect.MAVLink(None).decode(bytearray(frame))
        peer[m.get_type()].append(m)
    for name, found in peer.items():
        for field in found[0].get_fieldnames():
            assert_same(log.table(name).columns[field], [getattr(m, field) for m in found])


@RANDOM
@given(
    st.binary(max_size=400)
    | st.lists(st.sampled_from([0, 0, 0, 5, 0xFD, 0xFE, 1, 255]), max_size=400).map(bytes)
)
def test_arbitrary_bytes_are_accounted_for(raw: bytes) -> None:
    frames = Frames.from_records(raw)
    found = frames.statistics
    assert 0 <= found.junk_bytes <= len(raw)
    records = int(frames.headers.length.sum()) + 8 * len(frames)
    refused = found.bad_checksum + found.unknown_messages
    if not found.truncated_tail and not refused:
        assert records + found.junk_bytes == len(raw)


def test_layouts_are_pymavlinks() -> None:
    for number, definition in definitions().items():
        plan = layout(number)
        assert plan.dtype.itemsize == definition.unpacker.size
        assert set(plan.fields) == set(plan.dtype.names)


def test_frames_keep_their_bytes_and_their_order() -> None:
    mav = packer()
    sent = [heartbeat(mav), unknown_frame(), heartbeat(mav), heartbeat(mav)[:-1] + b"x"]
    frames = frames_of(sent, [30, 10, 20, 40])
    assert [frames.raw(i) for i in range(len(frames))] == [sent[0], sent[2]]
    assert frames.receive_time_ns.tolist() == [30, 20]
    assert frames.statistics.unknown_messages == 1
    assert frames.statistics.bad_checksum == 1
    assert frames.statistics.time_backwards == 1


def test_a_message_that_never_came_has_an_empty_table() -> None:
    log = tlog_from_bytes(tlog(heartbeat(packer())))
    assert len(log.table("ATTITUDE")) == 0
    assert log.table("ATTITUDE").columns["yaw"].shape == (0,)
    assert log.table("NO_SUCH_MESSAGE").columns == {}


def test_columns_are_read_only_and_read_once() -> None:
    log = tlog_from_bytes(tlog(heartbeat(packer())))
    table = log.table("HEARTBEAT")
    assert log.table("HEARTBEAT") is table
    with pytest.raises(ValueError, match="read-only"):
        table.columns["type"][0] = 1


def test_a_wrong_length_hides_no_good_frame() -> None:
    mav = packer()
    first, second, third = (bytearray(heartbeat(mav)) for _ in range(3))
    first[1] += 8 + len(second)  # as if it reached to the start of the third record
    frames = Frames.from_records(tlog(first, second, third))
    assert [frames.raw(i) for i in range(len(frames))] == [bytes(second), bytes(third)]
    assert frames.statistics.bad_checksum == 1


def test_frames_with_flags_that_nobody_knows_are_not_decoded() -> None:
    mav = packer()
    frame = bytearray(heartbeat(mav))
    frame[2] |= 0x02
    crc = dialect.x25crc(bytes(frame[1:-2]) + bytes([dialect.MAVLink_heartbeat_message.crc_extra]))
    frame[-2:] = crc.crc.to_bytes(2, "little")
    found = Frames.from_records(tlog(bytes(frame), heartbeat(mav))).statistics
    assert (found.accepted, found.unknown_messages, found.bad_checksum) == (1, 1, 0)


def test_lost_frames_are_counted_over_the_wrap_and_by_source() -> None:
    one, other = packer(1), packer(2)
    one.seq, other.seq = 250, 10
    sent = []
    for k in range(20):
        frame = heartbeat(one)
        sent += [] if k in (3, 8, 9) else [frame]
        sent.append(heartbeat(other))
    found = tlog_from_bytes(tlog(*sent)).statistics
    assert (found.lost, found.duplicates) == (3, 0)


def newer(frame: bytes) -> bytes:
    """The frame under the number of a message that is not defined here: its checksum is unknown."""
    return frame[:7] + (400_000).to_bytes(3, "little") + frame[10:]


def test_a_frame_of_a_message_without_a_definition_is_not_lost() -> None:
    mav = packer()
    sent = [newer(heartbeat(mav)) if k % 4 == 1 else heartbeat(mav) for k in range(20)]
    del sent[11]
    whole = tlog(*sent)
    found = tlog_from_bytes(whole).statistics
    assert (found.accepted, found.unknown_messages, found.lost) == (14, 5, 1)
    ends = np.cumsum([8 + len(frame) for frame in sent])
    starts = ends - [len(frame) for frame in sent]
    of_recording = Frames.from_buffer(whole, starts, ends, np.arange(len(sent))).statistics
    assert of_recording == found


def test_numbers_of_a_ground_station_whose_frames_are_passed_on_tell_of_no_loss() -> None:
    boat, ground = packer(1), packer(255)
    sent = []
    for _ in range(20):
        station = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(ground)
        ground.seq = (ground.seq + 31) % 256
        sent += [heartbeat(boat), station]
    del sent[10]
    assert tlog_from_bytes(tlog(*sent)).statistics.lost == 1


def test_a_doubled_frame_is_no_loss() -> None:
    mav = packer()
    sent = [heartbeat(mav) for _ in range(5)]
    found = tlog_from_bytes(tlog(*sent[:3], sent[2], *sent[3:])).statistics
    assert (found.lost, found.duplicates) == (0, 1)


def test_a_late_frame_is_late_and_not_lost() -> None:
    mav = packer()
    sent = [heartbeat(mav) for _ in range(8)]
    found = tlog_from_bytes(tlog(*sent[:2], sent[3], sent[2], *sent[4:])).statistics
    assert (found.lost, found.duplicates) == (0, 0)
    assert found.notes == ("1 frame came after a later one of its source",)


def test_numbers_that_never_change_tell_of_nothing() -> None:
    """Of a writer that packs each frame anew; another source beside it counts as ever."""
    one, other = packer(1), packer(2)
    sent = []
    for k in range(20):
        one.seq = 0
        frame = heartbeat(other)
        sent += [heartbeat(one, 3 + k % 2), *([] if k == 8 else [frame])]
    found = tlog_from_bytes(tlog(*sent)).statistics
    assert (found.lost, found.duplicates) == (1, 0)
    assert found.notes == (
        "20 frames of sources whose sequence numbers never change: whether any were lost or late "
        "is not known",
    )


@pytest.mark.parametrize(("back", "lost"), [(31, 0), (32, 224)])
def test_a_frame_32_numbers_back_is_no_late_one(back: int, lost: int) -> None:
    """Numbers run modulo 256: what is not late is ahead, over a loss of all between."""
    mav = packer()
    sent = [heartbeat(mav) for _ in range(50)]
    late = 49 - back  # 49 would be the next, this one comes in its place
    found = tlog_from_bytes(tlog(*sent[:late], *sent[late + 1 : 49], sent[late])).statistics
    assert found.lost == (lost + 1 if lost else 0)


def test_the_receive_clock_may_step_back() -> None:
    mav = packer()
    times = [START_US, START_US + 5, START_US - 60_000_000, START_US - 59_000_000]
    raw = b"".join(record(heartbeat(mav), t) for t in times)
    log = tlog_from_bytes(raw)
    assert log.statistics.time_backwards == 1
    assert log.table("HEARTBEAT").receive_time_ns.tolist() == [t * 1000 for t in times]


SECONDS = 300  # of one frame a second


def stamped(frames: list[bytes], seconds: list[int]) -> MavlinkLog:
    pairs = zip(frames, seconds, strict=True)
    return tlog_from_bytes(b"".join(record(frame, START_US + 10**6 * s) for frame, s in pairs))


def test_a_file_in_disorder_is_read_in_the_order_of_its_stamps() -> None:
    mav = packer()
    sent = [heartbeat(mav) for _ in range(SECONDS)]
    order = np.random.default_rng(3).permutation(SECONDS).tolist()
    log = stamped([sent[k] for k in order], [k // 3 for k in order])  # three share a stamp
    assert [log.frames.raw(i) for i in range(SECONDS)] == sent
    assert (np.diff(log.frames.receive_time_ns) >= 0).all()
    assert log.statistics.lost == 0
    assert log.statistics.time_backwards > SECONDS // 3
    (note,) = log.statistics.notes
    assert note.startswith("its frames are in disorder: their time stamps go back ")


def test_frames_that_are_in_order_stay_so_however_often_the_clock_was_set_back() -> None:
    mav = packer()
    sent = [heartbeat(mav) for _ in range(SECONDS)]
    times = np.random.default_rng(3).permutation(SECONDS).tolist()
    log = stamped(sent, times)
    assert [log.frames.raw(i) for i in range(SECONDS)] == sent
    (note,) = log.statistics.notes
    assert note.startswith("the receiver's clock was set back ")


@pytest.mark.parametrize(("steps", "sorts"), [(MAX_STEPS, False), (MAX_STEPS + 1, True)])
def test_a_few_steps_of_the_clock_change_nothing(steps: int, sorts: bool) -> None:
    """Parts of a voyage in the wrong order, as `cat` of its files may put them."""
    mav, each = packer(), 4
    sent = [heartbeat(mav) for _ in range(each * (steps + 1))]
    order = [each * p + k for p in reversed(range(steps + 1)) for k in range(each)]
    log = stamped([sent[k] for k in order], order)
    wanted = range(len(sent)) if sorts else order
    assert [log.frames.raw(i) for i in range(len(sent))] == [sent[k] for k in wanted]
    assert bool(log.statistics.notes and "disorder" in log.statistics.notes[0]) is sorts


def test_a_cut_tail_is_told() -> None:
    mav = packer()
    raw = tlog(heartbeat(mav), heartbeat(mav))
    found = tlog_from_bytes(raw[:-4]).statistics
    assert (found.accepted, found.truncated_tail, found.junk_bytes) == (1, True, 0)
    assert not tlog_from_bytes(raw).statistics.truncated_tail


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is empty"),
        (b"time,speed\n1,2\n" * 40, "is a text file"),
        (bytes(5000), "nothing but zeros"),
        (heartbeat(packer()) * 30, "is MAVLink without time stamps"),
        (b"PK\x03\x04" + bytes(range(256)), "a zip archive"),
        (bytes(range(256)) * 4, "unknown binary data"),
    ],
)
def test_what_is_no_log_gets_one_clear_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "voyage.tlog"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=says) as raised:
        open_log(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_folder_and_a_missing_file_get_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="is a directory"):
        open_log(tmp_path)
    with pytest.raises(BadInput, match="no such file"):
        open_log(tmp_path / "nothing.tlog")


def test_content_decides_and_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "voyage.dat"
    path.write_bytes(tlog(heartbeat(packer())))
    assert open_log(path).kind == "tlog"
