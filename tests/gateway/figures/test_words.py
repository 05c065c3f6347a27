"""The answer of a diagnosis in sentences: no more is claimed than its verdict says."""

from types import SimpleNamespace
from typing import Any

import pytest

from gateway.figures.words import cause_text, diagnosis_texts
from sim.diagnosis.answer import Verdict
from sim.effects.catalogue import EFFECTS
from sim.vessel import AddedEffect

BY_NAME = {effect.name: effect for effect in EFFECTS}
VALUES: dict[str, dict[str, float]] = {
    "heading_offset": {"angle": -0.131}, "cg_offset": {"x_g": 0.1}
}  # fmt: skip


def step(*effects: str, error: float = 0.1) -> Any:
    added = tuple(AddedEffect(BY_NAME[name], VALUES[name]) for name in effects)
    angle = SimpleNamespace(name="heading_offset.angle", ci95=(-0.143, -0.120), trial=None)
    other_day = SimpleNamespace(name="heading_offset.angle", ci95=(-9.0, 9.0), trial="two")
    return SimpleNamespace(
        effects=effects, vessel=SimpleNamespace(effects=added),
        parameters={name: [angle, other_day] for name in effects if name == "heading_offset"},
        heldout=SimpleNamespace(nrmse=error),
    )  # fmt: skip


def diagnosis(verdict: Verdict, *effects: str, floor: float = 0.1, error: float = 0.1) -> Any:
    tied = SimpleNamespace(effect="cg_offset", confounded_with=("heading_offset",))
    return SimpleNamespace(
        verdict=verdict, effects=effects, ladder=[step(error=error), step(*effects, error=error)],
        noise_floor=floor, ranking=[tied] if verdict is Verdict.CONFOUNDED else [],
        alternatives=[step("cg_offset")],
    )  # fmt: skip


OTHER = "cannot tell that from another cause: The centre"
COMPASS = "The compass reads 7.5° too far to port (6.9–8.2°)"


def test_a_cause_is_told_in_peoples_units_with_the_interval_of_its_own_recording():
    assert cause_text(step("heading_offset"), "heading_offset") == COMPASS


@pytest.mark.parametrize(
    ("effect", "values", "intervals", "said"),
    [
        ("heading_offset", {"angle": 0.02}, {"angle": (-0.01, 0.05)}, True),
        ("heading_offset", {"angle": 0.02}, {"angle": (0.01, 0.05)}, False),
        ("thruster_imbalance", {"port_gain": 0.9}, {"port_gain": (0.7, 1.1)}, True),
        ("compass_deviation", {"b": 0.1, "c": 0.0}, {"b": (0.05, 0.15), "c": (-0.1, 0.1)}, False),
        ("compass_deviation", {"b": 0.1, "c": 0.0}, {"b": (-0.1, 0.3), "c": (-0.1, 0.1)}, True),
        ("heading_offset", {"angle": 0.02}, {}, False),  # nothing is known of it
    ],
)
def test_what_may_be_nothing_at_all_is_not_told_as_a_finding(effect, values, intervals, said):
    numbers = [
        SimpleNamespace(name=f"{effect}.{key}", ci95=ends, trial=None)
        for key, ends in intervals.items()
    ]
    one = SimpleNamespace(
        vessel=SimpleNamespace(effects=(AddedEffect(BY_NAME[effect], values),)),
        parameters={effect: numbers},
    )
    text = cause_text(one, effect)
    assert text.endswith("these data allow that there is none") is said


@pytest.mark.parametrize(
    ("answer", "first", "more"),
    [
        (diagnosis(Verdict.EXPLAINED, "heading_offset"), f"{COMPASS}.", ""),
        (
            diagnosis(Verdict.CONFOUNDED, "heading_offset"),
            f"{COMPASS}.",
            OTHER,
        ),
        (diagnosis(Verdict.UNKNOWN, "heading_offset"), "Something is missing", "not enough"),
        (diagnosis(Verdict.ADEQUATE), "Nothing is missing that these data could tell.", ""),
        (diagnosis(Verdict.ADEQUATE, floor=12.4, error=1.2), "These data cannot tell", ""),
    ],
)
def test_the_first_sentence_is_what_matters_most(answer, first, more):
    texts = diagnosis_texts(answer)
    assert texts[0].startswith(first)
    assert any(more in text for text in texts)
    assert ("cannot tell whether" in texts[0]) == (answer.noise_floor > 1.0)
    certain = answer.verdict is Verdict.EXPLAINED
    assert certain == (texts == (f"{COMPASS}.",))
