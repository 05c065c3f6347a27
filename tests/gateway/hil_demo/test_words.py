"""Every sentence of the story has a case in which it would be false."""

from dataclasses import dataclass

import pytest

from gateway.hil_demo.story import error_sentence, intervals_sentence, named_sentence
from sim.effects.catalogue import EFFECTS
from sim.vessel import AddedEffect


@dataclass
class Score:
    nrmse: float
    noise_floor_nrmse: float = 0.1


@dataclass
class Number:
    name: str
    ci95: tuple[float, float]


def added(name: str, **values: float) -> AddedEffect:
    return AddedEffect(next(effect for effect in EFFECTS if effect.name == name), values)


@pytest.mark.parametrize(
    ("before", "after", "verdict", "rest"),
    [
        (0.5, 0.11, "falls: 0.500 → 0.110", "no more than noise"),
        (0.5, 0.3, "falls: 0.500 → 0.300", "more than noise"),
        (0.5, 0.6, "does not fall, it rises: 0.500 → 0.600", "more than noise"),
        (0.5, 0.5, "stays as it is: 0.500 → 0.500", "more than noise"),
    ],
)
def test_an_error_falls_only_where_it_does(before, after, verdict, rest):
    text = error_sentence("X", Score(before), Score(after))
    assert text == f"the error of X {verdict}, which is {rest} (noise alone may show 0.100)"


def test_a_diagnosis_is_right_only_where_it_names_what_was_hidden():
    worn, lag = added("thruster_imbalance", port_gain=0.75), added("thruster_lag", tau=0.5)
    drag = added("cubic_drag", X_uuu=-3.0)
    found = added("thruster_imbalance", port_gain=0.748)
    truth = "thruster_imbalance (port_gain 0.75)"
    said = "it names thruster_imbalance (port_gain 0.748)"
    assert named_sentence([worn], [found]) == f"{said}: that is what was hidden, {truth}"
    assert named_sentence([worn], []) == f"it names nothing; hidden was {truth}"
    assert named_sentence([worn], [drag]).endswith(f"that is not what was hidden, {truth}")
    assert named_sentence([worn], [found, lag]).endswith(
        f"what was hidden, {truth}, and more that was not"
    )
    assert "a part of what was hidden" in named_sentence([worn, lag], [found])
    assert "a part of what was hidden" in named_sentence([worn, lag], [found, drag])


def test_intervals_are_counted():
    numbers = [Number("m11", (80.0, 90.0)), Number("X_u", (-9.0, -8.0)), Number("offset", (0, 1))]
    both = intervals_sentence(numbers, {"m11": 85.0, "X_u": -8.5})
    assert both == "2 of 2 intervals hold the number that the boat really has"
    one = intervals_sentence(numbers, {"m11": 85.0, "X_u": -7.5})
    assert one == "1 of 2 intervals hold the number that the boat really has; not that of X_u"
