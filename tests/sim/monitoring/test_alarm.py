"""The alarm of a live model: silent on noise, once at the start, once at the end, with a cause."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from sim.model import Model
from sim.monitoring.alarm import (
    APART_S,
    PLACES,
    Alarm,
    ErrorByRegime,
    News,
    current,
    places_of,
    sentence,
)
from sim.monitoring.consistency import HIGH, Misfit, transition
from sim.monitoring.disturbances import Cause, Estimator
from sim.monitoring.live_second import Air, Balance, Moment
from tests.sim.monitoring.live_seconds import seconds
from tests.sim.voyages import WAM_V

STREAM = np.array([0.1, -0.28])


def linear(rate: np.ndarray) -> Balance:
    """A balance with that ∂ν̇/∂ν."""
    mass = np.diag([126.0, 121.0, 70.0])
    return Balance(np.zeros(3), np.zeros(3), -mass @ rate, mass)


SLOW = linear(-0.3 * np.eye(3))


@pytest.fixture(scope="module")
def estimator() -> Estimator:
    return Estimator.of(Model.of(WAM_V))


def off_by(moments: Iterable[Moment], size: float, rng: np.random.Generator) -> Iterable[Moment]:
    """Predictions over both horizons that are off by so much ahead, and by noise."""
    for moment in moments:
        errors = np.sqrt(2.0 * moment.variance) * rng.standard_normal((2, 3))
        errors[:, 0] += size
        yield replace(moment, errors=errors)


def watched(estimator: Estimator, moments: Iterable[Moment]):
    alarm, told = Alarm.start(estimator), []
    for moment in moments:
        before = alarm
        alarm, news = alarm.observe(estimator, moment)
        told += [(news, moment.time, alarm, before)] if news else []
    return alarm, told


def test_a_right_model_raises_nothing(estimator: Estimator) -> None:
    for seed in range(4):
        moments = off_by(seconds(300, seed=seed), 0.0, np.random.default_rng(seed))
        alarm, told = watched(estimator, moments)
        assert told == []
        assert alarm.misfit.level < 0.5 * HIGH


def test_a_current_that_sets_in_and_ends_is_told_with_its_cause(estimator: Estimator) -> None:
    rng = np.random.default_rng(2)
    calm = off_by(seconds(100), 0.0, rng)
    flow = off_by(seconds(300, stream=STREAM, first=100), 0.25, rng)
    again = off_by(seconds(100, first=400), 0.0, rng)
    _, told = watched(estimator, [*calm, *flow, *again])
    kinds = [news for news, *_ in told]
    assert kinds[0] is News.WRONG
    assert kinds[-1] is News.RIGHT
    assert kinds.count(News.WRONG) == kinds.count(News.RIGHT) == 1
    assert 100 <= told[0][1] <= 115
    assert 400 <= told[-1][1] <= 480
    assert 95 <= told[0][2].misfit.since <= 110
    explained = [alarm for news, _, alarm, _ in told if news is News.EXPLAINED]
    assert explained
    assert explained[0].because is Cause.CURRENT


def test_explanations_are_told_a_minute_apart_at_most(estimator: Estimator) -> None:
    rng = np.random.default_rng(3)
    flow = off_by(seconds(300, stream=STREAM), 0.25, rng)
    turned = off_by(seconds(300, stream=-STREAM, first=300), 0.25, rng)
    _, told = watched(estimator, [*flow, *turned])
    times = [time for news, time, *_ in told if news is News.EXPLAINED]
    assert len(times) >= 2
    assert min(np.diff(times)) >= APART_S


def test_few_headings_leave_the_cause_open(estimator: Estimator) -> None:
    flow = off_by(seconds(200, stream=STREAM, headings=1), 0.25, np.random.default_rng(4))
    alarm, told = watched(estimator, flow)
    assert alarm.because in (Cause.NOTHING, Cause.EITHER)
    assert next(news for news, *_ in told) is News.WRONG
    assert "looks like 0" not in sentence(told[0][0], told[0][2], estimator.air, "14:32 UTC")


def test_an_unstable_hull_is_no_wrong_model() -> None:
    """Where the start state's error grows, so does the floor."""
    moment = next(iter(seconds(1)))
    fast = linear(np.diag([0.0, 0.5, 0.0]))
    stable, unstable = Misfit(), Misfit()
    for k in range(40):
        off = np.tile([0.0, 0.12, 0.0], (2, 1))
        now = replace(moment, time=float(k), errors=off)
        stable = stable.observe(now, SLOW, (5, 10))
        unstable = unstable.observe(now, fast, (5, 10))
    assert stable.level > 3.0 * unstable.level
    assert not unstable.wrong


def test_after_a_jump_nothing_counts_until_predictions_are_new() -> None:
    moment = replace(next(iter(seconds(1))), errors=np.ones((2, 3)))
    misfit = Misfit()
    for _ in range(4):
        misfit = misfit.observe(moment, SLOW, (5, 10))
    assert misfit.level == 0.0
    assert np.isnan(misfit.z)


def test_a_command_whose_moment_is_not_known_is_no_wrong_model() -> None:
    moment = next(iter(seconds(1)))
    levels = []
    for changing in (True, False):
        misfit = Misfit()
        for k in range(60):
            force = np.array([100.0 * (k % 2 and changing), 0.0, 0.0])
            off = np.tile([0.14, 0.0, 0.0], (2, 1))
            now = replace(moment, time=float(k), errors=off, commanded=force)
            misfit = misfit.observe(now, SLOW, (5, 10))
        levels.append(misfit.level)
    assert levels[0] < 0.3 * levels[1]


def test_one_jolt_is_no_misfit() -> None:
    moment = next(iter(seconds(1)))
    misfit = Misfit()
    for k in range(60):
        errors = np.full((2, 3), 100.0 if k in (30, 31) else 0.0)
        misfit = misfit.observe(replace(moment, time=float(k), errors=errors), SLOW, (5, 10))
        assert not misfit.wrong


def test_a_transition_is_that_of_the_linear_model() -> None:
    A = np.array([[-0.4, 0.1, 0.0], [0.2, -0.8, 1.1], [0.0, 0.3, -2.5]])
    x, h = np.array([1.0, -2.0, 0.5]), 1e-4
    for _ in range(round(1.0 / h)):
        x = x + h * A @ x
    assert transition(A) @ np.array([1.0, -2.0, 0.5]) == pytest.approx(x, abs=0.02)


def test_the_worst_place_is_the_one_with_the_error() -> None:
    haunts = ErrorByRegime.start()
    for moment in seconds(400):
        west = abs(np.degrees(moment.yaw) % 360.0 - 270.0) < 22.5
        haunts = haunts.observe(moment, 20.0 if west else 0.5, 180.0)
    assert haunts.worst == "heading west"
    assert haunts.headings == 8


def test_an_error_that_is_everywhere_has_no_place() -> None:
    haunts = ErrorByRegime.start()
    for moment in seconds(400):
        haunts = haunts.observe(moment, 10.0, 180.0)
    assert haunts.worst == ""


@pytest.mark.parametrize(("degrees", "name"), [(0, "north"), (359, "north"), (268, "west"),
                                               (-91, "west"), (44, "north-east")])  # fmt: skip
def test_headings_are_named_after_the_nearest_point(degrees: float, name: str) -> None:
    moment = next(iter(seconds(1)))
    motion = moment.motion.copy()
    motion[2] = np.radians(degrees)
    assert PLACES[places_of(replace(moment, motion=motion), 180.0)[0]] == f"heading {name}"


def test_a_current_is_told_by_where_it_flows_to() -> None:
    assert current(np.array([0.078, 0.29])) == "0.3 m/s of current towards 075°"
    assert Air(0.0, 0.0, 4.9, 50.0).has_areas is False


def test_the_sentence_says_when_where_and_what(estimator: Estimator) -> None:
    alarm, told = watched(
        estimator, off_by(seconds(240, stream=STREAM), 0.25, np.random.default_rng(5))
    )
    says = sentence(News.EXPLAINED, alarm, estimator.air, "14:32:05 UTC")
    assert says.startswith("since 14:32:05 UTC the model is wrong")
    assert "m/s of current towards 29" in says or "m/s of current towards 28" in says
    assert told
