"""The alarm of a live model: silent on noise, once at the start, once at the end, with a cause."""

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from sim.model import Model
from sim.monitoring import SecondMeans, WindModel
from sim.monitoring.alarm import (
    DOUBTS,
    MIN_DOUBT_INTERVAL_S,
    MIN_INTERVAL_S,
    MIN_SECONDS,
    ONSET_S,
    Alarm,
    ModelEvent,
)
from sim.monitoring.causes import BOAT_ERRORS, Law
from sim.monitoring.consistency import WRONG_ABOVE, Misfit
from sim.monitoring.disturbances import Cause, DisturbanceEstimator
from sim.monitoring.regimes import REGIMES, ErrorByRegime, regimes_at
from sim.monitoring.sentences import ERRING_VELOCITIES, current_text, event_text, wind_text
from tests.sim.monitoring.live_seconds import seconds
from tests.sim.voyages import WAM_V

STREAM = np.array([0.1, -0.28])


@pytest.fixture(scope="module")
def estimator() -> DisturbanceEstimator:
    return DisturbanceEstimator.of(Model.of(WAM_V))


def off_by(
    voyage: Iterable[SecondMeans], size: float, rng: np.random.Generator
) -> Iterable[SecondMeans]:
    """Predictions over both horizons that are off by so much ahead, and by noise."""
    for second in voyage:
        errors = np.sqrt(2.0 * second.variance) * rng.standard_normal((2, 3))
        errors[:, 0] += size
        yield replace(second, errors=errors)


def watched(estimator: DisturbanceEstimator, voyage: Iterable[SecondMeans]):
    alarm, told = Alarm.start(estimator), []
    for second in voyage:
        before = alarm
        alarm, news = alarm.observe(estimator, second)
        told += [(news, second.time, alarm, before)] if news else []
    return alarm, told


def test_a_right_model_raises_nothing(estimator: DisturbanceEstimator) -> None:
    for seed in range(4):
        voyage = off_by(seconds(300, seed=seed), 0.0, np.random.default_rng(seed))
        alarm, told = watched(estimator, voyage)
        assert told == []
        assert alarm.misfit.level < 0.5 * WRONG_ABOVE


def test_of_a_boat_that_has_rebooted_nothing_is_wrong_until_it_is_seen_again(
    estimator: DisturbanceEstimator,
) -> None:
    rng = np.random.default_rng(2)
    flow = off_by(seconds(200, stream=STREAM), 0.25, rng)
    alarm, _ = watched(estimator, flow)
    assert alarm.misfit.wrong
    anew, calm = alarm.rebooted(), off_by(seconds(100, first=200), 0.0, rng)
    assert not anew.misfit.wrong
    assert anew.reported[0] is Cause.NOTHING
    for second in calm:
        anew, news = anew.observe(estimator, second)
        assert news is None
    again = alarm.rebooted()
    told = []
    for second in off_by(seconds(200, stream=STREAM, first=200), 0.25, rng):
        again, news = again.observe(estimator, second)
        told += [news] if news else []
    assert told[0] is ModelEvent.WRONG


@pytest.mark.parametrize("rests", [True, False])
def test_a_weak_motor_is_not_right_again_because_it_rests(
    estimator: DisturbanceEstimator, rests: bool
) -> None:
    """Disarmed: a boat adrift was told to be as the model says, its motor 67 % too strong."""
    rng = np.random.default_rng(4)
    strong = off_by(seconds(200, thrust=np.array([0.0, 0.6])), 0.25, rng)
    after = off_by(seconds(200, first=200), 0.0, rng)
    if rests:
        after = [replace(s, mean_commands=0.0 * s.mean_commands) for s in after]
    alarm, told = watched(estimator, [*strong, *after])
    assert [news for news, *_ in told].count(ModelEvent.RIGHT) == (0 if rests else 1)
    assert alarm.misfit.wrong is rests


@pytest.mark.parametrize(
    ("explanation", "resting", "adrift", "told"),
    [
        ((Cause.NOTHING, True), True, False, False),
        ((Cause.NOTHING, True), False, False, True),
        ((Cause.NOTHING, True), True, True, True),  # wrong of a boat that drifted all the time
        ((Cause.CURRENT, False), True, False, True),
    ],
)
def test_a_motor_that_was_named_stays_named_while_it_rests(
    estimator: DisturbanceEstimator, explanation: tuple[Cause, bool], resting: bool, adrift: bool,
    told: bool,
) -> None:  # fmt: skip
    """Disarmed beside PX4: "thruster right giving 46 % less" became "no one cause stands out"."""
    alarm = replace(
        Alarm.start(estimator), explanation=explanation, explanation_since=100.0,
        reported=(Cause.THRUST, False), reported_at=0.0, resting=resting, adrift=adrift,
        misfit=Misfit(recent=WRONG_ABOVE),
    )  # fmt: skip
    assert alarm._has_news(200.0) is told


def test_a_current_that_sets_in_and_ends_is_told_with_its_cause(
    estimator: DisturbanceEstimator,
) -> None:
    rng = np.random.default_rng(2)
    calm = off_by(seconds(100), 0.0, rng)
    flow = off_by(seconds(300, stream=STREAM, first=100), 0.25, rng)
    again = off_by(seconds(100, first=400), 0.0, rng)
    _, told = watched(estimator, [*calm, *flow, *again])
    kinds = [news for news, *_ in told]
    assert kinds[0] is ModelEvent.WRONG
    assert kinds[-1] is ModelEvent.RIGHT
    assert kinds.count(ModelEvent.WRONG) == kinds.count(ModelEvent.RIGHT) == 1
    assert 100 <= told[0][1] <= 115
    assert 400 <= told[-1][1] <= 480
    assert 95 <= told[0][2].misfit.since <= 110
    explained = [alarm for news, _, alarm, _ in told if news is ModelEvent.EXPLAINED]
    assert {alarm.cause for alarm in explained} <= {Cause.CURRENT, Cause.EITHER}
    named = next(alarm for alarm in explained if alarm.cause is Cause.CURRENT)
    assert named.estimate.time <= 160


def test_explanations_are_told_a_minute_apart_and_sooner_only_after_a_doubt(
    estimator: DisturbanceEstimator,
) -> None:
    rng = np.random.default_rng(3)
    flow = off_by(seconds(300, stream=STREAM), 0.25, rng)
    turned = off_by(seconds(300, stream=-STREAM, first=300), 0.25, rng)
    _, told = watched(estimator, [*flow, *turned])
    said = [(time, alarm.cause) for news, time, alarm, _ in told if news is ModelEvent.EXPLAINED]
    assert len(said) >= 2
    for (before, cause), (after, _) in pairwise(said):
        assert after - before >= (MIN_DOUBT_INTERVAL_S if cause in DOUBTS else MIN_INTERVAL_S)


@pytest.mark.parametrize(
    ("reported", "reported_at", "news_from"),
    [(Cause.NOTHING, 80.0, 106.0), (Cause.SEVERAL, 97.0, 107.0), (Cause.COMPASS, 97.0, 157.0)],
)
def test_an_explanation_is_told_when_it_has_lasted_and_the_last_one_is_long_ago_enough(
    estimator: DisturbanceEstimator, reported: Cause, reported_at: float, news_from: float
) -> None:
    """For six seconds; ten seconds after a doubt, a minute after a name."""
    alarm = replace(
        Alarm.start(estimator), explanation=(Cause.DRAG, False), explanation_since=100.0,
        reported=(reported, False), reported_at=reported_at,
    )  # fmt: skip
    assert not alarm._has_news(news_from - 0.1)
    assert alarm._has_news(news_from)


@pytest.mark.parametrize(
    ("time", "since", "cause"),
    [(111.9, 101.0, Cause.NOTHING), (112.0, 101.0, Cause.DRAG), (112.0, np.inf, Cause.NOTHING)],
)
def test_no_cause_is_named_in_the_first_seconds_of_trouble_nor_without_any(
    estimator: DisturbanceEstimator, time: float, since: float, cause: Cause
) -> None:
    alarm = Alarm.start(estimator)
    sure = alarm.estimate.scores.copy()
    sure[estimator.all.laws.index(Law.DRAG)] = 50.0
    means = alarm.estimate.means + 10.0 * estimator.all.prior
    estimate = replace(alarm.estimate, scores=sure, means=means, time=time, opened=100.0, driven=10)
    assert replace(alarm, estimate=estimate, misfit=Misfit(since=since)).cause is cause


def in_trouble(estimator: DisturbanceEstimator, headings: int, **nats: float) -> Alarm:
    """Since a minute, on so many headings, with scores of laws over the boat's own errors."""
    alarm, count = Alarm.start(estimator), len(ErrorByRegime.start().seconds)
    scores = np.array([nats.get(law.name.lower(), 0.0) for law in estimator.all.laws])
    means = alarm.estimate.means + 10.0 * estimator.all.prior
    estimate = replace(
        alarm.estimate, scores=scores, means=means, time=160.0, opened=100.0, driven=60
    )
    none, sailed = np.zeros(count), np.where(np.arange(8) < headings, 10.0, 0.0)
    errors = ErrorByRegime(none, none, sailed)
    return replace(alarm, estimate=estimate, misfit=Misfit(since=101.0), errors=errors)


@pytest.mark.parametrize(
    ("headings", "nats", "cause", "says"),
    [
        (2, {"current": 30.0, "wind": 18.0}, Cause.EITHER, r"looks like current or wind \("),
        (3, {"current": 30.0, "wind": 18.0}, Cause.CURRENT, r"looks like [\d.]+ m/s of current"),
        (2, {"current": 30.0, "wind": 12.0}, Cause.CURRENT, r"looks like [\d.]+ m/s of current"),
        (2, {"drag": 30.0, "current": 28.0, "wind": 18.0}, Cause.SEVERAL,
         r"looks like 8\d\d % more drag ahead or .* of current .* wind from .* N abeam: turns"),
        (3, {"drag": 30.0, "current": 28.0, "wind": 18.0}, Cause.SEVERAL,
         r"looks like 8\d\d % more drag ahead or [\d.]+ m/s of current towards \d+°: turns"),
    ],
)  # fmt: skip
def test_on_few_headings_a_current_is_told_beside_a_wind_that_does_not_do_far_worse(
    estimator: DisturbanceEstimator, headings: int, nats: dict[str, float], cause: Cause, says: str
) -> None:
    alarm = in_trouble(estimator, headings, **nats)
    assert alarm.cause is cause
    assert re.search(says, event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "now"))


@pytest.mark.parametrize(
    ("seconds_seen", "cause", "says"),
    [
        (MIN_SECONDS - 1, Cause.NOTHING, "too little seen so far to tell what it looks like"),
        (MIN_SECONDS, Cause.OTHER, "none of current, wind, thrusters, compass and drag explains"),
    ],
)
def test_a_wandering_force_is_none_of_the_causes_only_after_minutes(
    estimator: DisturbanceEstimator, seconds_seen: int, cause: Cause, says: str
) -> None:
    """Drag that grows over some seconds looks like one at first."""
    alarm = in_trouble(estimator, 3, anything=40.0, drag=20.0)
    estimate = replace(alarm.estimate, count=500, time=alarm.estimate.opened + seconds_seen)
    alarm = replace(alarm, estimate=estimate)
    assert alarm.cause is cause
    assert says in event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "now")


@pytest.mark.parametrize(
    ("seconds_seen", "headings", "says"),
    [
        (MIN_SECONDS - 1, 3, "too little seen so far to tell what it looks like"),
        (MIN_SECONDS, 2, "too little seen so far to tell what it looks like"),
        (MIN_SECONDS, 3, f"no one cause stands out{ERRING_VELOCITIES}"),
    ],
)
def test_a_compass_that_is_hardly_off_is_not_blamed(
    estimator: DisturbanceEstimator, seconds_seen: int, headings: int, says: str
) -> None:
    """Of weak thrust an error of 1° predicted a little better than the boat's own small errors."""
    alarm = in_trouble(estimator, headings, compass=15.0)
    means = alarm.estimate.means / 10.0  # one standard deviation from nothing
    end = alarm.estimate.opened + seconds_seen
    estimate = replace(alarm.estimate, means=means, count=500, time=end)
    alarm = replace(alarm, estimate=estimate)
    assert alarm.likely == (Cause.COMPASS,)
    text = event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "now")
    assert text.endswith(says)
    assert alarm.cause in DOUBTS


def test_what_comes_nearest_is_told_where_nothing_stands_out(
    estimator: DisturbanceEstimator,
) -> None:
    """Of a weak motor "none of current, wind, thrusters …" was told: the right one came nearest."""

    def said(**nats: float) -> str:
        alarm = in_trouble(estimator, 3, **nats)
        estimate = replace(alarm.estimate, count=500, time=alarm.estimate.opened + MIN_SECONDS)
        alarm = replace(alarm, estimate=estimate)
        assert alarm.cause is Cause.NOTHING
        return event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "now")

    nearest = "no one cause stands out, nearest comes 800 % more drag ahead"
    assert said(drag=5.0).endswith(nearest + ERRING_VELOCITIES)
    assert said(drag=1.9).endswith("no one cause stands out" + ERRING_VELOCITIES)
    assert said(anything=9.0).endswith("no one cause stands out" + ERRING_VELOCITIES)


@pytest.mark.parametrize(
    ("scores", "shares", "says"),
    [
        ((30.0, 0.0, 20.0), (-0.5, 0.1, -0.2), "looks like thruster left giving 50 % less thrust"),
        ((20.0, 18.0, 0.0), (-0.5, -0.4, 0.1),
         "looks like thruster left or right giving 50 % less thrust"),
        ((0.0, 0.0, 40.0), (-0.5, 0.1, -0.3), "looks like all thrusters giving 30 % less thrust"),
        # one that pushes half as much again is none, where all do as well
        ((20.0, 18.0, 17.0), (1.4, 1.4, 0.8), "looks like all thrusters giving 80 % more thrust"),
        ((30.0, 18.0, 17.0), (1.4, 1.4, 0.8), "looks like thruster left giving 140 % more thrust"),
        # … and all of them by next to nothing are not told in its place
        ((20.0, 0.0, 22.0), (-0.5, 0.1, -0.02), "looks like thruster left giving 50 % less thrust"),
        ((20.0, 0.0, 22.0), (1.4, 0.1, 0.02), "looks like thruster left giving 140 % more thrust"),
        ((30.0, 0.0, 20.0), (-1.05, 0.1, -0.2), "looks like thruster left giving no thrust"),
        ((30.0, 0.0, 20.0), (-0.89, 0.1, -0.2), "looks like thruster left giving 89 % less thrust"),
        ((30.0, 0.0, 20.0), (-1.9, 0.1, -0.2), "looks like thruster left pushing the other way"),
    ],
)  # fmt: skip
def test_one_thruster_several_or_all_are_told_by_what_each_explains(
    estimator: DisturbanceEstimator, scores: tuple[float, ...], shares: tuple[float, ...], says: str
) -> None:
    alarm = in_trouble(estimator, 3)
    which = [f for f, law in enumerate(estimator.all.laws) if law is Law.THRUST]
    estimate = alarm.estimate
    for f, score, share in zip(which, scores, shares, strict=True):
        estimate.scores[f] = score
        estimate.means[f, BOAT_ERRORS] = share
        estimate.covariances[f, BOAT_ERRORS, BOAT_ERRORS] = 0.02**2
    assert alarm.cause is Cause.THRUST
    assert event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "now").endswith(says)


@pytest.mark.parametrize(
    ("reported", "nats", "cause"),
    [
        (Cause.DRAG, {"drag": 5.0}, Cause.DRAG),  # evidence fades: what was told is true still
        (Cause.DRAG, {"drag": 3.9}, Cause.NOTHING),
        (Cause.NOTHING, {"drag": 5.0}, Cause.NOTHING),
        (Cause.SEVERAL, {"drag": 5.0}, Cause.NOTHING),
        (Cause.DRAG, {"drag": 5.0, "compass": 11.0}, Cause.COMPASS),
        (Cause.DRAG, {"drag": 5.0, "anything": 20.0}, Cause.OTHER),
    ],
)
def test_a_name_stays_until_something_else_explains_it_better(
    estimator: DisturbanceEstimator, reported: Cause, nats: dict[str, float], cause: Cause
) -> None:
    alarm = in_trouble(estimator, 3, **nats)
    estimate = replace(alarm.estimate, count=500, time=alarm.estimate.opened + MIN_SECONDS)
    assert replace(alarm, estimate=estimate, reported=(reported, False)).cause is cause


def test_a_drag_that_has_come_to_drive_the_boat_is_no_name_any_more(
    estimator: DisturbanceEstimator,
) -> None:
    alarm = replace(in_trouble(estimator, 3, drag=5.0), reported=(Cause.DRAG, False))
    estimate = replace(alarm.estimate, count=500, time=alarm.estimate.opened + MIN_SECONDS)
    f = estimator.all.laws.index(Law.DRAG)
    for growth, cause in ((-0.9, Cause.DRAG), (-1.5, Cause.NOTHING)):
        estimate.means[f, BOAT_ERRORS] = growth
        estimate.covariances[f, BOAT_ERRORS, BOAT_ERRORS] = 0.01
        assert replace(alarm, estimate=replace(estimate)).cause is cause


@pytest.mark.parametrize("late", [0, 1, 3, 4])
@pytest.mark.parametrize("thrust", [-0.5, 0.6])
def test_trouble_begins_where_it_set_in_not_where_it_was_noticed(
    estimator: DisturbanceEstimator, late: int, thrust: float
) -> None:
    """Predictions end badly some seconds after a thruster failed at 100 s."""
    rng = np.random.default_rng(2)
    calm = off_by(seconds(100), 0.0, rng)
    ill = list(seconds(20, first=100, thrust=np.array([thrust, 0.0])))
    voyage = [*calm, *off_by(ill[:late], 0.0, rng), *off_by(ill[late:], 0.6, rng)]
    alarm, told = watched(estimator, voyage)
    assert told[0][1] >= 100 + late
    assert 99 <= alarm.estimate.opened <= 101


def test_seconds_before_a_gap_are_no_part_of_trouble_after_it(
    estimator: DisturbanceEstimator,
) -> None:
    alarm, _ = watched(estimator, seconds(100))
    assert len(alarm.before) == ONSET_S + 1
    assert alarm.after_gap().before == ()


def test_few_headings_leave_the_cause_open(estimator: DisturbanceEstimator) -> None:
    flow = off_by(seconds(200, stream=STREAM, headings=1), 0.25, np.random.default_rng(4))
    alarm, told = watched(estimator, flow)
    assert alarm.cause in (Cause.NOTHING, Cause.EITHER, Cause.SEVERAL)
    assert next(news for news, *_ in told) is ModelEvent.WRONG
    assert "looks like 0" not in event_text(told[0][0], told[0][2], estimator.air, "14:32 UTC")


WRONGS: dict[str, tuple[dict[str, Any], str]] = {
    "current": ({"stream": STREAM}, r"looks like 0\.3\d* m/s of current towards 2[89]\d°"),
    "port": ({"thrust": np.array([-0.5, 0.0])}, r"looks like thruster left giving [45]\d % less"),
    "starboard": ({"thrust": np.array([0.0, 0.6])}, r"thruster right giving [56]\d % more thrust"),
    "all weak": (
        {"thrust": np.array([-0.4, -0.4])},
        r"looks like all thrusters giving [34]\d % less",
    ),
    "all strong": (
        {"thrust": np.array([0.9, 0.9])},
        r"like all thrusters giving [789]\d % more thr",
    ),
    "compass": ({"compass": 0.2}, r"the compass reading 1[0-3]° too far to starboard"),
    "compass to port": ({"compass": -0.2}, r"the compass reading 1[0-3]° too far to port"),
    "drag": ({"drag": 0.8}, r"looks like [78]\d % more drag ahead"),
    "other": ({}, "none of current, wind, thrusters, compass and drag explains it"),
}


@pytest.fixture(scope="module")
def sentences(estimator: DisturbanceEstimator) -> dict[str, list[str]]:
    """What is told of each wrong, that sets in after two minutes and lasts for four."""
    found = {}
    for name, (wrong, _) in WRONGS.items():
        rng, said = np.random.default_rng(6), list[str]()
        ill = list(seconds(240, first=120, **wrong))
        if name == "other":
            waves = [60.0 * np.sin(2.0 * np.pi * k / 47.0) for k in range(240)]
            ill = [
                replace(s, missing=s.missing + np.array([0.0, wave, 0.0]))
                for s, wave in zip(ill, waves, strict=True)
            ]
        voyage = [*off_by(seconds(120), 0.0, rng), *off_by(ill, 0.25, rng)]
        _, told = watched(estimator, voyage)
        said = [event_text(news, alarm, estimator.air, "now") for news, _, alarm, _ in told]
        found[name] = said
    return found


@pytest.mark.parametrize("name", WRONGS)
def test_each_wrong_is_said_in_its_own_words_and_in_no_others(
    name: str, sentences: dict[str, list[str]]
) -> None:
    assert any(re.search(WRONGS[name][1], text) for text in sentences[name]), sentences[name]
    for other, said in sentences.items():
        if other != name:
            assert not any(re.search(WRONGS[name][1], text) for text in said), (other, said)


def test_nothing_is_named_in_the_first_seconds(sentences: dict[str, list[str]]) -> None:
    for said in sentences.values():
        assert said[0].endswith("too little seen so far to tell what it looks like")


@pytest.mark.parametrize("told", [Cause.EITHER, Cause.SEVERAL, Cause.NOTHING])
@pytest.mark.parametrize("too_early", [False, True])
def test_what_was_told_is_not_taken_back_as_too_little_seen(
    estimator: DisturbanceEstimator, told: Cause, too_early: bool
) -> None:
    """A boat adrift in a current: after "current or wind" came "too little seen so far"."""
    alarm = in_trouble(estimator, 3)
    now = replace(
        alarm, reported=(told, False), explanation=(Cause.NOTHING, not too_early),
        explanation_since=0.0, reported_at=0.0,
    )  # fmt: skip
    assert now._has_news(1000.0) is not too_early


def test_on_one_heading_a_wrong_is_left_open(estimator: DisturbanceEstimator) -> None:
    rng = np.random.default_rng(8)
    voyage = off_by(seconds(200, stream=STREAM, headings=1), 0.25, rng)
    _, told = watched(estimator, voyage)
    said = [event_text(news, alarm, estimator.air, "now") for news, _, alarm, _ in told]
    assert any(": turns, other headings and speeds tell" in s or "other headings tell" in s
               or "too little seen" in s for s in said)  # fmt: skip
    assert not any(re.search(r"looks like 0\.\d+ m/s of current towards \d+°$", s) for s in said)


def test_the_worst_place_is_the_one_with_the_error() -> None:
    errors = ErrorByRegime.start()
    for second in seconds(400):
        west = abs(np.degrees(second.yaw) % 360.0 - 270.0) < 22.5
        errors = errors.observe(second, 20.0 if west else 0.5, 180.0)
    assert errors.worst == "heading west"
    assert errors.headings == 8


def test_an_error_that_is_everywhere_has_no_place() -> None:
    errors = ErrorByRegime.start()
    for second in seconds(400):
        errors = errors.observe(second, 10.0, 180.0)
    assert errors.worst == ""


@pytest.mark.parametrize(("degrees", "name"), [(0, "north"), (359, "north"), (268, "west"),
                                               (-91, "west"), (44, "north-east")])  # fmt: skip
def test_headings_are_named_after_the_nearest_point(degrees: float, name: str) -> None:
    second = next(iter(seconds(1)))
    motion = second.motion.copy()
    motion[2] = np.radians(degrees)
    assert REGIMES[regimes_at(replace(second, motion=motion), 180.0)[0]] == f"heading {name}"


def test_a_current_is_told_by_where_it_flows_to() -> None:
    assert current_text(np.array([0.078, 0.29])) == "0.3 m/s of current towards 075°"
    assert WindModel(0.0, 0.0, 4.9, 50.0).has_areas is False


def test_the_sentence_says_when_where_and_what(estimator: DisturbanceEstimator) -> None:
    alarm, told = watched(
        estimator, off_by(seconds(240, stream=STREAM), 0.25, np.random.default_rng(5))
    )
    says = event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "14:32:05 UTC")
    assert says.startswith("since 14:32:05 UTC the model is wrong")
    assert "m/s of current towards 29" in says or "m/s of current towards 28" in says
    assert told


def test_a_second_without_finite_numbers_is_a_gap(estimator: DisturbanceEstimator) -> None:
    first, second = seconds(2)
    alarm, _ = Alarm.start(estimator).observe(estimator, first)
    missing = second.missing.copy()
    missing[0] = np.nan
    after, event = alarm.observe(estimator, replace(second, missing=missing))
    assert event is None
    assert after.estimate is alarm.estimate
    assert len(after.misfit.past) == 0


def test_a_model_that_cannot_be_solved_is_a_gap(estimator: DisturbanceEstimator) -> None:
    class Singular(DisturbanceEstimator):
        def observe(self, estimate, second):
            after, balance = super().observe(estimate, second)
            return after, replace(balance, slope_nu_dot=np.zeros((3, 3)))

    still = Singular(estimator.model, estimator.air, estimator.prior, estimator.all, estimator.hull)
    alarm, event = Alarm.start(still).observe(still, next(iter(seconds(1))))
    assert event is None
    assert alarm.estimate.count == 0


def test_what_has_become_small_is_not_held_against_a_larger_noise(
    estimator: DisturbanceEstimator,
) -> None:
    """ "off by 0.29 m/s ahead, noise explains 0.46: looks like …" was told."""
    alarm = in_trouble(estimator, 3, drag=30.0)

    def said(size: float) -> str:
        squares = np.array([size**2, 0.0, 0.0])
        misfit = Misfit(since=101.0, squares=squares, floors=np.full(3, 0.01), weight=1.0)
        return event_text(ModelEvent.EXPLAINED, replace(alarm, misfit=misfit), estimator.air, "now")

    assert "(after 5 s off by 0.15 m/s ahead, noise explains 0.1)" in said(0.15)
    assert "(of late hardly further off than noise explains)" in said(0.14)
    assert "noise explains 0" not in said(0.05)


@pytest.mark.parametrize(
    ("channel", "size", "says"),
    [(0, 0.2, True), (1, 0.2, True), (2, 0.2, False), (0, 0.3, False)],
    ids=["ahead", "sideways", "turning", "far off"],
)
def test_a_receiver_is_suspected_where_velocities_are_a_little_off_and_nothing_explains_it(
    estimator: DisturbanceEstimator, channel: int, size: float, says: bool
) -> None:
    alarm = in_trouble(estimator, 3)
    estimate = replace(alarm.estimate, count=500, time=alarm.estimate.opened + MIN_SECONDS)
    squares = np.zeros(3)
    squares[channel] = size**2
    misfit = Misfit(since=101.0, squares=squares, floors=np.full(3, 1e-4), weight=1.0)
    alarm = replace(alarm, estimate=estimate, misfit=misfit)
    text = event_text(ModelEvent.EXPLAINED, alarm, estimator.air, "now")
    assert "no one cause stands out" in text
    assert text.endswith(ERRING_VELOCITIES) is says


def test_a_force_of_hundreds_of_newtons_is_told_in_figures() -> None:
    """ "wind from 150° that pushes with 1.5e+02 N abeam" was told."""
    air = WindModel(2.0, 3.0, 5.0, 144.0, given=False)
    assert wind_text(np.array([80.0, 0.0]), air) == "wind from 180° that pushes with 120 N abeam"


def test_headings_adrift_and_before_the_trouble_tell_no_water_from_air(
    estimator: DisturbanceEstimator,
) -> None:
    """Of a boat adrift in a wind, after a mission on all headings, a current was told alone."""
    errors = ErrorByRegime.start()
    for second in seconds(100):
        errors = errors.observe(second, 1.0, 100.0)
    assert errors.headings == 5
    anew = errors.reopened()
    assert anew.headings == 0
    np.testing.assert_array_equal(anew.seconds, errors.seconds)
    for second in seconds(100):
        anew = anew.observe(second, 1.0, 100.0, drives=False)
    assert anew.headings == 0
    for second in seconds(40):
        anew = anew.observe(second, 1.0, 100.0)
    assert anew.headings == 2


@pytest.mark.parametrize(
    ("explanation", "reported", "recent", "told"),
    [
        ((Cause.NOTHING, True), Cause.CURRENT, 2.9, False),
        ((Cause.NOTHING, True), Cause.CURRENT, 3.1, True),
        ((Cause.NOTHING, True), Cause.SEVERAL, 2.9, True),
        ((Cause.DRAG, False), Cause.CURRENT, 2.9, True),
    ],
)
def test_nothing_is_told_of_a_cause_that_has_just_ended(
    estimator: DisturbanceEstimator, explanation: tuple[Cause, bool], reported: Cause,
    recent: float, told: bool,
) -> None:  # fmt: skip
    """After a current had stopped "no one cause stands out" came before "right again"."""
    alarm = replace(
        Alarm.start(estimator), explanation=explanation, explanation_since=100.0,
        reported=(reported, False), reported_at=0.0, misfit=Misfit(recent=recent),
    )  # fmt: skip
    assert alarm._has_news(200.0) is told
