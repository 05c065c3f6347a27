"""day.toml: what it says is what the day is; each mistake is one line that names file and key."""

from dataclasses import replace

import pytest

from gateway.errors import BadInput
from gateway.hil.day_file import load_day, wind_told
from gateway.vessel_file import load_vessel
from sim.hil.boat import Boat
from sim.hil.day import Day, Moment, Wind, vessel_of_day
from sim.plants import VESSEL, PlantChoice
from sim.plants.waves import Sea
from tests.sim.vessels import WAMV

WHOLE = """
depth = 8.0
[start]
north = 5.0
yaw = 1.5
[wind]
speed = 4.0
direction = 0.5
[waves]
height = 0.3
period = 3.0
direction = 2.0
[[effects]]
type = "steady_current"
speed = 0.2
direction = 1.0
[[moments]]
at = 120.0
over = 10.0
effect = "steady_current"
speed = 0.6
[[moments]]
at = 300.0
thruster = "left"
gain = 0.0
[[moments]]
at = 400.0
wind = { speed = 9.0, direction = 2.0 }
"""


def written(folder, text):
    file = folder / "day.toml"
    file.write_text(text)
    return file


def test_a_day_is_what_its_file_says(tmp_path):
    day, text = load_day(written(tmp_path, WHOLE))
    assert text == WHOLE
    assert (day.depth, day.start) == (8.0, (5.0, 0.0, 1.5))
    assert day.wind == Wind(4.0, 0.5)
    assert day.sea == Sea(0.3, 3.0, 2.0)
    assert [(e.effect.name, dict(e.values)) for e in day.effects] == [
        ("steady_current", {"speed": 0.2, "direction": 1.0})
    ]
    rises, fails, turns = day.moments
    assert (rises.at, rises.over, rises.effect.name, rises.values) == (
        120.0, 10.0, "steady_current", {"speed": 0.6}
    )  # fmt: skip
    assert (fails.at, fails.thruster, fails.gain) == (300.0, "left", 0.0)
    assert (turns.at, turns.wind) == (400.0, Wind(9.0, 2.0))


def test_an_empty_day_is_a_calm_one(tmp_path):
    day, _ = load_day(written(tmp_path, ""))
    assert (day.effects, day.moments, day.wind, day.sea) == ((), (), None, None)


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("[weather]\nspeed = 1", "unknown key weather"),
        ("[wind]\nspeed = 1", "missing key wind.direction"),
        ("[waves]\nheight = 2.0\nperiod = 2.0", "such waves break"),
        ("[waves]\nheight = -1.0\nperiod = 2.0", "waves.height = -1.0"),
        ('[[effects]]\ntype = "tide"', "effects[0].type = 'tide': no such effect"),
        ('[[effects]]\ntype = "steady_current"', "steady_current takes speed, direction; missing"),
        ('[[effects]]\ntype = "steady_current"\nspeed = "1"', "effects[0].speed = '1'"),
        ("[[moments]]\nat = 1.0", "moments[0]: nothing changes"),
        (f'[[effects]]\ntype = "steady_current"\n{"n" * 9000} = 1', "unknown nnn"),
        (f"[[moments]]\nat = 1.0\n{'n' * 9000} = 'x'", "moments[0].nnn"),
        (
            f"[[moments]]\nat = 1.0\n{'n' * 9000} = 1.0\nthruster = 'a'\ngain = 1.0",
            "unknown key nnn",
        ),
        (
            f"[[moments]]\nat = 1.0\nthruster = '{'n' * 101}'\ngain = 1.0",
            "moments[0].thruster = 'nnn",
        ),
        ("[[moments]]\nat = -1.0", "moments[0].at = -1.0"),
        ('[[moments]]\nat = 1.0\nthruster = "left"', "thruster and gain"),
        ('[[moments]]\nat = 1.0\neffect = "steady_current"', "no number of it changes"),
        ('[[moments]]\nat = 1.0\neffect = "steady_current"\nknots = 1', "unknown key knots"),
        ('[[moments]]\nat = 1.0\nthruster = "left"\ngain = 0\nspeed = 1', "unknown key speed"),
        (
            '[[effects]]\ntype = "steady_current"\nspeed = 1\ndirection = 120',
            "rad: 120° are 2.094 rad",
        ),
        (
            '[[moments]]\nat = 1.0\neffect = "steady_current"\ndirection = 120',
            "moments[0].direction",
        ),
        (
            "[wind]\nspeed = 1\ndirection = 220",
            "wind.direction = 220: expected -6.2832 to 6.2832",
        ),
        ("[waves]\nheight = 0.1\nperiod = 2\ndirection = 180", "radians: is it in degrees?"),
        ("[start]\nyaw = 90", "start.yaw = 90: expected"),
        ('[[moments]]\nat = 1.0\nthruster = "left"\ngain = 50', "moments[0].gain = 50:"),
        ("not toml", "not a TOML file"),
    ],
)
def test_a_mistake_is_one_line_with_file_and_key(tmp_path, text, wrong):
    file = written(tmp_path, text)
    with pytest.raises(BadInput) as failed:
        load_day(file)
    assert str(failed.value).startswith(f"{file}: ")
    assert wrong in str(failed.value)
    assert "\n" not in str(failed.value)
    assert len(str(failed.value)) < 1000  # nothing quotes a file at length


def test_a_day_that_is_not_there(tmp_path):
    with pytest.raises(BadInput, match="cannot read the day"):
        load_day(tmp_path / "none.toml")


OTTER = load_vessel("otter")  # without areas, and without an effect for wind
GALE = "[wind]\nspeed = 12.0\ndirection = 1.5\n"
PUSHING = GALE + '[[effects]]\ntype = "steady_wind"\nspeed = 12\ndirection = 1.5\n'


def day_of(tmp_path, text):
    (tmp_path / "day.toml").write_text(text)
    return load_day(tmp_path / "day.toml")[0]


def test_a_wind_that_pushes_nothing_is_told_and_how_it_would(tmp_path):
    day = day_of(tmp_path, GALE)
    told = wind_told(day, vessel_of_day(OTTER, day))
    assert told.startswith("the day's wind of 12 m/s turns the wind vane and pushes nothing")
    assert told.endswith('with type = "steady_wind", speed = 12 and direction = 1.5')
    later = Day(moments=(Moment(at=5.0, wind=Wind(7.0, 0.0)),))
    assert wind_told(later, OTTER).startswith("the day's wind of 7 m/s")


def test_what_it_says_to_add_does_push_and_its_areas_are_told(tmp_path):
    north = []
    for text in (GALE, PUSHING.replace("1.5", "0.0")):
        boat = Boat.of(OTTER, day_of(tmp_path, text))
        state = boat.start()
        for _ in range(100):
            state, _, truth = boat.step(state, {}, 0.02)
        north.append(truth.north)
    assert north[0] == pytest.approx(0.0, abs=1e-9)
    assert north[1] < -0.005, "from the north"
    told = wind_told(boat.day, boat.vessel)
    assert told.startswith("areas above water assumed from length and beam: frontal 0.216 m²")


def test_of_a_wind_that_is_felt_or_not_there_nothing_is_told(tmp_path):
    gale, pushing = day_of(tmp_path, GALE), day_of(tmp_path, PUSHING)
    given = vessel_of_day(WAMV, pushing)
    assert wind_told(pushing, given) == ""
    assert wind_told(Day(), OTTER) == wind_told(Day(wind=Wind(0.0, 1.0)), OTTER) == ""
    assert wind_told(gale, OTTER, PlantChoice(VESSEL, given)) == ""
    assert wind_told(gale, OTTER, PlantChoice(VESSEL, replace(given, effects=()))) != ""
    assert wind_told(gale, OTTER, PlantChoice(VESSEL, None, "the table of an FMU")) == ""
