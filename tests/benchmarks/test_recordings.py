"""The recordings that ship are those of the index, and can be made again."""

import hashlib
import re
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.hidden.boats import GREBE
from benchmarks.hidden.vessel_toml import vessel_toml
from recordings.make import HERE, OTTER, VESSEL, cut_otter, frames, make_voyage, recipes

ROW = re.compile(r"^\| (\S+\.tlog) \| (\d+) \| ([0-9a-f]{64}) \|$", re.MULTILINE)
INDEX = {name: digest for name, _, digest in ROW.findall((HERE / "README.md").read_text("utf-8"))}


def digest(file: Path) -> str:
    """sha256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_the_index_lists_what_is_there() -> None:
    assert set(INDEX) == {file.name for file in HERE.glob("*.tlog")} == {OTTER, *recipes()}
    assert {name: digest(HERE / name) for name in INDEX} == INDEX
    assert sum((HERE / name).stat().st_size for name in INDEX) < 6_000_000


def test_the_vessel_file_is_that_of_the_boat() -> None:
    assert VESSEL.read_text(encoding="utf-8") == vessel_toml(GREBE)


@pytest.mark.parametrize("name", INDEX)
def test_every_frame_decodes_and_time_runs_forward(name: str) -> None:
    data, parser, last = (HERE / name).read_bytes(), mavlink.MAVLink(None), 0
    for start, end, message in frames(data):
        stamp = int.from_bytes(data[start : start + 8], "big")
        assert stamp >= last
        assert parser.decode(bytearray(data[start + 8 : end])).get_msgId() == message
        last = stamp
    assert end == len(data)


@pytest.mark.slow
@pytest.mark.parametrize("name", recipes())
def test_voyages_are_made_again_bit_for_bit(name: str, tmp_path: Path) -> None:
    assert digest(make_voyage(name, tmp_path)) == INDEX[name]


def test_the_piece_is_cut_from_the_whole(shared_data: Path, tmp_path: Path) -> None:
    assert digest(cut_otter(shared_data / "sitl" / "otter_calm.tlog", tmp_path)) == INDEX[OTTER]
