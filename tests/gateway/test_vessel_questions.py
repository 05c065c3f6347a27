"""Numbers that no boat has are asked about, one line each; those of boats are not."""

import json
from pathlib import Path

import pytest

from gateway.commands import ask_about_vessels
from gateway.files import vessel_names
from gateway.long_running import LogFormat
from gateway.vessel_file import dump_vessel, read_vessel_file
from gateway.vessel_questions import questions
from sim.vessel import Vessel
from tests.gateway.command_line import Run
from tests.sim import vessels
from tests.sim.voyages import WAM_V

BOATS = {one.name: one for one in (WAM_V, *vars(vessels).values()) if isinstance(one, Vessel)}
TEXT = """name = "boat"
[hull]
length = 1.6
beam = 0.95
mass = 38.0
[dynamics]
m11 = 42.0
m22 = 60.0
m33 = 9.0
X_u = -6.0
X_uu = -7.0
Y_v = -25.0
Y_vv = -60.0
N_r = -6.0
N_rr = -4.0
[[thrusters]]
name = "left"
channel = 1
position = [-0.6, -0.3]
thrust = [-35.0, 45.0]
[[thrusters]]
name = "right"
channel = 3
position = [-0.6, 0.3]
thrust = [-35.0, 45.0]
"""


def asked(folder: Path, text: str) -> list[str]:
    file = folder / "boat.toml"
    file.write_text(text, encoding="utf-8")
    return list(questions(read_vessel_file(file)))


@pytest.mark.parametrize("name", vessel_names())
def test_nothing_is_asked_about_a_vessel_that_ships(name: str) -> None:
    assert list(questions(read_vessel_file(name))) == []


@pytest.mark.parametrize("name", BOATS)
def test_nothing_is_asked_about_the_boats_of_the_tests(tmp_path: Path, name: str) -> None:
    assert asked(tmp_path, dump_vessel(BOATS[name])) == []


@pytest.mark.parametrize(
    ("before", "after", "question"),
    [
        ("mass = 38.0", "mass = 38000.0", "hull: 1.6 m × 0.95 m with 38000 kg would draw 25 m"),
        ("length = 1.6", "length = 160.0", "hull: 160 m × 0.95 m with 38 kg would draw 0.00025 m"),
        ("m11 = 42.0", "m11 = 4.2", "dynamics.m11 = 4.2 beside a mass of 38 kg"),
        ("m22 = 60.0", "m22 = 60000.0", "dynamics.m22 = 60000 beside a mass of 38 kg"),
        ("m33 = 9.0", "m33 = 90000.0", "dynamics.m33 = 90000 of a hull of 1.6 m and 38 kg"),
        ("[-0.6, -0.3]", "[-60.0, -30.0]", "thrusters[0].position = [-60, -30] is further"),
        ("[-0.6, -0.3]", "[-0.6, 0.3]", "all thrusters lie to starboard"),
        ("[-0.6, 0.3]", "[-0.6, -0.3]", "all thrusters lie to port"),
    ],
)
def test_a_number_in_another_unit_is_asked_about(
    tmp_path: Path, before: str, after: str, question: str
) -> None:
    assert before in TEXT
    told = asked(tmp_path, TEXT.replace(before, after))
    assert sum(one.startswith(question) for one in told) == 1
    assert all(one.endswith("?") for one in told)
    assert asked(tmp_path, TEXT) == []


def test_a_command_asks_on_standard_error_and_goes_on(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "boat.toml"
    file.write_text(TEXT.replace("m11 = 42.0", "m11 = 4.2"), encoding="utf-8")
    done = run("plan", "--vessel", file, "--excitation", "zigzag", "--out", tmp_path / "plan")
    assert done.status == 0
    assert done.err.startswith(f"{file}: dynamics.m11 = 4.2 beside a mass of 38 kg: is it ")
    assert done.err.count("\n") == 1
    assert run("plan", "--vessel", "otter", "--out", tmp_path / "other").err == ""


def test_each_boat_of_many_is_asked_about_once_in_the_form_of_the_lines(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "boat.toml"
    file.write_text(TEXT.replace("m11 = 42.0", "m11 = 4.2"), encoding="utf-8")
    ask_about_vessels({"vessel": [f"3={file}", f"3={file}", "otter"], "log": LogFormat.JSON})
    line = json.loads(capfd.readouterr().err)
    assert line["level"] == "warning"
    assert line["message"].startswith(f"3={file}: dynamics.m11")
    for other in (None, [], tmp_path / "absent.toml", tmp_path):
        ask_about_vessels({"vessel": other})
    file.write_text("name = ")
    ask_about_vessels({"vessel": file})
    assert capfd.readouterr().err == ""
