"""Tables with a mapping file."""

from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.csv.log import CsvLog
from gateway.ingest.open import open_log
from gateway.ingest.survey import survey
from gateway.samples import Quantity
from tests.gateway.ingest import made_table

TABLE = """t,heading,lat,lon,speed,left
1000,90,63.4,10.3,2,1500
1100,91,63.4,10.3,,1600
1200,,63.4,10.3,4,
,93,63.4,10.3,4,1700
"""
MAPPING = """
time = { column = "t", unit = "ms" }

[columns]
yaw = { column = "heading", unit = "deg" }
latitude = { column = "lat", unit = "deg" }
longitude = { column = "lon", unit = "deg" }
surge = { column = "speed", unit = "kn" }
channel_3 = { column = "left", unit = "us" }
"""


def write(folder: Path, table: str = TABLE, mapping: str | None = MAPPING) -> Path:
    path = folder / "run.csv"
    path.write_text(table)
    if mapping is not None:
        (folder / "mapping.toml").write_text(mapping)
    return path


def test_columns_become_samples_in_si_units(tmp_path: Path) -> None:
    log = open_log(write(tmp_path))
    said = {samples.quantity: samples for samples in log.samples()}
    assert said[Quantity.YAW].values[:, 0] == pytest.approx(np.radians([90.0, 91.0]))
    assert said[Quantity.YAW].vehicle_time_ns.tolist() == [1_000_000_000, 1_100_000_000]
    assert said[Quantity.GLOBAL_POSITION].values.shape == (3, 2)
    assert said[Quantity.ACTUATORS].values[:, 2] == pytest.approx([1500.0, 1600.0])
    assert log.counts() == {"CSV": 3}
    assert log.statistics.notes == ("1 row without a time left out",)


def timed(folder: Path, times_s: list[float]) -> CsvLog:
    """A table with those times."""
    rows = "".join(f"{t * 1000},90,63.4,10.3,2,1500\n" for t in times_s)
    log = open_log(write(folder, "t,heading,lat,lon,speed,left\n" + rows))
    assert isinstance(log, CsvLog)
    return log


CALM = [100.0 + 0.1 * k for k in range(400)]


@pytest.mark.parametrize("wild", [1e12, 7200.0 + 120.0, 0.0, -1e9, 1e5])
@pytest.mark.parametrize("row", [0, 200, 399])
def test_a_cell_with_a_wild_time_is_left_out(tmp_path: Path, wild: float, row: int) -> None:
    times = [*CALM]
    times[row] = wild
    log = timed(tmp_path, times)
    if (row, wild) in ((399, 7320.0), (0, 0.0)):  # a silence at the end or the start
        assert log.time_s == pytest.approx(times)
        return
    assert log.time_s == pytest.approx([t for k, t in enumerate(CALM) if k != row])
    why = "without a time left out" if wild == 1e12 else "left out: a time far from that of its"
    (note,) = log.statistics.notes
    assert note.startswith(f"1 row {why}")
    (boat,) = log.boats()
    assert len(log.decode(boat).sessions) == 1


def test_a_silence_is_no_new_session_but_years_are(tmp_path: Path) -> None:
    silent = [t + (3600.0 if t > 120.0 else 0.0) for t in CALM]
    log = timed(tmp_path, silent)
    assert log.time_s == pytest.approx(silent)
    assert len(log.decode(log.boats()[0]).sessions) == 1
    log = timed(tmp_path, [t + (1e9 if t > 120.0 else 0.0) for t in CALM])
    assert len(log.time_s) == len(CALM)
    assert len(log.decode(log.boats()[0]).sessions) == 2
    assert log.statistics.notes == ("time leaps within the table: read as 2 sessions",)


def test_a_clock_set_back_is_a_session_that_goes_on(tmp_path: Path) -> None:
    log = timed(tmp_path, [t - (3600.0 if t > 120.0 else 0.0) for t in CALM])
    assert np.all(np.diff(log.time_s) > 0.0)
    assert log.statistics.time_backwards == 1
    sessions = log.decode(log.boats()[0]).sessions
    assert len(sessions) == 2
    assert sessions[1][0] - sessions[0][1] == pytest.approx(1e9)


def test_knots_and_half_a_velocity(tmp_path: Path) -> None:
    sway = MAPPING + 'sway = { column = "heading", unit = "m/s" }\n'
    log = open_log(write(tmp_path, mapping=sway))
    (body,) = [s for s in log.samples() if s.quantity is Quantity.BODY_VELOCITY]
    assert body.values == pytest.approx(np.array([[2 * 1852 / 3600, 90.0]]))


def test_the_file_named_like_the_table_comes_before_mapping_toml(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.with_suffix(".toml").write_text(MAPPING.replace("channel_3", "channel_4"))
    log = open_log(path)
    assert isinstance(log, CsvLog)
    assert log.mapping.path.endswith("run.toml")


def test_semicolons_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text("\ufeff" + TABLE.replace(",", ";"), encoding="utf-8")
    assert len(open_log(path).time_s) == 3


def test_comments_before_the_header_are_passed_over(tmp_path: Path) -> None:
    path = write(tmp_path, '# made by a "logger, 1.2\n\n' + TABLE)
    assert len(open_log(path).time_s) == 3
    path = write(tmp_path, "# made by logger 1.2\n" + TABLE.replace("1600", "full"))
    with pytest.raises(BadInput, match="line 4, left: 'full' is no number"):
        open_log(path)


@pytest.mark.parametrize("ends", ["\r", "\r\n"])
def test_lines_may_end_as_those_of_other_systems(tmp_path: Path, ends: str) -> None:
    path = write(tmp_path)
    path.write_bytes(TABLE.replace("\n", ends).encode())
    assert len(open_log(path).time_s) == 3


def test_a_table_in_another_encoding_says_where_and_what_to_do(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_bytes(
        TABLE.encode() + "1300,93,63.4,10.3,4,1700\n1400,94,63.4,10.3,ä,1\n".encode("latin-1")
    )
    with pytest.raises(
        BadInput, match=r"run\.csv: line 7 is not UTF-8 \(byte 0xe4\).*iconv -f LATIN1"
    ):
        open_log(path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("heading", "course"), "no column 'course', which .*mapping.toml names: there are: t, h"),
        (('"deg"', '"grad"'), "yaw: unknown unit 'grad': expected rad, deg"),
        (("yaw", "yow"), r"unknown quantity 'yow': did you mean yaw\? expected"),
        (("[columns]", "[colums]"), "unknown key 'colums'"),
        (("unit = ", "units = "), r"time: expected time = \{ column"),
        (("=", "=="), "not a TOML file"),
    ],
)
def test_mistakes_in_the_mapping_are_told(
    tmp_path: Path, change: tuple[str, str], says: str
) -> None:
    with pytest.raises(BadInput, match=says):
        open_log(write(tmp_path, mapping=MAPPING.replace(*change)))


@pytest.mark.parametrize(
    ("table", "says"),
    [
        (TABLE.replace("1600", "full"), "line 3, left: 'full' is no number"),
        ("t,heading,lat,lon,speed,left\n", "fewer than two rows"),
        (TABLE.replace("1200", "1000").replace("1100", "1000"), "time in 't' is the same in all"),
        (
            TABLE.replace("\n", ",1500\n").replace("t,1500", "t,left"),
            "2 columns are called 'left', which .*: rename one",
        ),
        (
            TABLE.replace("63.4,10.3", "63,4,10,3"),
            "line 2 has 8 cells, the header 6, and "
            r"4 of 4 rows have .*: decimal commas between commas\? Write points",
        ),
        (
            TABLE.replace(",", ";").replace("1600", "1600,5"),
            "'1600,5' is no number; decimal commas "
            r"have to become points: tr , \. < /.*/run.csv > points.csv, then read points.csv "
            r"with --mapping /.*/mapping.toml",
        ),
        (TABLE.replace("1600", '"1600,5"'), "'1600,5' is no number; .* become points$"),
        ("", "empty"),
    ],
)
def test_mistakes_in_the_table_are_told(tmp_path: Path, table: str, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        open_log(write(tmp_path, table=table))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('"left", unit = "us"', '"left", unit = "fraction"'),
         "channel_3 cannot be 'fraction': column 'left' holds 1500 to 1600; 'us' would fit"),
        (('"left", unit = "us"', '"lon", unit = "us"'),
         "channel_3 cannot be 'us': column 'lon' holds 10.3 to 10.3; nor is that any of us, frac"),
        (('"lat", unit = "deg"', '"lat", unit = "rad"'),
         r"latitude cannot be 'rad': column 'lat' holds 63\.4 to 63\.4; 'deg' would fit"),
        (('"lon", unit = "deg"', '"lon", unit = "rad"'), "longitude cannot be 'rad'"),
        (('"lat", unit = "deg"', '"lat", unit = "1e-7 deg"'), ".*'deg' would fit"),
    ],
)  # fmt: skip
def test_a_unit_that_cannot_be_is_told(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        open_log(write(tmp_path, mapping=MAPPING.replace(*change)))


def test_commands_from_full_astern_to_full_ahead_are_no_microseconds(tmp_path: Path) -> None:
    share = TABLE.replace("1500", "-1").replace("1600", "0.5")
    with pytest.raises(BadInput, match=r"holds -1 to 0\.5; 'fraction' would fit"):
        open_log(write(tmp_path, share))
    zeros = TABLE.replace("1500", "0").replace("1600", "0").replace("1700", "0")
    assert open_log(write(tmp_path, zeros)).counts() == {"CSV": 3}  # of an output that is off
    wild = TABLE.replace("63.4,10.3,2", "1e9,10.3,2")
    assert open_log(write(tmp_path, wild)).counts() == {"CSV": 3}  # one cell is no unit


def calm_rows(row: int, cells: str) -> str:
    """A table of steady rows, one of them others."""
    rows = [f"{100 * k},90,63.4,10.3,2,1500" for k in range(20)]
    rows[row] = cells
    return "\n".join(["t,heading,lat,lon,speed,left", *rows]) + "\n"


def test_a_row_with_more_cells_than_names_is_left_out_and_told(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, calm_rows(5, "500,90,5,63.4,10.3,2,1500")))
    assert log.counts() == {"CSV": 19}
    assert log.statistics.notes == (
        "line 7 has 7 cells, the header 6: 1 row with more cells, left out",
    )


def test_a_row_with_fewer_cells_than_names_is_told(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, calm_rows(5, "500,90")))
    assert log.counts() == {"CSV": 20}
    assert log.statistics.notes == (
        "line 7 has 2 cells, the header 6: 1 row with fewer cells, taken as empty at their end",
    )


def test_a_table_whose_rows_all_lack_their_last_cells_is_read(tmp_path: Path) -> None:
    """Some programs write no empty cells at the end of a row."""
    lacking = calm_rows(5, "500,90,63.4,10.3,2,1500").replace("left\n", "left,note\n", 1)
    log = open_log(write(tmp_path, lacking))
    assert log.counts() == {"CSV": 20}
    assert "the header 7: 20 rows with fewer cells" in log.statistics.notes[0]


def test_delimiters_at_the_ends_of_lines_are_no_cells(tmp_path: Path) -> None:
    rows = calm_rows(5, "500,90,63.4,10.3,2,1500")
    for table in (rows.replace(",1500", ",1500,"), rows.replace("left", "left,")):
        log = open_log(write(tmp_path, table))
        assert log.counts() == {"CSV": 20}
        assert log.statistics.notes == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("column", [4, 5, 9])  # yaw rate, surge, a channel
def test_a_cell_of_absurd_size_is_an_empty_one_and_told(tmp_path: Path, column: int) -> None:
    path, _ = made_table.written(tmp_path, made_table.Traps())
    rows = [line.split(",") for line in path.read_text().splitlines()]
    for row in rows[1:]:
        row[4] = f"{float(row[4]) * 57.29578}"  # degrees, said to be radians: still seen
    rows[600][column] = "1e300"
    path.write_text("\n".join(map(",".join, rows)) + "\n")
    log = open_log(path)
    assert "1 cell left out whose number no boat has: beyond 1e+12" in log.statistics.notes
    assert np.isnan(log.table("CSV").columns[rows[0][column]][599])
    (boat,) = survey(log).boats
    assert any("degrees taken for radians" in notice for notice in boat.notices)


@pytest.mark.parametrize(
    ("step_s", "unit", "says"),
    [
        (8.0, "s", "rows are 8 s apart: is 's' the unit of time? They would be 0.008 s in 'ms'"),
        (
            1e-4,
            "us",
            "rows are 0.0001 s apart: is 'us' the unit of time? They would be 0.1 s in 'ms'",
        ),
    ],
)
def test_a_wrong_unit_of_time_is_asked_for(
    tmp_path: Path, step_s: float, unit: str, says: str
) -> None:
    factor = {"s": 1.0, "us": 1e6}[unit]
    rows = "".join(f"{k * step_s * factor},90,63.4,10.3,2,1500\n" for k in range(20))
    table = "t,heading,lat,lon,speed,left\n" + rows
    log = open_log(write(tmp_path, table, MAPPING.replace('"ms"', f'"{unit}"')))
    assert log.statistics.notes == (says,)


def test_rows_that_are_further_apart_than_any_telemetry_are_refused(tmp_path: Path) -> None:
    """Work goes by the time that a table spans: a small one took minutes and gigabytes."""
    table = calm_rows(5, "500,90,63.4,10.3,2,1500")
    says = r"rows are 100 s apart, which no telemetry.* unit of column 't'\? .* 0\.1 s in 'ms'"
    with pytest.raises(BadInput, match=says):
        open_log(write(tmp_path, table, MAPPING.replace('"ms"', '"s"')))


def test_times_beyond_all_dates_are_of_another_unit(tmp_path: Path) -> None:
    late = TABLE.replace("\n1", "\n17511231941")
    with pytest.raises(BadInput, match="lie beyond all dates: is their unit 's'"):
        open_log(write(tmp_path, late, MAPPING.replace('"ms"', '"s"')))


def test_utf_16_is_told_with_what_to_do(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(TABLE, encoding="utf-16")
    with pytest.raises(BadInput, match=r"is UTF-16 text: .*iconv -f UTF-16 -t UTF-8 .*run\.csv > "):
        open_log(path)


def test_a_column_with_a_value_in_one_row_is_looked_at_without_a_warning(tmp_path: Path) -> None:
    rate = 'yaw_rate = { column = "left", unit = "deg/s" }\n'
    table = TABLE.replace("1600", "").replace("1700", "").replace("1500", "5")
    mapping = MAPPING.replace('channel_3 = { column = "left", unit = "us" }\n', rate)
    (boat,) = survey(open_log(write(tmp_path, table, mapping))).boats
    assert "yaw rate" in boat.sources


def test_a_table_without_mapping_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"write run\.toml or mapping\.toml beside it"):
        open_log(write(tmp_path, mapping=None))
