"""Tables with a mapping file."""

from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.csv.log import CsvLog
from gateway.ingest.open import open_log
from gateway.samples import Quantity

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
    assert log.statistics.notes == ("1 rows without a time left out",)


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
    assert len(log.statistics.notes) == 1
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
        (("heading", "course"), "no column 'course', which .*mapping.toml names; there are: t, h"),
        (('"deg"', '"grad"'), "yaw: unknown unit 'grad': expected rad, deg"),
        (("yaw", "yow"), "unknown quantity 'yow'"),
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
        ("", "empty"),
    ],
)
def test_mistakes_in_the_table_are_told(tmp_path: Path, table: str, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        open_log(write(tmp_path, table=table))


def test_a_table_without_mapping_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"write run\.toml or mapping\.toml beside it"):
        open_log(write(tmp_path, mapping=None))
