"""What would tell two effects apart: known for all that are said to be mistaken for one another."""

from sim.diagnosis.next_experiment import separation, separations
from sim.effects.catalogue import EFFECTS
from sim.excitation.catalogue import BY_NAME

PAIRS = {(e.name, other): s for e in EFFECTS for other, s in e.separated.items()}
NAMES = {effect.name for effect in EFFECTS}


def test_both_of_each_pair_exist_and_no_pair_is_there_twice():
    for one, other in PAIRS:
        assert {one, other} <= NAMES
        assert one != other
        assert (other, one) not in PAIRS


def test_every_confusion_that_an_effect_tells_of_has_an_answer():
    pairs = [(e.name, other) for e in EFFECTS for other in e.mistaken_for]
    assert not [pair for pair in pairs if separation(*pair) is None]


def test_every_answer_is_a_manoeuvre_that_can_be_planned():
    assert {s.excitation for s in PAIRS.values()} <= set(BY_NAME)


def test_the_order_of_two_does_not_matter_and_strangers_have_no_answer():
    assert separation("heading_offset", "steady_current") == separation(
        "steady_current", "heading_offset"
    )
    assert separation("battery_sag", "antenna_offset") is None
    named = ["steady_current", "heading_offset", "battery_sag"]
    assert list(separations(named)) == [("steady_current", "heading_offset")]
