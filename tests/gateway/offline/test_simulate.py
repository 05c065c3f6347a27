"""Commands in, motion out, as a recording; what is no table of commands is one line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from gateway.errors import BadInput
from gateway.offline.simulate import read_commands, simulate
from gateway.recording.reader import Recording
from gateway.vessel_file import load_vessel
from sim.effects.catalogue import named
from sim.following.follower import FollowerOptions
from sim.model import Model
from sim.vessel import AddedEffect
from tests.gateway.json_schema import validator_of
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, WAMV

TABLE = "time,left,right\n10.0,0.0,0.0\n12.0,0.8,0.6\n20.0,-0.5,0.5\n30.0,0,0\n"


def table(folder: Path, text: str = TABLE) -> Path:
    path = folder / "sticks.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_motion_is_that_of_the_vessel_under_held_commands(tmp_path: Path) -> None:
    result = simulate(table(tmp_path), WAMV, None, tmp_path / "out")
    grid = np.arange(1000) / 50.0
    sticks = np.zeros((1000, 2))
    sticks[100:500] = 0.8, 0.6
    sticks[500:] = -0.5, 0.5
    expected = Model.of(WAMV).simulate(sticks, 0.02)[1][0, :-1]
    assert result.time == pytest.approx(grid)
    assert result.motion == pytest.approx(expected, abs=1e-12)
    assert result.commanded[300] == pytest.approx([0.8 * 90 + 0.6 * 90, 0.0, 0.7 * 0.2 * 90])
    assert result.follower is None


@pytest.mark.usefixtures("plain_laws")
def test_areas_that_a_wind_was_run_on_and_nobody_gave_are_told(tmp_path: Path) -> None:
    wind = AddedEffect(named("steady_wind"), {"speed": 6.0, "direction": 0.5})
    bare = replace(WAMV, name="bare", hull=replace(WAMV.hull, wind_area=(0.0, 0.0)))
    out = tmp_path / "out"
    (told,) = simulate(table(tmp_path), bare.with_effects(wind), WAMV, out).notices
    assert told.startswith("bare: areas above water assumed from length and beam: frontal 1.13 m²")
    assert not simulate(table(tmp_path), WAMV.with_effects(wind), None, out).notices
    assert not simulate(table(tmp_path), bare, None, out).notices


def test_a_second_vessel_follows_the_first(tmp_path: Path) -> None:
    result = simulate(table(tmp_path), WAMV, IACQUABOT, tmp_path / "out")
    assert result.follower is not None
    assert result.control is not None
    off = np.abs(result.follower - result.motion)[:, 3:6].max(axis=0)
    alone = Model.of(IACQUABOT).simulate(np.zeros((1000, 4)), 0.02)[1][0, :-1, 3:6]
    assert (off < 0.02).all()
    assert np.abs(result.motion[:, 3:6] - alone).max() > 0.5
    assert np.abs(result.control - result.commanded).max() > 1.0  # another boat, another force


def test_the_recording_holds_it_all_and_fits_its_schemas(tmp_path: Path) -> None:
    result = simulate(table(tmp_path), WAMV, IACQUABOT, tmp_path / "out")
    assert result.recording == tmp_path / "out" / "sticks-simulated.mcap"
    with result.recording.open("rb") as stream:
        for schema, _, message in make_reader(stream, validate_crcs=True).iter_messages():
            validator_of(schema.data).validate(json.loads(message.data))
    recording = Recording.open(result.recording)
    reference, shadow = recording.columns("reference"), recording.columns("shadow")
    assert np.array_equal(reference["surge_mps"], result.motion[:, 3])
    assert result.follower is not None
    assert np.array_equal(shadow["yaw_rad"], result.follower[:, 2])
    assert set(reference["source"]) == {"model"}
    assert len(recording.columns("control")["surge_n"]) == 1000
    for name, vessel in (("vessel.toml", WAMV), ("follower.toml", IACQUABOT)):
        path = tmp_path / name
        path.write_bytes(recording.attachments[name].data)
        assert load_vessel(path) == vessel


def test_simulating_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    first = simulate(table(tmp_path), WAMV, None, tmp_path / "a").recording.read_bytes()
    assert simulate(table(tmp_path), WAMV, None, tmp_path / "b").recording.read_bytes() == first


def test_actuators_that_a_table_leaves_out_stay_neutral(tmp_path: Path) -> None:
    path = table(tmp_path, "\ufefftime, screw\n0, 0.5\n5, 0.5\n")
    time, commands = read_commands(path, RUDDER_BOAT)
    assert time.tolist() == [0.0, 5.0]
    assert commands.tolist() == [[0.5, 0.0], [0.5, 0.0]]


MISTAKES = {
    "": "expected a CSV with the columns time",
    "time,left,right\n": "expected a CSV with the columns time",
    "left,right\n0,0\n1,1\n": "expected a CSV with the columns time",
    "time,port\n0,0\n1,1\n": "expected a CSV with the columns time",
    "time,left,rigth\n0,0,0\n1,1,1\n": "unknown column 'rigth': actuators are left, right",
    "time,left\n0,0\n": "time must have two or more rows and go up",
    "time,left\n1,0\n0,0\n": "time must have two or more rows and go up",
    "time,left\n0,0\n1,1.5\n": "line 3, left = '1.5': expected a command from −1 to 1",
    "time,left\n0,0\n1,full\n": "line 3, left = 'full': expected a command",
    "time,left\n0,0\n1\n": "line 3, left = None: expected a command",
    "time,left\n0,nan\n1,0\n": "line 2, left = 'nan': expected a command",
    "time,left\n0,0\nsoon,0\n": "line 3, time = 'soon': expected seconds",
    "time,left\n0,0,9\n1,0,9\n": "unknown column None",
    "time,left\n0,0\n1e9,0\n": "more than a day",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_what_is_no_table_of_commands_is_one_line(tmp_path: Path, text: str) -> None:
    path = table(tmp_path, text)
    with pytest.raises(BadInput) as caught:
        simulate(path, WAMV, None, tmp_path / "out")
    assert str(caught.value).startswith(f"{path}: ")
    assert MISTAKES[text] in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    binary = tmp_path / "noise.csv"
    binary.write_bytes(b"\xff\xfe\x00\x01")
    for path, expected in (
        (tmp_path / "absent.csv", "cannot read the commands: No such file"),
        (tmp_path, "cannot read the commands: Is a directory"),
        (binary, "not a text table"),
    ):
        with pytest.raises(BadInput, match=f"^{path}: {expected}"):
            read_commands(path, WAMV)


def test_a_follower_that_cannot_be_limited_is_one_line(tmp_path: Path) -> None:
    limited = FollowerOptions(limits=True)
    with pytest.raises(BadInput, match=r"^rudder boat: "):
        simulate(table(tmp_path), WAMV, RUDDER_BOAT, tmp_path / "out", options=limited)
