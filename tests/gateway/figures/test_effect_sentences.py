"""Every effect says what was found: the side is right, the interval is of the number."""

import math
import re

import pytest

from gateway.figures.words import headline
from sim.effects.catalogue import EFFECTS
from tests.sim.vessels import added

BY_NAME = {effect.name: effect for effect in EFFECTS}
TABLES = {effect.name for effect in EFFECTS if effect.tables is not None}  # they list numbers


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


def test_wiring_is_told_by_outputs():
    assert said("actuator_wiring", order=21.0, reversed=0.0) == "Outputs 1 and 2 are exchanged"
    assert (
        "actuator 2 runs the wrong way" in said("actuator_wiring", order=0.0, reversed=2.0).lower()
    )
    both = said("actuator_wiring", order=21.0, reversed=12.0)
    assert "exchanged and actuator 1 and 2 run the wrong way round" in both
