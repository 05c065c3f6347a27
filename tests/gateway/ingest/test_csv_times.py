"""How programs write the times of a table, and what is made of it."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.csv.log import CsvLog
from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from tests.gateway.ingest import made_table

START_S = 1_780_000_000.0  # 2026-05-28 20:26:40 UTC
MAPPING = """
time = { column = "t", unit = "s" }

[columns]
yaw = { column = "heading", unit = "deg" }
surge = { column = "speed", unit = "m/s" }
"""


def table_of(folder: Path, times: list[str], each: int = 1) -> CsvLog:
    """A table with such times, every row written so often."""
    (folder / "run.toml").write_text(MAPPING)
    rows = "".join(f"{time},{k % 360},2\n" * each for k, time in enumerate(times))
    (folder / "run.csv").write_text("t,heading,speed\n" + rows)
    log = open_log(folder / "run.csv")
    assert isinstance(log, CsvLog)
    return log


def iso(k: int) -> str:
    return datetime.fromtimestamp(START_S + 0.1 * k, UTC).isoformat()


def iso_z(k: int) -> str:
    return iso(k).replace("+00:00", "Z")


def east_of_greenwich(k: int) -> str:
    return iso(k).replace("T20", "T22").replace("+00:00", "+02:00")


def without_zone(k: int) -> str:
    return iso(k).replace("+00:00", "").replace("T", " ")


@pytest.mark.parametrize("written", [iso, iso_z, east_of_greenwich, without_zone])
def test_dates_are_times(tmp_path: Path, written: Callable[[int], str]) -> None:
    log = table_of(tmp_path, [written(k) for k in range(40)])
    assert log.time_s == pytest.approx(START_S + 0.1 * np.arange(40), abs=1e-6)
    expected = ("times without a zone are read as UTC",) if written is without_zone else ()
    assert log.statistics.notes == expected


def test_a_row_without_a_date_is_left_out(tmp_path: Path) -> None:
    log = table_of(tmp_path, [iso(0), "", iso(2)])
    assert log.time_s == pytest.approx([START_S, START_S + 0.2], abs=1e-6)


def test_clock_times_go_on_over_midnight(tmp_path: Path) -> None:
    log = table_of(tmp_path, ["23:59:59.8", "23:59:59.9", "0:00:00.0", "00:00:00.1"])
    assert log.time_s == pytest.approx(86399.8 + 0.1 * np.arange(4))
    assert log.statistics.notes == ("clock times without a date: read as seconds since midnight",)


def test_what_is_no_time_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="'10:00 in the morning' is no number"):
        table_of(tmp_path, ["10:00 in the morning", "11:00"])
    with pytest.raises(BadInput, match=r"line 3, t: 'later' is no time as '2026-.* is"):
        table_of(tmp_path, [iso(0), "later", iso(2)])
    with pytest.raises(BadInput, match=r"line 4, t: '10:00:00' is no time as '2026-.* is"):
        table_of(tmp_path, [iso(0), iso(1), "10:00:00"])


def test_a_table_that_begins_with_its_last_row_is_turned_round(tmp_path: Path) -> None:
    """`info` said 0 s and 0.0 Hz, while `compare` read it."""
    log = table_of(tmp_path, [f"{START_S - 0.1 * k:.1f}" for k in range(40)])
    assert log.time_s == pytest.approx(START_S - 3.9 + 0.1 * np.arange(40))
    assert log.columns["heading"].tolist() == list(range(39, -1, -1))
    assert log.statistics.time_backwards == 0
    assert log.statistics.notes == (
        "its last row comes first: rows are read in the order of their times",
    )


def test_rows_of_one_whole_second_are_spread_over_it(tmp_path: Path) -> None:
    """The first second begins and the last one ends somewhere in between."""
    truth = START_S + 0.3 + 0.1 * np.arange(66)
    log = table_of(tmp_path, [f"{int(time + 1e-6)}" for time in truth])
    assert log.time_s == pytest.approx(truth, abs=1e-6)
    assert log.statistics.duplicates == 0
    assert log.statistics.notes == (
        "times are whole seconds, with 10 rows each: rows are spread evenly over their second",
    )


def test_rows_that_come_unevenly_are_spread_and_told(tmp_path: Path) -> None:
    counts = [10, 3, 10, 7, 10, 12, 4, 10, 10, 6]
    times = [f"{START_S + k:.0f}" for k, count in enumerate(counts) for _ in range(count)]
    log = table_of(tmp_path, times)
    assert len(np.unique(log.time_s)) == len(times)
    (note,) = log.statistics.notes
    assert note.startswith("times are whole seconds, with 10 rows each (3 to 12): ")
    assert note.endswith("Write times with fractions")


def test_rows_of_one_hertz_and_of_repeated_times_stay_as_they_are(tmp_path: Path) -> None:
    log = table_of(tmp_path, [str(k) for k in range(40)])
    assert log.time_s.tolist() == list(range(40))
    twice = [f"{0.1 * (k // 2):.1f}" for k in range(40)]
    assert table_of(tmp_path, twice).statistics.duplicates == 20


def test_rows_that_were_written_twice_are_not_spread(tmp_path: Path) -> None:
    """Of 1 Hz every row twice is no 2 Hz."""
    log = table_of(tmp_path, [str(k) for k in range(40)], each=2)
    assert log.time_s.tolist() == list(range(40))
    assert log.columns["heading"].tolist() == list(range(40))
    assert log.statistics.duplicates == 40
    assert log.statistics.notes == ()


def test_whole_seconds_are_not_taken_for_a_smoothed_rate(tmp_path: Path) -> None:
    path, _ = made_table.written(tmp_path, made_table.Traps())
    rows = [line.split(",") for line in path.read_text().splitlines()]
    for row in rows[1:]:  # milliseconds
        row[0] = f"{float(row[0]) // 1000 * 1000:.0f}"
    path.write_text("\n".join(map(",".join, rows)) + "\n")
    (boat,) = survey(open_log(path)).boats
    assert not any("smoothed" in notice for notice in boat.notices)
    assert boat.sources["yaw"].rate_hz == pytest.approx(10.0, abs=0.1)
