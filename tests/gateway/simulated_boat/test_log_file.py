"""The log of a simulated boat, written at once."""

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.open import open_log
from gateway.simulated_boat.hull import program_of
from gateway.simulated_boat.play import write_log
from tests.sim.vessels import WAMV

SECONDS = 8.0


def test_it_is_a_log_of_the_whole_voyage_with_the_boats_parameters(tmp_path):
    file = tmp_path / "new" / "voyage.tlog"
    assert write_log(WAMV, file, system=7, fast=True, seconds=SECONDS) == SECONDS
    log = open_log(file)
    (boat,) = log.boats()
    assert (boat.system, boat.type) == (7, "surface boat")
    assert log.counts()["ATTITUDE"] == pytest.approx(50 * SECONDS, abs=2)
    stamps = log.table("ATTITUDE").receive_time_ns
    assert np.ptp(stamps) == pytest.approx(SECONDS * 1e9, rel=0.01)
    assert log.counts()["PARAM_VALUE"] > 5


def test_the_same_seed_gives_the_same_bytes_and_another_one_other_noise(tmp_path):
    files = [tmp_path / f"{name}.tlog" for name in "abc"]
    for file, seed in zip(files, (1, 1, 2), strict=True):
        write_log(WAMV, file, seed=seed, seconds=SECONDS)
    one, same, other = (file.read_bytes() for file in files)
    assert one == same != other


def test_a_programme_is_played_once_if_no_duration_is_given(tmp_path):
    table = tmp_path / "sticks.csv"
    table.write_text("time,left,right\n0,0.5,0.5\n3,0.2,0.5\n6,0,0\n")
    duration = write_log(WAMV, tmp_path / "v.tlog", program=str(table))
    assert duration == program_of(WAMV, table).period == 6.0


@pytest.mark.parametrize(
    ("name", "seconds", "says"),
    [("v.bin", 5.0, "called NAME.tlog"), ("v.tlog", 0.0, "more than 0 s"),
     ("v.tlog", float("nan"), "more than 0 s"), ("v.tlog", 1e6, "at most a day")],
)  # fmt: skip
def test_what_cannot_be_written_is_one_line_and_leaves_nothing(tmp_path, name, seconds, says):
    with pytest.raises(BadInput, match=says):
        write_log(WAMV, tmp_path / name, seconds=seconds)
    assert list(tmp_path.iterdir()) == []
