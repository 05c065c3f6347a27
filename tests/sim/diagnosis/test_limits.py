"""Numbers that no boat has: where an effect stands for something else, and where it does not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis.answer import LadderStep, StepBase, Verdict
from sim.diagnosis.heldout import HeldOutScore, Ranking
from sim.diagnosis.ladder import EffectSearch
from sim.diagnosis.limits import sameness_of, smallness_of, strain_of
from sim.diagnosis.rivals import all_rivals_of
from sim.diagnosis.verdict import summary_of
from sim.effects.catalogue import EFFECTS, named
from sim.vessel import AddedEffect
from tests.sim.diagnosis.made_scorer import MadeScorer
from tests.sim.diagnosis.rankings import FIRST, SOME, row, starts
from tests.sim.voyages import WAM_V


def strain(effect: str, **values: float) -> str:
    start = {p.name: p.start for p in named(effect).parameters}
    return strain_of(AddedEffect(named(effect), {**start, **values}), WAM_V)


@pytest.mark.parametrize(
    ("effect", "number", "value", "told"),
    [
        ("payload_change", "factor", 3.0, "factor of payload_change stands at its limit, 3"),
        ("payload_change", "factor", 0.3, "factor of payload_change stands at its limit, 0.3"),
        ("thrust_curve", "exponent", 0.3001, "exponent of thrust_curve stands at its limit, 0.3"),
        ("heading_offset", "angle", -0.8, "angle of heading_offset stands at its limit, -0.8 rad"),
        ("payload_change", "factor", 2.9, ""),
        ("thruster_fault", "gain", 0.0, ""),  # a motor that is dead
        ("thruster_imbalance", "port_gain", 2.0, ""),  # the other motor is dead
        ("thruster_imbalance", "port_gain", 0.0, ""),
        ("towed_load", "drag", 0.35, ""),  # little, far from 2000
        ("thruster_deadband", "jump", 1.0, ""),  # a shape
        ("payload_change", "time", 93.0, ""),
    ],
)
def test_only_what_could_be_more_stands_at_a_limit(
    effect: str, number: str, value: float, told: str
) -> None:
    assert strain(effect, **{number: value}) == told


def test_an_antenna_is_no_further_out_than_the_hull_is_long() -> None:
    half = 0.5 * WAM_V.hull.length
    assert strain("antenna_offset", x=-half, y=0.9 * half) == ""  # an outrigger
    assert strain("antenna_offset", x=0.0, y=1.2 * half) == ""  # as far as one can tell
    beside = strain("antenna_offset", x=0.0, y=-1.3 * half)
    assert beside == "y of antenna_offset is -3.19 m, and the hull ends at -2.45 m"
    assert "hull ends at 2.45 m" in strain("antenna_offset", x=1.3 * half)


@pytest.mark.parametrize(
    ("effect", "values", "told"),
    [
        (
            "heading_offset",
            {"angle": -0.009},
            "0.5° is less than a good sensor is off by anyway (1.0°)",
        ),
        ("heading_offset", {"angle": 0.018}, ""),
        (
            "thrust_scale",
            {"gain": 0.93},
            "7 % is less than a boat's numbers are off by anyway (10 %)",
        ),
        ("thrust_scale", {"gain": 1.11}, ""),
        (
            "lever_arm",
            {"gain": 1.07, "which": 0.0},
            "7 % is less than a boat's numbers are off by anyway (10 %)",
        ),
        (
            "steering_scale",
            {"gain": 1.02},
            "2 % is less than a boat's numbers are off by anyway (5 %)",
        ),
        ("steady_current", {"speed": 0.001, "direction": 0.0}, ""),  # nothing is known of that
    ],
)
def test_what_a_good_sensor_errs_by_is_not_told(
    effect: str, values: dict[str, float], told: str
) -> None:
    assert smallness_of(AddedEffect(named(effect), values)) == told


@pytest.mark.parametrize(
    ("later_speed", "later_direction", "told"),
    [
        (7.48, 1.748, "it changes by 15 % only: that is no change"),
        (7.48, 1.9, "it changes by 1 % only: that is no change"),
        (7.40, 1.7, ""),
        (8.90, 1.9, ""),
        (7.40, 1.9 - np.pi, ""),
    ],
)
def test_a_wind_that_hardly_changes_has_not_changed(
    later_speed: float, later_direction: float, told: str
) -> None:
    """As found where one wind blew all along: its form is not quite the catalogue's."""
    values = {"speed": 7.40, "direction": 1.9, "time": 205.6}
    later = {"later_speed": later_speed, "later_direction": later_direction}
    found = AddedEffect(named("wind_change"), {**values, **later})
    assert sameness_of(found) == told


def test_a_steady_wind_is_no_change() -> None:
    assert sameness_of(AddedEffect(named("steady_wind"), {"speed": 0.1, "direction": 0.0})) == ""


def test_the_sentence_says_what_is_beyond_belief() -> None:
    score, name = HeldOutScore(0.4, None), ("payload_change",)
    ladder = [LadderStep((), StepBase.PLAIN, HeldOutScore(0.67, None), (), {}, WAM_V)] * 2
    last = LadderStep(name, StepBase.REFITTED, score, (), {}, WAM_V)
    told = [strain("payload_change", factor=3.0)]
    said = summary_of(Verdict.UNKNOWN, [*ladder, last], [[]], [], 0.45, strained=told)
    assert said.endswith(
        "something is missing that the catalogue does not hold: factor of payload_change stands at "
        "its limit, 3, so payload_change must stand for something else"
    )


def test_what_only_does_as_well_at_its_limit_is_no_rival() -> None:
    nothing: Any = None
    scorer: Any = MadeScorer(0.05)
    search = EffectSearch(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    ends = {"heading_offset": {"angle": 0.8}}
    fit: Any = SimpleNamespace(names=("thruster_imbalance",))
    for of_rival, told in ((starts, ["heading_offset"]), (lambda name: ends[name], [])):
        best, rival = row("thruster_imbalance", SOME.gain), row("heading_offset", SOME.gain)
        rival.fit.values = of_rival
        step = Ranking(FIRST, (best, rival))
        selection: Any = SimpleNamespace(steps=(step,), fit=fit)
        assert [r.name for r in all_rivals_of(step, search, selection)] == told
