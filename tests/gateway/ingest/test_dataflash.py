"""The DataFlash reader against pymavlink's DFReader, on real logs and on random ones."""

import contextlib
import io
import json
import math
import struct
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink import DFReader

from gateway.errors import BadInput
from gateway.ingest.dataflash.log import DataflashLog
from gateway.ingest.dataflash.records import DIVISORS, KINDS
from gateway.ingest.log import Table
from gateway.ingest.open import open_log
from gateway.ingest.survey import survey

REAL = ("odd-logs/bluerov.BIN", "odd-logs/dataflash-dropped-messages.bin")
LONG = ("sitl/boat_calm.BIN", "sitl/otter_calm.BIN")
RANDOM = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
GPS_WEEK, GPS_MS = 2300, 123_456_789


def fmt(number: int, name: str, characters: str, columns: str) -> bytes:
    """An FMT record."""
    length = 3 + sum(KINDS[c].itemsize for c in characters)
    head = struct.pack("<BBBBB", 0xA3, 0x95, 0x80, number, length)
    return head + struct.pack("4s16s64s", name.encode(), characters.encode(), columns.encode())


def entry(number: int, payload: bytes) -> bytes:
    """A message of that type."""
    return bytes([0xA3, 0x95, number]) + payload


def tick(number: int, time_us: int) -> bytes:
    """A message of format QB."""
    return entry(number, struct.pack("<QB", time_us, 7))


FMT_ITSELF = fmt(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
TICK = fmt(1, "TICK", "QB", "TimeUS,N")
GPS = fmt(2, "GPS", "QBIHL", "TimeUS,Status,GMS,GWk,Lat")


def peer_messages(path: Path) -> dict[str, list[Any]]:
    """What DFReader reads, by name."""
    found = defaultdict(list)
    with contextlib.redirect_stderr(io.StringIO()):
        log = DFReader.DFReader_binary(str(path))
        while (m := log.recv_msg()) is not None:
            found[m.get_type()].append(m)
        log.close()
    return found


def as_text(raw: bytes) -> str:
    """Text as DFReader decodes it."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("ISO-8859-1")


def assert_same(column: np.ndarray, values: list[Any]) -> None:
    """One column against what DFReader holds in that field."""
    if isinstance(values[0], bytes):  # contents of a file: numpy leaves out NULs at the end
        assert [v.ljust(column.dtype.itemsize, b"\0") for v in column.tolist()] == values
    elif column.dtype.kind == "S":
        assert [as_text(v) for v in column.tolist()] == values
    else:
        np.testing.assert_array_equal(column, np.array(values, column.dtype))


def assert_times(table: Table, peer: list[Any]) -> None:
    """Unix time, as well as a float of seconds can tell it (1 µs)."""
    expected = [m._timestamp for m in peer]
    np.testing.assert_allclose(table.receive_time_ns / 1e9, expected, rtol=0, atol=2e-6)


def assert_agrees(log: DataflashLog, peer: dict[str, list[Any]]) -> None:
    """Every field and time of every message."""
    assert dict(log.counts()) == {name: len(found) for name, found in peer.items()}
    for name, found in peer.items():
        table = log.table(name)
        assert list(table.columns) == [*found[0].get_fieldnames(), "time_us"]
        for field in found[0].get_fieldnames():
            assert_same(table.columns[field], [getattr(m, field) for m in found])
        if "TimeUS" in table.columns:
            assert_times(table, found)


@pytest.mark.parametrize("name", REAL)
def test_every_field_agrees_with_dfreader(shared_data: Path, name: str) -> None:
    assert_agrees(open_log(shared_data / name), peer_messages(shared_data / name))


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_every_field_of_long_logs_agrees_with_dfreader(shared_data: Path, name: str) -> None:
    assert_agrees(open_log(shared_data / name), peer_messages(shared_data / name))


@pytest.mark.parametrize("name", REAL)
def test_counts_agree_with_the_facts(shared_data: Path, name: str) -> None:
    facts = json.loads((shared_data / "odd-logs/facts.json").read_text())[Path(name).name]
    log = open_log(shared_data / name)
    assert dict(log.counts()) == facts["counts"]
    assert log.statistics.accepted == facts["messages"]
    assert log.statistics.size_bytes == facts["size"]
    times = np.concatenate([log.table(n).columns["time_us"] for n in log.counts()])
    assert (times.min(), times.max()) == (facts["first_TimeUS"], facts["last_TimeUS"])


def test_format_characters_are_pymavlinks() -> None:
    assert set(KINDS) == set(DFReader.FORMAT_TO_STRUCT)
    for character, (packed, multiplier, _) in DFReader.FORMAT_TO_STRUCT.items():
        assert KINDS[character].itemsize == struct.calcsize("<" + packed)
        assert (character in DIVISORS) == (multiplier is not None)
        if multiplier:
            assert math.isclose(1 / multiplier, DIVISORS[character])


@st.composite
def random_logs(draw: Any) -> bytes:
    """A log of up to four random formats, their messages shuffled."""
    kinds = draw(st.lists(st.text("".join(KINDS), min_size=1, max_size=6), min_size=1, max_size=4))
    kinds = [k for k in kinds if sum(KINDS[c].itemsize for c in k) < 240]
    raw = FMT_ITSELF + TICK + tick(1, 1000)
    for k, characters in enumerate(kinds):
        names = ",".join(f"C{i}" for i in range(len(characters)))
        raw += fmt(10 + k, f"R{k}", characters, names)
    for k in draw(st.lists(st.integers(0, len(kinds) - 1), max_size=20)) if kinds else []:
        size = sum(KINDS[c].itemsize for c in kinds[k])
        raw += entry(10 + k, draw(st.binary(min_size=size, max_size=size)))
    return raw + tick(1, 2000)


@RANDOM
@given(raw=random_logs())
def test_random_formats_agree_with_dfreader(
    tmp_path_factory: pytest.TempPathFactory, raw: bytes
) -> None:
    path = tmp_path_factory.mktemp("random") / "log.bin"
    path.write_bytes(raw)
    assert_agrees(open_log(path), peer_messages(path))


@RANDOM
@given(
    st.lists(st.integers(0, 30), max_size=3).flatmap(
        lambda sizes: st.tuples(*[st.binary(min_size=n, max_size=n) for n in sizes])
    )
)
def test_junk_between_messages_is_skipped(junk: tuple[bytes, ...]) -> None:
    junk = tuple(piece.replace(b"\xa3", b"") for piece in junk)
    raw = FMT_ITSELF + TICK + b"".join(p + tick(1, k) + tick(1, k) for k, p in enumerate(junk))
    log = DataflashLog.from_bytes(raw + tick(1, 99))
    assert log.counts()["TICK"] == 2 * len(junk) + 1
    assert log.statistics.junk_bytes == sum(map(len, junk))


def test_a_message_with_bytes_missing_is_refused() -> None:
    whole = [tick(1, 1000 * k) for k in range(6)]
    raw = FMT_ITSELF + TICK + whole[0] + whole[1] + whole[2][:-4] + b"".join(whole[3:])
    log = DataflashLog.from_bytes(raw)
    assert log.table("TICK").columns["TimeUS"].tolist() == [0, 1000, 3000, 4000, 5000]
    assert log.statistics.junk_bytes == len(whole[2]) - 4
    assert any("1 message(s) refused" in note for note in log.statistics.notes)


def test_a_cut_tail_is_told() -> None:
    raw = FMT_ITSELF + TICK + tick(1, 5) + tick(1, 6)
    found = DataflashLog.from_bytes(raw[:-3]).statistics
    assert (found.accepted, found.truncated_tail, found.junk_bytes) == (3, True, 0)
    assert not DataflashLog.from_bytes(raw).statistics.truncated_tail


def test_types_without_a_format_are_counted() -> None:
    raw = FMT_ITSELF + TICK + tick(1, 5) + entry(77, b"????") + tick(1, 6) + tick(1, 7)
    found = DataflashLog.from_bytes(raw).statistics
    assert (found.unknown_messages, found.accepted) == (1, 5)


def test_a_format_that_contradicts_itself_defines_nothing() -> None:
    wrong = bytearray(TICK)
    wrong[4] += 1
    log = DataflashLog.from_bytes(FMT_ITSELF + bytes(wrong) + TICK + tick(1, 5) + tick(1, 6))
    assert log.table("TICK").columns["TimeUS"].tolist() == [5, 6]


def test_times_are_unix_times_by_the_first_gps_message_that_knows_it() -> None:
    fixes = [(0, 0), (GPS_WEEK, GPS_MS), (GPS_WEEK, GPS_MS + 5000)]
    raw = FMT_ITSELF + TICK + GPS
    for k, (week, ms) in enumerate(fixes):
        raw += entry(2, struct.pack("<QBIHi", 1_000_000 + k * 1000, 3, ms, week, 575_000_000))
    log = DataflashLog.from_bytes(raw + tick(1, 3_000_000))
    # GPS time starts on 1980-01-06 and is 18 s ahead of Unix time
    seconds = 315_964_800 + GPS_WEEK * 604_800 - 18
    at_fix = seconds * 10**9 + GPS_MS * 10**6
    assert log.table("GPS").receive_time_ns[1] == at_fix
    assert log.table("TICK").receive_time_ns[0] == at_fix + 1_999_000_000
    assert log.table("GPS").columns["Lat"].tolist() == [57.5] * 3
    assert log.statistics.notes == ()


def test_without_gps_time_counts_from_boot() -> None:
    log = DataflashLog.from_bytes(FMT_ITSELF + TICK + tick(1, 5))
    assert log.table("TICK").receive_time_ns.tolist() == [5000]
    assert log.table("FMT").receive_time_ns.tolist() == [5000, 5000]
    assert any("no GPS time" in note for note in log.statistics.notes)


def test_steps_back_of_the_boats_clock_are_counted() -> None:
    times = [10_000_000, 9_999_000, 20_000_000, 3_000_000]  # 1 ms is the logger's own disorder
    raw = FMT_ITSELF + TICK + b"".join(tick(1, t) for t in times)
    assert DataflashLog.from_bytes(raw).statistics.time_backwards == 1


@pytest.mark.parametrize("wild", [0, 400_000_000, 10**18])
def test_one_time_that_cannot_be_is_said_and_read_as_of_the_message_before(wild: int) -> None:
    seconds = [100, 101, 102, 103, 104]
    times = [1_000_000 * s for s in seconds]
    times[2] = wild
    log = DataflashLog.from_bytes(FMT_ITSELF + TICK + b"".join(tick(1, t) for t in times))
    assert log.time_us[2:].tolist() == [1_000_000 * s for s in (100, 101, 101, 103, 104)]
    assert "1 message(s) with a time that cannot be" in log.statistics.notes[0]
    assert log.statistics.time_backwards == 0


def test_times_of_a_second_boot_stay() -> None:
    times = [500_000_000, 501_000_000, 1_000_000, 2_000_000]
    log = DataflashLog.from_bytes(FMT_ITSELF + TICK + b"".join(tick(1, t) for t in times))
    assert log.time_us[2:].tolist() == times
    assert not [note for note in log.statistics.notes if "cannot be" in note]


def test_order_is_the_position_among_all_messages() -> None:
    log = DataflashLog.from_bytes(FMT_ITSELF + TICK + tick(1, 5) + GPS + tick(1, 6))
    assert log.table("FMT").order.tolist() == [0, 1, 3]
    assert log.table("TICK").order.tolist() == [2, 4]
    assert len(log.table("NONE")) == 0


@RANDOM
@given(
    st.binary(max_size=300)
    | st.lists(st.sampled_from([0xA3, 0x95, 0x80, 1, 11, ord("Q"), ord("B"), 0]), max_size=300).map(
        bytes
    )
)
def test_arbitrary_bytes_end_in_a_log_or_in_one_line(raw: bytes) -> None:
    with contextlib.suppress(BadInput):
        log = DataflashLog.from_bytes(FMT_ITSELF + TICK + raw)
        for name, count in log.counts().items():
            assert len(log.table(name)) == count
        assert log.statistics.junk_bytes <= len(raw)
        survey(log)


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"", "is empty"), (bytes(4000), "nothing but zeros"), (b"a,b\n" * 99, "a text file")],
)
def test_what_is_no_log_gets_one_clear_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "log.BIN"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=says) as raised:
        open_log(path)
    assert str(path) in str(raised.value)


def test_junk_before_the_log_is_survived(tmp_path: Path) -> None:
    path = tmp_path / "log.BIN"
    path.write_bytes(b"\x01\x00\x02" * 30 + FMT_ITSELF + TICK + tick(1, 5))
    assert open_log(path).counts() == {"FMT": 2, "TICK": 1}


def test_a_format_without_columns_defines_nothing() -> None:
    empty = fmt(9, "NONE", "", "")
    log = DataflashLog.from_bytes(FMT_ITSELF + TICK + empty + tick(1, 5))
    assert log.counts() == {"FMT": 3, "TICK": 1}
    assert len(log.table("NONE")) == 0


def test_content_decides_and_not_the_name(tmp_path: Path) -> None:
    path = tmp_path / "log.tlog"
    path.write_bytes(FMT_ITSELF + TICK + tick(1, 5))
    assert open_log(path).kind == "dataflash"
