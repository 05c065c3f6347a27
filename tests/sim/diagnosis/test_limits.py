"""Numbers that no boat has: where an effect stands for something else, and where it does not."""

import pytest

from sim.diagnosis.answer import LadderStep, Verdict
from sim.diagnosis.heldout import HeldOutScore
from sim.diagnosis.limits import strained
from sim.diagnosis.verdict import summary_of
from sim.effects.catalogue import named
from sim.identification.intervals import Estimate
from sim.vessel import AddedEffect
from tests.sim.voyages import WAM_V

WIDE = 0.3  # half a 95 % interval


def step(effect: str, half: float = WIDE, /, **values: float) -> LadderStep:
    law = named(effect)
    units = {p.name: p.unit for p in law.parameters}
    start = {p.name: p.start for p in law.parameters}
    estimates = tuple(
        Estimate(f"{effect}.{key}", units[key], start[key], x, (x - half, x + half), True)
        for key, x in values.items()
    )
    vessel = WAM_V.with_effects(AddedEffect(law, {**start, **values}))
    score = HeldOutScore(0.4, None)
    return LadderStep((effect,), "refitted", score, (), {effect: estimates}, vessel)


@pytest.mark.parametrize(
    ("effect", "number", "value", "told"),
    [
        ("payload_change", "factor", 3.0, "factor of payload_change stands at its limit, 3"),
        ("payload_change", "factor", 0.3, "factor of payload_change stands at its limit, 0.3"),
        ("thrust_curve", "exponent", 0.3001, "exponent of thrust_curve stands at its limit, 0.3"),
        ("heading_offset", "angle", -0.8, "angle of heading_offset stands at its limit, -0.8 rad"),
        ("payload_change", "factor", 2.9, ""),
        ("thruster_fault", "gain", 0.0, ""),  # a motor that is dead
        ("towed_load", "drag", 0.35, ""),  # little, far from 2000
        ("thruster_deadband", "jump", 1.0, ""),  # a shape
        ("payload_change", "time", 93.0, ""),
    ],
)
def test_only_what_could_be_more_stands_at_a_limit(
    effect: str, number: str, value: float, told: str
) -> None:
    assert strained(step(effect, **{number: value})) == ((told,) if told else ())


def test_an_antenna_is_on_board() -> None:
    hull = WAM_V.hull
    aboard = step("antenna_offset", x=-0.5 * hull.length, y=0.4 * hull.beam)
    assert strained(aboard) == ()
    near = step("antenna_offset", WIDE, x=0.0, y=0.5 * hull.beam + 0.9 * WIDE)
    assert strained(near) == ()  # as far as its interval tells
    beside = step("antenna_offset", WIDE, x=0.0, y=-0.5 * hull.beam - 1.1 * WIDE)
    (told,) = strained(beside)
    assert told.startswith("y of antenna_offset is -1.48 m, and the hull ends at -1.15 m")


def test_what_the_vessel_had_before_is_not_judged() -> None:
    there = step("payload_change", factor=3.0)
    other = LadderStep((), "kept", there.heldout, (), there.parameters, there.vessel)
    assert strained(other) == ()


def test_the_sentence_says_what_is_beyond_belief() -> None:
    last = step("payload_change", factor=3.0)
    ladder = [LadderStep((), "plain", HeldOutScore(0.67, None), (), {}, WAM_V)] * 2 + [last]
    said = summary_of(Verdict.UNKNOWN, ladder, [[]], [], 0.45, strained=strained(last))
    assert said.endswith(
        "something is missing that the catalogue does not hold: factor of payload_change stands at "
        "its limit, 3, so payload_change must stand for something else"
    )
