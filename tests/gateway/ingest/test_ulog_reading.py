"""A ULog in the order of its file: clocks that restart, impossible times, damage, appendices."""

import numpy as np
import pytest

from gateway.ingest.log import choose_boat
from gateway.ingest.ulog.log import UlogLog, ulog_from_bytes
from tests.gateway.ingest.ulog_writer import UlogWriter, quaternion

UTC_US = 1_700_000_000_000_000
SECOND = 1_000_000


def voyage(
    writer: UlogWriter, start_us: int, seconds: float, unix_minus_boot_us: int | None = None
) -> None:
    """Heading at 20 Hz, GPS at 5, status at 2; the GPS knows the time where it is given."""
    for k in range(round(20 * seconds)):
        t = start_us + k * SECOND // 20
        writer.add("vehicle_attitude", t, *quaternion(0.01 * k, 0.0, 0.0))
        if k % 4 == 0:
            utc = 0 if unix_minus_boot_us is None else t + unix_minus_boot_us
            writer.add("vehicle_gps_position", t + 7, utc, 63.4, 10.4, 0.5, -0.5, 3, 1)
        if k % 10 == 0:
            writer.add("vehicle_status", t + 9, 2, 11, 3)


def log_of(*boots: tuple[int, float, int | None]) -> UlogLog:
    """A file in which the clock starts anew: start [µs], length [s], Unix time of boot [µs]."""
    writer = UlogWriter()
    for start, seconds, unix in boots:
        voyage(writer, start, seconds, unix)
    return ulog_from_bytes(writer.bytes(sort=False))


def sessions(log: UlogLog) -> tuple[int, list[float]]:
    """Number of boots, and how long each was [s]."""
    found = log.decode(choose_boat(log))
    assert found.clock.sessions == len(found.sessions)
    return found.clock.duplicates, [(end - start) * 1e-9 for start, end in found.sessions]


@pytest.mark.parametrize(
    ("second", "unix"),
    [
        (2 * SECOND, None),  # after a reboot
        (2 * SECOND, UTC_US + 90 * SECOND),  # … of half a minute, by the GPS
        (40 * SECOND, None),  # set back inside a voyage
        (5 * SECOND, UTC_US),  # the same log again, behind itself
    ],
)
def test_a_clock_that_goes_back_opens_a_session(second: int, unix: int | None) -> None:
    log = log_of((5 * SECOND, 60.0, UTC_US), (second, 60.0, unix))
    duplicates, lengths = sessions(log)
    assert duplicates == 0
    assert log.statistics.time_backwards == 1
    assert lengths == pytest.approx([59.95, 58.9], abs=0.2)  # one is confirmed after a second
    times = log.table("vehicle_attitude").receive_time_ns
    assert (np.diff(times) > 0).all()
    gap = (times[1200] - times[1199]) * 1e-9
    assert gap == pytest.approx(27.05 if unix == UTC_US + 90 * SECOND else 1.0, abs=0.1)


def test_every_boot_is_found_and_placed_by_the_one_that_knows_the_time() -> None:
    log = log_of((SECOND, 30.0, None), (2 * SECOND, 40.0, UTC_US), (SECOND, 30.0, None))
    _, lengths = sessions(log)
    assert len(lengths) == 3
    table = log.table("vehicle_attitude")
    assert (np.diff(table.receive_time_ns) > 0).all()
    assert abs(table.receive_time_ns[600] - (UTC_US + 2 * SECOND) * 1000) < 10_000


def test_an_old_value_at_the_start_is_no_reboot() -> None:
    """The logger begins with the last value of every topic, however old."""
    writer = UlogWriter()
    for k in range(30):  # so many instances that they outnumber what else is written
        writer.add("battery_status", (1 + k) * SECOND, 12.0, instance=k)
    voyage(writer, 300 * SECOND, 10.0)
    for k in range(30):
        writer.add("battery_status", 310 * SECOND, 12.0, instance=k)
    log = ulog_from_bytes(writer.bytes(sort=False))
    assert log.statistics.time_backwards == 0
    assert not any("impossible" in note for note in log.statistics.notes)
    assert log.counts()["battery_status"] == 60


@pytest.mark.parametrize("off_s", [11.0, 4000.0, 6 * 86_400.0, -20.0])
def test_damaged_times_are_refused_however_near(off_s: float) -> None:
    writer = UlogWriter()
    voyage(writer, 100 * SECOND, 60.0)
    rows = sorted(writer.rows)
    for k in (100, 101, 700, len(rows) - 1):
        time_us = rows[k][0] + round(off_s * SECOND)
        raw = rows[k][1]
        rows[k] = (rows[k][0], raw[:5] + time_us.to_bytes(8, "little") + raw[13:])
    writer.rows = rows
    log = ulog_from_bytes(writer.bytes(sort=False))
    assert log.statistics.time_backwards == 0
    assert any("4 message(s) with an impossible time" in note for note in log.statistics.notes)
    assert sessions(log)[1] == pytest.approx([59.95], abs=0.1)


def test_few_rows_far_apart_are_no_damage() -> None:
    writer = UlogWriter()
    for k in range(40):
        writer.add("battery_status", (1 + 30 * k) * SECOND, 12.0)
    for k in range(40):
        writer.add("battery_status", (1 + 30 * k) * SECOND, 12.0)
    log = ulog_from_bytes(writer.bytes(sort=False))
    assert log.statistics.time_backwards == 1
    assert log.statistics.accepted == 80


@pytest.mark.parametrize("sync", [True, False])
def test_damage_costs_no_more_than_what_it_hit(sync: bool) -> None:
    writer = UlogWriter()
    voyage(writer, SECOND, 60.0)
    raw = bytearray(writer.bytes(sync=sync))
    whole = ulog_from_bytes(bytes(raw)).statistics.accepted
    rng = np.random.default_rng(1)
    for at in rng.integers(2000, len(raw), 40).tolist():
        raw[at] ^= 0xFF
    log = ulog_from_bytes(bytes(raw))
    assert log.statistics.accepted > whole - 40
    assert log.statistics.junk_bytes > 0
    (note,) = [one for one in log.statistics.notes if "damaged" in one]
    assert "s of it are missing" in note


def test_how_much_is_missing_is_told() -> None:
    writer = UlogWriter()
    voyage(writer, SECOND, 60.0)
    raw = bytearray(writer.bytes(sync=False))
    a, b = len(raw) // 3, 2 * len(raw) // 3
    raw[a:b] = np.random.default_rng(2).bytes(b - a)
    log = ulog_from_bytes(bytes(raw))
    (note,) = [one for one in log.statistics.notes if "damaged" in one]
    assert "in 1 place(s): 20." in note
    assert log.statistics.junk_bytes == pytest.approx(b - a, abs=100)


@pytest.mark.parametrize("kind", [b"D", b"Z", b"A", b"P"])
def test_a_message_that_is_wrong_in_itself_costs_itself_alone(kind: bytes) -> None:
    writer = UlogWriter()
    voyage(writer, SECOND, 20.0)
    whole = ulog_from_bytes(writer.bytes(sync=False)).statistics
    writer.rows.append((10 * SECOND + 1, b"\x06\x00" + kind + b"\xee\xeeabcd"))
    found = ulog_from_bytes(writer.bytes(sync=False)).statistics
    assert found.accepted == whole.accepted
    assert (found.unknown_messages, found.junk_bytes) == ((1, 0) if kind == b"Z" else (0, 9))


def test_appended_messages_are_read() -> None:
    """Those behind the place that the flags name, with what was cut before them."""
    writer = UlogWriter()
    voyage(writer, SECOND, 20.0)
    whole, log = (ulog_from_bytes(writer.bytes(appended_from=at)) for at in (0, 12 * SECOND))
    assert log.counts() == whole.counts()
    assert log.statistics.notes == whole.statistics.notes
    assert log.statistics.junk_bytes == 0


def test_formats_inside_formats_and_padding() -> None:
    inner = "esc:uint64_t timestamp;int32_t rpm;uint8_t[4] _padding0;"
    topics = {"esc_status": "uint8_t count;uint8_t[7] _padding0;esc[2] esc;char[4] name"}
    writer = UlogWriter(topics=topics)
    writer.ids["esc_status", 0] = 0
    body = b"\0\0" + (5).to_bytes(8, "little") + b"\x02" + bytes(7)
    for rpm in (100, -200):
        body += bytes(8) + rpm.to_bytes(4, "little", signed=True) + bytes(4)
    body += b"ab\0\0"
    writer.rows.append((5, len(body).to_bytes(2, "little") + b"D" + body))
    writer.head.append(len(inner).to_bytes(2, "little") + b"F" + inner.encode())
    columns = ulog_from_bytes(writer.bytes()).table("esc_status").columns
    assert columns["esc[1].rpm"].tolist() == [-200]
    assert columns["name"].tolist() == [b"ab"]
    assert not [name for name in columns if "padding" in name]
