"""The answer of a diagnosis in sentences: no more is claimed than its verdict says."""

from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from gateway.figures import ColouredPoints, Line
from gateway.figures.diagnosis import _map_figure, timeline
from gateway.figures.words import base_text, cause_text, diagnosis_texts, why_not_texts
from sim.diagnosis.answer import StepBase, Verdict
from sim.diagnosis.next_experiment import Refusal
from sim.effects import learned_anomaly, learned_drag
from sim.effects.catalogue import EFFECTS
from sim.effects.tables import EVENLY, MapField
from sim.effects.words import FittedValues
from sim.identification.intervals import Estimate
from sim.vessel import AddedEffect

BY_NAME = {effect.name: effect for effect in EFFECTS}
WIND = {"speed": 0.8, "direction": 1.0, "c_x": 0.5, "c_n": 0.01}
VALUES: dict[str, dict[str, float]] = {
    "heading_offset": {"angle": -0.131}, "cg_offset": {"x_g": 0.1}
}  # fmt: skip


def number(name: str, value: float, ends: tuple[float, float], trial: str | None = None) -> Any:
    return SimpleNamespace(name=name, value=value, ci95=ends, trial=trial)


HULL = SimpleNamespace(mass=38.0, length=2.0)


def step(*effects: str, error: float = 0.1) -> Any:
    added = tuple(AddedEffect(BY_NAME[name], VALUES[name]) for name in effects)
    angle = number("heading_offset.angle", -0.131, (-0.143, -0.120))
    return SimpleNamespace(
        effects=effects, vessel=SimpleNamespace(effects=added, hull=HULL, thrusters=()),
        parameters={name: [angle] for name in effects if name == "heading_offset"},
        heldout=SimpleNamespace(nrmse=error), base_parameters=(),
    )  # fmt: skip


def diagnosis(verdict: Verdict, *effects: str, floor: float = 0.1, error: float = 0.1) -> Any:
    tied = SimpleNamespace(effect="cg_offset", confounded_with=("heading_offset",))
    last = step(*effects, error=error)
    return SimpleNamespace(
        verdict=verdict, effects=effects, ladder=[step(error=error), last], best=last,
        noise_floor=floor, ranking=[tied] if verdict is Verdict.CONFOUNDED else [],
        alternatives=[step("cg_offset")], start_time_ns=0, base_changed=False, curve=None,
        vessel=SimpleNamespace(effects=()),
        base_may_hold=verdict is Verdict.ADEQUATE and error <= 2.0 * floor,
    )  # fmt: skip


def test_a_hull_that_came_out_lighter_than_itself_is_said_beside_the_answer():
    light = Estimate("m11", "kg", 16.5, 0.88, (0.0, 3.0), True)
    answer = diagnosis(Verdict.UNKNOWN)
    answer.ladder[-1].base_parameters = (light,)
    texts = diagnosis_texts(answer)
    assert texts[0] == "Something is missing that the catalogue does not hold."
    assert texts[-1] == (
        "m11 0.88 kg is far less than a hull of 38 kg has without any water: mass or thrust of the "
        "vessel file cannot be right; check both first."
    )


OTHER = "cannot tell that from another cause: The centre"
COMPASS = "The compass reads 7.5° too far to port (6.9–8.2°)"


def test_a_cause_is_told_in_peoples_units_with_its_interval():
    assert cause_text(step("heading_offset"), "heading_offset") == COMPASS


def test_of_several_recordings_each_tells_its_own_and_none_speaks_for_another():
    numbers = [
        number("steady_current.speed", 0.2, (0.19, 0.21), "one"),
        number("steady_current.direction", 0.7, (0.65, 0.75), "one"),
        number("steady_current.speed", 0.014, (0.0, 0.03), "two"),
        number("steady_current.direction", 0.9, (-2.0, 4.0), "two"),
        number("steady_current.speed", 0.3, (0.29, 0.31), "three"),
        number("steady_current.direction", -1.06, (-1.1, -1.02), "three"),
    ]
    added = AddedEffect(BY_NAME["steady_current"], {"speed": 0.2, "direction": 0.7})
    several = SimpleNamespace(
        vessel=SimpleNamespace(effects=(added,)), parameters={"steady_current": numbers}
    )
    assert cause_text(several, "steady_current") == (
        "Steady current, recording by recording; "
        "one: a current of 0.20 m/s (0.19–0.21 m/s) sets towards 40° (north-east); "
        "three: a current of 0.30 m/s (0.29–0.31 m/s) sets towards 299° (north-west); "
        "on two these data allow that there is none"
    )


def moved(
    *effects: str, changed: bool, ends: tuple[float, float], to: float = 70.0,
    may_hold: bool = False,
) -> str:  # fmt: skip
    """What is said of a base whose m11 went from 60 to 70 kg on the last step."""
    m11 = SimpleNamespace(name="m11", before=60.0, value=to, ci95=ends, unit="kg")
    last = SimpleNamespace(base_parameters=[m11], base=StepBase.KEPT)
    d: Any = SimpleNamespace(
        ladder=[last, last], base_changed=changed, effects=effects, base_may_hold=may_hold
    )
    return base_text(d)


def test_what_is_said_of_the_base_is_true_of_the_vessel_that_is_handed_over():
    far, near = (68.0, 72.0), (59.0, 81.0)
    for changed in (True, False):  # a base without the effect had to stand in for it
        beside = moved("hull_lift", changed=changed, ends=far)
        assert beside == (
            "fitted along with what was found, its numbers moved: m11 60 → 70 kg (+17 %)"
        )
    alone = moved(changed=True, ends=far)
    assert alone == "re-fitted, its numbers had to move: m11 60 → 70 kg (+17 %)"
    held = moved(changed=True, ends=far, may_hold=True)
    assert held.startswith("its numbers may hold as they were given; others do a little better: m")
    little = moved(changed=True, ends=(60.4, 61.6), to=61.0)
    assert little == "re-fitted, its numbers moved by less than 3 % each: m11 60 → 61 kg (+2 %)"
    for effects, ends in ((("hull_lift",), near), ((), far)):  # within its interval; not handed on
        assert "hold as they were given" in moved(*effects, changed=False, ends=ends)


@pytest.mark.parametrize(
    ("effect", "values", "intervals", "said"),
    [
        ("heading_offset", {"angle": 0.02}, {"angle": (-0.01, 0.05)}, True),
        ("heading_offset", {"angle": 0.02}, {"angle": (0.01, 0.05)}, False),
        ("thruster_imbalance", {"port_gain": 0.9}, {"port_gain": (0.7, 1.1)}, True),
        ("compass_deviation", {"b": 0.1, "c": 0.0}, {"b": (0.05, 0.15), "c": (-0.1, 0.1)}, False),
        ("compass_deviation", {"b": 0.1, "c": 0.0}, {"b": (-0.1, 0.3), "c": (-0.1, 0.1)}, True),
        ("heading_offset", {"angle": 0.02}, {}, False),  # nothing is known of it
        ("steady_wind", WIND, {"speed": (0.0, 1.3), "c_n": (0.01, 0.02)}, True),
        ("steady_wind", WIND, {"speed": (0.2, 1.3), "c_n": (-0.01, 0.02)}, False),
    ],
)
def test_what_may_be_nothing_at_all_is_not_told_as_a_finding(effect, values, intervals, said):
    numbers = [number(f"{effect}.{key}", values[key], ends) for key, ends in intervals.items()]
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


@pytest.mark.parametrize("alone", [True, False])
def test_a_curve_is_told_before_what_only_comes_near_to_it(alone):
    """Three sensor faults that were none were the headline, and a curve that was right was not."""
    answer = diagnosis(Verdict.UNKNOWN, "heading_offset")
    answer.curve = step("cg_offset" if alone else "heading_offset", error=0.05)
    answer.curve_stands_alone = alone
    first, looks, last = diagnosis_texts(answer)
    assert first == "Something is missing that the catalogue does not hold."
    assert looks.startswith("It looks like the c")
    if alone:
        assert last == "Nearest to it in the catalogue, but not it: heading offset."
    else:
        assert last == f"What helps beside it: {COMPASS}."
    assert not any("not enough" in text for text in diagnosis_texts(answer))


@pytest.mark.parametrize(
    ("m33", "changed", "first"),
    [
        (2.9, True, "Numbers of the vessel file are off: m33 8.7 → 2.9 kg m² (-67 %)."),
        (7.4, True, "Nothing is missing"),  # 15 %: as files are
        (2.9, False, "Nothing is missing"),  # the numbers as given do as well
    ],
)
def test_numbers_that_are_off_come_first_where_nothing_else_is(m33, changed, first):
    answer = diagnosis(Verdict.ADEQUATE, error=0.3)
    moved = Estimate("m33", "kg m²", 8.7, m33, (m33 - 0.1, m33 + 0.05), True)
    answer.ladder[-1].base_parameters, answer.base_changed = (moved,), changed
    texts = diagnosis_texts(answer)
    assert texts[0].startswith(first)
    assert texts[-1].endswith("is missing that these data could tell.")


def test_of_a_file_that_is_right_to_two_floors_no_number_is_said_to_be_off():
    """N_rr "-21 %" was said of an exact file under an EKF's and a GPS's drift."""
    answer = diagnosis(Verdict.ADEQUATE, error=0.19)
    moved = Estimate("m33", "kg m²", 8.7, 2.9, (2.8, 2.95), True)
    answer.ladder[-1].base_parameters, answer.base_changed = (moved,), True
    texts = diagnosis_texts(answer)
    assert texts[0] == "Nothing is missing that these data could tell."
    assert "m33 8.7 → 2.9 kg m² (-67 %)); errors of the measured velocities" in texts[1]
    assert not any("are off" in text for text in texts)


def test_numbers_that_a_refit_would_gain_by_are_not_said_to_hold():
    answer = diagnosis(Verdict.ADEQUATE)
    for base, said in (
        (StepBase.REFITTED, "stay as they were given: what a re-fit"),
        (StepBase.KEPT, "hold"),
    ):
        answer.ladder[1].base = base
        assert said in base_text(answer)


def test_what_may_be_none_is_told_after_what_is_sure():
    two = step("cg_offset", "heading_offset")
    two.parameters["cg_offset"] = [number("cg_offset.x_g", 0.1, (-0.1, 0.3))]
    answer = diagnosis(Verdict.EXPLAINED)
    answer.ladder[-1] = two
    first, last = diagnosis_texts(answer)
    assert first == f"{COMPASS}."
    assert last.startswith("The centre")
    assert last.endswith("; but these data allow that there is none.")


@pytest.mark.parametrize("alone", [None, True, False])
def test_what_may_be_none_is_no_headline_of_what_is_missing(alone):
    """ "Half throttle works like 54 %; but these data allow that there is none" was all of it."""
    answer = diagnosis(Verdict.UNKNOWN, "heading_offset", "cg_offset")
    nothing = {"cg_offset": [number("cg_offset.x_g", 0.1, (-0.1, 0.3))]}
    answer.ladder[-1].parameters |= nothing
    if alone is not None:
        answer.curve, answer.curve_stands_alone = step("cg_offset"), alone
        answer.curve.parameters |= nothing
    told = " ".join(diagnosis_texts(answer))
    assert "there is none" not in told
    assert ("how much of it these data do not tell." in told) == (alone is not None)
    assert (COMPASS in told) == (alone is not True)


CURRENT = {
    "speed": 0.25, "direction": 3.3, "later_speed": 0.4, "later_direction": 6.5, "time": 610.0
}  # fmt: skip


def a_day() -> Any:
    """A current that turned at 14:20:10 UTC, and a heading offset that did not."""
    effects = (AddedEffect(BY_NAME["current_change"], CURRENT),
               AddedEffect(BY_NAME["heading_offset"], VALUES["heading_offset"]))  # fmt: skip
    ends = {"time": (604.0, 618.0), "speed": (0.2, 0.3)}
    numbers = [number(f"current_change.{k}", CURRENT[k], v) for k, v in ends.items()]
    names = tuple(a.effect.name for a in effects)
    last = SimpleNamespace(
        effects=names, vessel=SimpleNamespace(effects=effects, name="boat"),
        parameters={"current_change": numbers, "heading_offset": []},
        heldout=SimpleNamespace(nrmse=0.1), base_parameters=(),
    )  # fmt: skip
    begun = int(datetime(2026, 5, 12, 14, 10, 0, tzinfo=UTC).timestamp()) * 10**9
    return SimpleNamespace(
        verdict=Verdict.EXPLAINED, effects=names, ladder=[last, last], noise_floor=0.1, ranking=[],
        alternatives=[], start_time_ns=begun, vessel=last.vessel,
    )  # fmt: skip


def test_a_moment_is_told_by_the_clock_where_there_is_one():
    day = a_day()
    assert diagnosis_texts(day)[0].startswith("Until 610 s (604–618 s), 14:20:10 UTC, a current")
    day.start_time_ns = 10**9  # a clock that was never set
    assert diagnosis_texts(day)[0].startswith("Until 610 s (604–618 s) a current")


def test_the_timeline_shows_what_changed_and_when():
    trials: Any = [SimpleNamespace(time=np.array([0.0, 1200.0]))]
    day = a_day()
    drawn = timeline(day, trials)
    assert drawn is not None
    assert [p.y.text for p in drawn.panels] == [
        "current change: speed [m/s]", "current change: direction [°]",
    ]  # fmt: skip
    for panel, ends in zip(drawn.panels, ((0.25, 0.4), (189.1, 12.4)), strict=True):
        lines = [mark for mark in panel.marks if isinstance(mark, Line)]
        np.testing.assert_allclose(lines[0].x, [0.0, 610.0 / 60.0, 610.0 / 60.0, 20.0])
        np.testing.assert_allclose(lines[0].y, np.repeat(ends, 2), atol=0.05)
        assert [round(60.0 * line.x[0]) for line in lines[1:]] == [604, 618]
    # of several recordings the first is drawn, with its own interval
    numbers = day.ladder[-1].parameters["current_change"]
    first = [SimpleNamespace(**{**vars(n), "trial": "one"}) for n in numbers]
    day.ladder[-1].parameters["current_change"] = [
        *first, number("current_change.time", 90.0, (80.0, 99.0), "two")
    ]  # fmt: skip
    again = timeline(day, trials)
    assert again is not None
    ends = [line.x[0] for line in again.panels[0].marks if isinstance(line, Line)][1:]
    assert [round(60.0 * end) for end in ends] == [604, 618]
    day.ladder[-1].effects = ("heading_offset",)  # nothing changed
    assert timeline(day, trials) is None


def rejected(*, alone: float, found: float = 0.12, base: float = 0.6, tied: bool = False) -> Any:
    """heading_offset was chosen; cg_offset was fitted too."""
    row = SimpleNamespace
    rows = [row(effect="heading_offset", probability=0.9,
                confounded_with=("cg_offset",) if tied else ()),
            row(effect="cg_offset", probability=0.01,
                confounded_with=("heading_offset",) if tied else ())]  # fmt: skip
    return SimpleNamespace(
        effects=("heading_offset",),
        ladder=[step(error=0.7), step(error=base), step("heading_offset", error=found)],
        alternatives=[step("cg_offset", error=alone)],
        ranking=rows, told_ranking=rows, best=step("heading_offset", error=found),
        refused=[Refusal("battery_sag", "the voltage hardly changed"),
                 Refusal("antenna_offset", "it wins nothing elsewhere", doubted=True)],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("d", "against", "says", "not_said"),
    [
        (rejected(alone=0.5), (), "is 0.500, without it 0.600, with heading offset 0.120",
         "no better"),
        (rejected(alone=0.61), (), "it predicts no better", "cannot tell"),
        (rejected(alone=0.13, tied=True), (), "these data cannot tell the two", "no better"),
        (rejected(alone=0.5), ("cg_offset",), "points away from what is missing", "no better"),
    ],
)  # fmt: skip
def test_why_a_cause_was_not_chosen_is_said_as_it_is(d, against, says, not_said):
    tried = ("heading_offset", "cg_offset", "battery_sag", "hull_lift", "antenna_offset")
    texts = why_not_texts(d, tried, against)
    assert set(texts) == {"cg_offset", "battery_sag", "hull_lift", "antenna_offset"}
    assert says in texts["cg_offset"]
    assert not_said not in texts["cg_offset"]
    assert "heading offset is 90.0 % probable, this one 1.0 %" in texts["cg_offset"]
    assert texts["battery_sag"] == "These data cannot show it: the voltage hardly changed."
    assert texts["antenna_offset"] == (
        "It would help here, and is not believed: it wins nothing elsewhere."
    )
    assert "it was not fitted" in texts["hull_lift"]


def test_of_a_curve_it_is_not_said_why_it_was_not_chosen():
    d = rejected(alone=0.05)
    d.best = d.alternatives[0]
    assert "cg_offset" not in why_not_texts(d, ("heading_offset", "cg_offset"))


def test_nothing_was_chosen_and_that_is_said_of_the_others_too():
    d = rejected(alone=0.5)
    d.effects, d.ladder, d.best = (), d.ladder[:2], d.ladder[1]
    assert "not enough to be sure of it" in why_not_texts(d, ())["cg_offset"]


def test_a_map_draws_what_is_known_where_the_boat_was() -> None:
    north, east = (x.ravel() for x in np.meshgrid([0.0, 10.0, 20.0], [0.0, 10.0], indexing="ij"))
    flows = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    half = np.array([0.05, 0.05, 0.05, 0.05, 0.05, 0.9])
    field = MapField(north, east, flows, np.zeros(6), half, "m/s")
    eta = np.stack([np.linspace(0.0, 20.0, 51), np.zeros(51), np.zeros(51)], axis=1)
    trial: Any = SimpleNamespace(eta=eta, usable=np.ones(51, bool))
    (panel,) = _map_figure("eddy", field, trial).panels
    track, arrows = panel.marks
    assert isinstance(track, Line)
    assert isinstance(arrows, Line)
    assert arrows.label == "what eddy supplies, at most 0.4 m/s"
    tails, tips = arrows.y[::6], arrows.y[1::6]
    np.testing.assert_allclose(tails, north[:5])  # of the last one hardly anything is known
    np.testing.assert_allclose(tips - tails, 8.0 * flows[:5] / 0.4)
    assert np.isnan(arrows.y[5::6]).all()
    far: Any = SimpleNamespace(eta=eta - [500.0, 0.0, 0.0], usable=np.ones(51, bool))
    none = _map_figure("eddy", field, far)
    assert len(none.panels[0].marks) == 1  # the track
    assert none.caption == "nowhere is it known well enough for an arrow"


def test_a_place_without_a_direction_colours_the_track() -> None:
    field = learned_drag.over_map(
        FittedValues({"north": 5.0, "east": 0.0, "radius": 2.0, "edge": 20.0, "more": 1.5})
    )
    eta = np.stack([np.linspace(0.0, 50.0, 501), np.zeros(501), np.zeros(501)], axis=1)
    trial: Any = SimpleNamespace(eta=eta, usable=np.ones(501, bool))
    (panel,) = _map_figure("learned_drag", field, trial).panels
    (points,) = panel.marks
    assert isinstance(points, ColouredPoints)
    north = np.abs(points.y - 5.0)
    np.testing.assert_allclose(points.value[north < 1.6], 150.0, rtol=0.01)
    assert points.value[north > 2.5].max() < 1.0
    assert points.scale.text == "learned_drag adds [%]"


def test_what_a_place_takes_away_is_coloured_as_that() -> None:
    """Where the compass is turned to port, too: colours are of sizes."""
    eta = np.stack([np.linspace(0.0, 40.0, 401), np.zeros(401), np.zeros(401)], axis=1)
    trial: Any = SimpleNamespace(eta=eta, usable=np.ones(401, bool))
    table = {f"f{k}": -0.3 * (k < 3) for k in range(9)}
    pier = FittedValues({"north": 20.0, "east": 0.0, "reach": 16.0, **EVENLY, **table})
    (panel,) = _map_figure("learned_anomaly", learned_anomaly.over_map(pier), trial).panels
    (points,) = panel.marks
    assert isinstance(points, ColouredPoints)
    assert points.scale.text == "learned_anomaly takes away [°]"
    away = np.abs(points.y - 20.0)
    np.testing.assert_allclose(points.value[away < 3.0], np.degrees(0.3), rtol=0.01)
    assert points.value[away > 8.0].max() == 0.0
