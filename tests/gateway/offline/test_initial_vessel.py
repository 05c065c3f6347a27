"""`shadow init`: actuators from the log's parameters, guesses marked, no file harmed."""

from pathlib import Path

import pytest

from gateway.errors import BadInput, ShadowError
from gateway.ingest.log import Log
from gateway.ingest.open import open_log
from gateway.offline.vessel import ASIDE, check_size, init_vessel, initial_notices
from gateway.vessel_file import load_vessel, read_vessel_file
from sim.model import Model
from tests.gateway.pipelines.sailing import SERVOS, parameters, tlog, voyage

SIZE = {"length": 2.0, "beam": 1.0, "mass": 80.0, "thrust": 100.0, "top_speed": 2.5}


def log(folder: Path, values: dict[str, float] = SERVOS) -> Log:
    return open_log(tlog(folder / "boat.tlog", [*parameters(values), *voyage(2.0)]))


def servo(channel: int, function: float, **more: float) -> dict[str, float]:
    values = {"FUNCTION": function, "MIN": 1100.0, "TRIM": 1500.0, "MAX": 1900.0, **more}
    return {f"SERVO{channel}_{name}": value for name, value in values.items()}


def test_actuators_come_from_the_parameters(tmp_path: Path) -> None:
    values = servo(1, 73.0, MIN=1000.0, TRIM=1490.0) | servo(3, 74.0, REVERSED=1.0)
    out = tmp_path / "boat.toml"
    init_vessel(log(tmp_path, values), out, None, SIZE)
    left, right = load_vessel(out).thrusters
    assert (left.name, left.servo.channel) == ("left", 1)
    assert left.servo.pwm == (1000.0, 1490.0, 1900.0)
    assert (right.name, right.servo.channel, right.servo.reversed) == ("right", 3, True)
    assert left.position[1] < 0.0 < right.position[1]  # port is to the left of the bow
    assert left.thrust[1] == 100.0


def test_outputs_that_are_set_otherwise_in_the_log_are_told(tmp_path: Path) -> None:
    once, again = servo(1, 73.0, REVERSED=0.0), servo(1, 73.0, REVERSED=1.0)
    messages = [*parameters(once), *voyage(2.0), *((2.0, said) for _, said in parameters(again))]
    (told,) = initial_notices(open_log(tlog(tmp_path / "boat.tlog", messages)))
    assert told.startswith("SERVO1_REVERSED changes from 0 to 1 at ")
    assert told.endswith("; this file has the last values")
    assert initial_notices(log(tmp_path)) == []


def test_an_output_that_moves_and_is_not_in_the_file_is_told(tmp_path: Path) -> None:
    """A bow thruster on an output without a function was left out in silence."""
    sent = [*parameters(servo(1, 73.0) | {"SERVO2_FUNCTION": 0.0}), *voyage(60.0)]
    (told,) = initial_notices(open_log(tlog(tmp_path / "boat.tlog", sent)))
    assert told.startswith("output 2 moves too, and its parameters (SERVO2_FUNCTION 0) do not say")
    sent = [*parameters(SERVOS), *voyage(60.0)]
    assert initial_notices(open_log(tlog(tmp_path / "whole.tlog", sent))) == []


def test_the_boat_reaches_the_speed_that_was_given(tmp_path: Path) -> None:
    out = tmp_path / "boat.toml"
    init_vessel(log(tmp_path), out, "Sea Otter", SIZE)
    vessel = load_vessel(out)
    assert vessel.name == "Sea Otter"
    states, _ = Model.of(vessel).simulate([[1.0, 1.0]] * 600, 0.1)
    assert states[0, -1, 3] == pytest.approx(2.5, rel=0.05)


def test_what_is_a_guess_is_marked(tmp_path: Path) -> None:
    made = init_vessel(log(tmp_path), tmp_path / "a.toml", None, {})
    given = init_vessel(log(tmp_path), tmp_path / "b.toml", None, SIZE)
    assert made.provenance["hull.mass"].says == "assumed: measure it"
    assert "guess" in made.provenance["dynamics.m11"].says
    assert "data sheet" in made.provenance["thrusters.left.thrust"].says
    assert made.provenance["thrusters.left.pwm"].says == "from the log's parameters"
    assert "hull.mass" not in given.provenance
    assert "thrusters.left.thrust" not in given.provenance
    assert "dynamics.m11" in given.provenance


def test_what_is_guessed_of_a_rudder_is_marked(tmp_path: Path) -> None:
    made = init_vessel(
        log(tmp_path, servo(1, 26.0) | servo(3, 70.0)), tmp_path / "a.toml", None, SIZE
    )
    for number in ("position", "angle", "area", "wash"):
        assert "assumed" in made.provenance[f"rudders.rudder.{number}"].says
    assert (
        'of a motor that turns write: motor = "main"' in made.provenance["rudders.rudder.area"].says
    )
    assert made.provenance["rudders.rudder.pwm"].says == "from the log's parameters"


def test_a_boat_that_steers_gets_a_rudder_behind_its_motor(tmp_path: Path) -> None:
    out = tmp_path / "boat.toml"
    init_vessel(log(tmp_path, servo(1, 26.0) | servo(3, 70.0)), out, None, SIZE)
    vessel = load_vessel(out)
    assert [t.name for t in vessel.thrusters] == ["main"]
    (rudder,) = vessel.rudders
    assert (rudder.servo.channel, rudder.wash) == (1, "main")


def test_motors_of_one_function_are_told_apart(tmp_path: Path) -> None:
    values = servo(1, 70.0) | servo(2, 26.0) | servo(3, 70.0) | servo(4, 26.0)
    out = tmp_path / "boat.toml"
    init_vessel(log(tmp_path, values), out, None, SIZE)
    vessel = load_vessel(out)
    assert [t.name for t in vessel.thrusters] == ["main_1", "main_3"]
    assert [r.name for r in vessel.rudders] == ["rudder_2", "rudder_4"]


def test_four_motors_stand_at_the_corners(tmp_path: Path) -> None:
    values = {k: v for n in range(4) for k, v in servo(n + 1, 33.0 + n).items()}
    out = tmp_path / "boat.toml"
    init_vessel(log(tmp_path, values), out, None, SIZE)
    thrusters = load_vessel(out).thrusters
    assert [t.name for t in thrusters] == ["motor_1", "motor_2", "motor_3", "motor_4"]
    assert {(t.position[0] > 0, t.position[1] > 0) for t in thrusters} == {
        (a, b) for a in (True, False) for b in (True, False)
    }
    origins = read_vessel_file(out).provenance
    assert [origins[f"thrusters.{t.name}.azimuth"].says for t in thrusters] == [ASIDE] * 4


def refused(folder: Path, source: Log, given: dict[str, float] | None = None) -> str:
    """What is said; no file is left."""
    out = folder / "never.toml"
    with pytest.raises(BadInput) as caught:
        init_vessel(source, out, None, given or SIZE)
    assert "\n" not in str(caught.value)
    assert [p.name for p in folder.iterdir() if "never" in p.name] == []
    return str(caught.value)


def test_a_log_without_parameters_says_how_to_get_them(tmp_path: Path) -> None:
    says = refused(tmp_path, open_log(tlog(tmp_path / "bare.tlog", voyage(2.0))))
    assert "bare.tlog: no parameters in it" in says


def test_a_boat_that_nothing_drives_is_said(tmp_path: Path) -> None:
    assert "no output drives the boat" in refused(tmp_path, log(tmp_path, servo(1, 26.0)))


def test_pulse_limits_that_do_not_ascend_are_said(tmp_path: Path) -> None:
    says = refused(tmp_path, log(tmp_path, servo(1, 70.0, TRIM=800.0)))
    assert "thrusters[0].pwm" in says or "must be ascending" in says
    assert says.startswith(str(tmp_path / "boat.tlog"))


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_sizes_are_positive_numbers(tmp_path: Path, value: float) -> None:
    says = refused(tmp_path, log(tmp_path), {"top_speed": value})
    assert says == f"--top-speed {value}: expected a positive number"


@pytest.mark.parametrize("size", [
    {"length": 160.0, "beam": 95.0}, {"mass": 38000.0}, {"length": 1600.0, "beam": 950.0},
])  # fmt: skip
def test_sizes_in_another_unit_are_no_boat(size: dict[str, float]) -> None:
    """Centimetres, grams, millimetres: what is made of them would look like a missing effect."""
    given = {"length": 1.6, "beam": 0.95, "mass": 38.0}
    check_size(given)
    check_size({"length": 4.9, "beam": 2.4, "mass": 180.0})
    with pytest.raises(BadInput, match="in metres and kilograms"):
        check_size(given | size)


def test_a_size_that_rounds_to_nothing_is_said(tmp_path: Path) -> None:
    assert "m11 = 0.0: input should be greater" in refused(
        tmp_path, log(tmp_path), {"length": 1e-4, "beam": 1e-4, "mass": 1e-9}
    )


def test_where_it_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "boat.toml"
    with pytest.raises(ShadowError, match=f"^{out}: cannot write the vessel file: ") as caught:
        init_vessel(log(tmp_path), out, None, SIZE)
    assert caught.value.exit_status == 1
    with pytest.raises(ShadowError, match="cannot write the vessel file: "):
        init_vessel(log(tmp_path), tmp_path, None, SIZE)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["boat.tlog", "file"]
    init_vessel(log(tmp_path), tmp_path / "absent" / "boat.toml", None, SIZE)
    assert (tmp_path / "absent" / "boat.toml").is_file()
