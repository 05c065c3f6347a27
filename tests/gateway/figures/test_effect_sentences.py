"""Every effect says what was found: the side is right, the interval is of the number."""

import math
import re

import pytest

from gateway.figures.words import headline
from sim.effects.catalogue import EFFECTS
from sim.effects.words import FittedValues
from tests.sim.vessels import added

BY_NAME = {effect.name: effect for effect in EFFECTS}
TABLES = {effect.name for effect in EFFECTS if effect.is_curve}  # they list numbers


def said(name: str, ci95=None, **values: float) -> str:
    effect = BY_NAME[name]
    return headline(effect, {**added(effect).values, **values}, ci95)


def test_every_effect_has_words():
    assert [effect.name for effect in EFFECTS if effect.in_words is None] == []


@pytest.mark.parametrize("name", sorted(set(BY_NAME) - TABLES))
def test_a_sentence_holds_no_identifier_and_no_python(name):
    text = said(name)
    assert text[0].isupper()
    assert not text.endswith(".")
    assert not re.search(r"_|nan|inf|\{|e[-+]\d", text), text


def test_the_compass_reads_too_far_to_the_side_that_its_error_has():
    ci95 = {"angle": (math.radians(-8.2), math.radians(-6.9))}
    assert said("heading_offset", ci95, angle=math.radians(-7.5)) == (
        "The compass reads 7.5° too far to port (6.9–8.2°)"
    )
    assert said("heading_offset", angle=0.1).endswith("to starboard")


@pytest.mark.parametrize(
    ("ends", "told"),
    [
        ((0.40, 0.48), "56 % weaker than modelled (52–60 %)"),
        ((0.4430, 0.4445), "55.6 % weaker than modelled (55.5–55.7 %)"),
        ((0.44369, 0.44371), "55.630 % weaker than modelled (55.629–55.631 %)"),
        ((0.4437, 0.4437), "56 % weaker than modelled"),
        ((0.443699999, 0.443700001), "55.630 % weaker than modelled"),
    ],
)
def test_an_interval_has_two_ends(ends, told):
    """Never "56 % (56–56 %)"."""
    assert said("thruster_imbalance", {"port_gain": ends}, port_gain=0.4437).endswith(told)


@pytest.mark.parametrize(
    ("name", "values", "one", "other"),
    [
        ("reverse_loss", {"factor": (1.2, 0.8)}, "harder", "weaker"),
        ("payload_change", {"factor": (1.2, 0.8)}, "heavier", "lighter"),
        ("thruster_imbalance", {"port_gain": (1.2, 0.8)}, "harder", "weaker"),
        ("cg_offset", {"x_g": (0.1, -0.1)}, "ahead", "aft"),
        ("steering_offset", {"angle": (0.1, -0.1)}, "starboard", "port"),
        ("steering_scale", {"gain": (1.2, 0.8)}, "further", "less far"),
        ("thruster_misalignment", {"angle": (0.1, -0.1)}, "starboard", "port"),
        ("yaw_rate_bias", {"bias": (0.1, -0.1)}, "starboard", "port"),
    ],
)
def test_the_side_follows_the_sign(name, values, one, other):
    ((key, (positive, negative)),) = values.items()
    assert one in said(name, **{key: positive})
    assert other not in said(name, **{key: positive})
    assert other in said(name, **{key: negative})


def test_an_interval_that_holds_both_sides_is_told_with_its_sign():
    text = said("reverse_loss", {"factor": (0.9, 1.3)}, factor=1.2)
    assert "20 % harder than modelled (−10 to 30 %)" in text
    text = said("reverse_loss", {"factor": (0.7, 1.1)}, factor=0.8)
    assert "20 % weaker than modelled (−10 to 30 %)" in text


def test_directions_are_points_of_the_compass():
    assert "towards 270° (west)" in said("steady_current", direction=-0.5 * math.pi)
    assert "from 0° (north)" in said("steady_wind", direction=0.0)


def test_wiring_is_told_by_places_in_the_file():
    assert said("actuator_wiring", order=21.0, reversed=0.0) == (
        "Actuators 1 and 2 of the file get each other's commands"
    )
    backwards = said("actuator_wiring", order=0.0, reversed=2.0).lower()
    assert "actuator 2 of the file runs the wrong way" in backwards
    both = said("actuator_wiring", order=21.0, reversed=12.0)
    assert "commands and actuator 1 and 2 run the wrong way round" in both


SENTENCES = (
    ("advance_loss", {"per_mps": 0.12}, "lose 12 % of their thrust with each m/s ahead"),
    ("astern_stall", {"per_mps": 0.25, "above": 0.5}, "lose 25 % of their thrust with each"),
    ("battery_sag", {"nominal": 14.8}, "it is full at 15 V"),
    ("cg_offset", {"x_g": -0.21}, "the centre of gravity lies 0.21 m aft of the middle"),
    ("command_delay", {"delay": 0.34}, "commands act 0.34 s late"),
    ("compass_deviation", {"b": 0.03, "c": -0.04}, "by up to 2.9° on some headings"),
    ("cross_damping", {"Y_r": -14.0}, "14 N to port at 1 rad/s to starboard"),
    ("crossflow_drag", {"drag": 240.0}, "slipping brakes a turn: as by 240 N on the whole side"),
    ("cubic_drag", {"X_uuu": -3.5}, "3.5 N more at 1 m/s"),
    ("drag_growth", {"rate": 0.0005}, "drag grows by 3.0 % a minute"),
    ("inertial_force", {"force": 9.0, "direction": 0.5 * math.pi},
     "9.0 N pushes towards 90° (east)"),
    ("reverse_loss", {"factor": 0.75}, "astern the motors push 25 % weaker than modelled"),
    ("steady_wind", {"speed": 7.5, "direction": 0.75 * math.pi},
     "7.5 m/s blows from 135° (south-east)"),
    ("steering_lag", {"tau": 0.3}, "the steering follows its command 0.30 s late"),
    ("steering_offset", {"angle": 0.1}, "stands 5.7° to starboard"),
    ("steering_play", {"play": 0.1}, "play: it follows only beyond 5.7° to either side"),
    ("steering_rate", {"rate": 0.15}, "the steering turns no faster than 8.6 °/s"),
    ("steering_scale", {"gain": 0.75}, "the steering turns 25 % less far than modelled"),
    ("thrust_curve", {"exponent": 2.0}, "half throttle works like 25 % throttle"),
    ("thruster_deadband", {"width": 0.08}, "do not answer the first 8.0 % of throttle"),
    ("thruster_fault", {"thruster": 2.0, "gain": 0.4, "time": 60.0},
     "thruster 2 gives 40 % of its thrust from 60 s on"),
    ("thruster_fault", {"thruster": 0.0, "gain": 0.4, "time": 60.0},
     "all thrusters give 40 % of their thrust from 60 s on"),
    ("thruster_imbalance", {"port_gain": 1.12}, "the port motor pushes 12 % harder than modelled"),
    ("thruster_imbalance", {"port_gain": 1.12, "starboard": 1.0},
     "beside the port motor, the starboard motor pushes 12 % weaker than modelled"),
    ("thruster_imbalance", {"port_gain": 0.88, "starboard": 1.0},
     "the starboard motor pushes 12 % harder than modelled"),
    ("thrust_scale", {"gain": 0.68}, "all motors push 32 % weaker than modelled"),
    ("thrust_scale", {"gain": 9.1}, "as if the thrust in the file were in kilograms and not in"),
    ("thrust_scale", {"gain": 4.6}, "were in pounds and not in newtons"),
    ("lever_arm", {"gain": 0.6}, "the motors are 40 % nearer to the centre line than in the file"),
    ("lever_arm", {"gain": 0.6, "which": 1.0}, "the motors to port are 40 % nearer to the centre"),
    ("lever_arm", {"gain": 2.0, "which": 2.0}, "the motors to starboard are 100 % further from"),
    ("lever_arm", {"gain": 2.0, "which": 3.0}, "100 % further from midships than in the file"),
    ("lever_arm", {"gain": 1.5}, "the motors are 50 % further from the centre line than in"),
    ("thruster_lag", {"tau": 1.25}, "thrust follows the throttle 1.2 s late"),
    ("thruster_misalignment", {"angle": -0.1}, "the motors point 5.7° to port"),
    ("towed_load", {"drag": 20.0, "x": -1.5}, "1.5 m aft of the middle, with 20 N at 1 m/s"),
    ("varying_current", {"speed": 0.3, "direction": math.pi, "period": 600.0},
     "up to 0.30 m/s swings to and fro along 180° (south) every 600 s"),
    ("velocity_latency", {"delay": 0.12}, "positions and speeds are 0.12 s old"),
    ("wave_motion", {"omega": 2.0, "force": 6.0, "direction": 0.0},
     "a period of 3.1 s push with 6.0 N towards 0° (north)"),
    ("crossing_waves", {"omega": 2.0, "force": 6.0, "direction": 0.0},
     "besides, waves of a period of 3.1 s push with 6.0 N towards 0° (north)"),
    ("yaw_rate_bias", {"bias": 0.01}, "the gyro reads 0.57 °/s too fast to starboard"),
    ("payload_change", {"factor": 1.4, "time": 90.0}, "the boat is 40 % heavier from 90 s on"),
    ("current_change", {"speed": 0.2, "direction": 0.0, "later_speed": 0.4, "time": 50.0,
                        "later_direction": math.pi},
     "until 50 s a current of 0.20 m/s sets towards 0° (north), from then on one of 0.40 m/s "
     "towards 180° (south)"),
)  # fmt: skip


@pytest.mark.parametrize(("name", "values", "words"), SENTENCES)
def test_numbers_are_told_in_units_of_people_and_from_what_was_modelled(name, values, words):
    assert words.lower() in said(name, **values).lower()


def test_only_an_interval_on_one_side_of_the_middle_tells_how_thrust_begins():
    once, gently = ((0.6, 0.9), "give at once"), ((0.1, 0.4), "begin gently")
    for ends, told in (once, gently, ((0.1, 0.9), "")):
        text = said("thruster_deadband", {"jump": ends}, width=0.1, jump=0.5)
        assert told in text
        assert ("beyond" in text) == bool(told)


def test_a_moment_is_told_by_the_clock_where_one_was_set():
    p = FittedValues({"time": 338.4}, start_time_ns=1_700_000_000 * 10**9)  # 22:13:20 UTC
    assert p.moment("time") == "338 s, 22:18:58 UTC,"
    assert FittedValues({"time": 338.4}, start_time_ns=86_400 * 10**9).moment("time") == "338 s"
    assert FittedValues({"time": 7000.0}, start_time_ns=1_700_000_000 * 10**9).moment("time") == (
        "7000 s, 00:10:00 UTC,"
    )


@pytest.mark.parametrize(
    ("value", "ends", "told"),
    [(849.3, (0.0, 6.07e6), "849 N (anything from 0 N on)"),
     (108.0, (0.0, 5937.0), "108 N (anything from 0 N on)"),
     (849.3, (120.0, 8e3), "849 N (120–8000 N)"),
     (-849.3, (-6.07e6, -10.0), "849 N (anything from 10 N on)"),
     (1e-5, (0.0, 0.3), "0.000 N (0.000–0.300 N)")],
)  # fmt: skip
def test_an_end_that_data_do_not_set_is_not_told_as_millions(value, ends, told):
    assert FittedValues({"x": value}, {"x": ends}).size("x", "N") == told


@pytest.mark.parametrize(
    ("value", "told"),
    [(0.0, "0.0 m"), (0.00312, "0.003 m"), (0.0312, "0.031 m"), (0.312, "0.31 m"), (3.12, "3.1 m"),
     (31.2, "31 m"), (3120.0, "3120 m"), (-0.312, "0.31 m")],
)  # fmt: skip
def test_a_size_has_two_digits_and_no_more_than_three_places(value, told):
    assert FittedValues({"x": value}).size("x", "m") == told
