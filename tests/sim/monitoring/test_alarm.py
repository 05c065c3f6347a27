"""The alarm of a live model: silent on noise, once at the start, once at the end, with a cause."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from sim.model import Model
from sim.monitoring.alarm import (
    MIN_INTERVAL_S,
    REGIMES,
    Alarm,
    ErrorByRegime,
    ModelEvent,
    current_text,
    event_text,
    regimes_at,
)
from sim.monitoring.consistency import WRONG_ABOVE
from sim.monitoring.disturbances import Cause, DisturbanceEstimator
from sim.monitoring.live_second import SecondMeans, WindModel
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
    assert explained
    assert explained[0].cause is Cause.CURRENT


def test_explanations_are_told_a_minute_apart_at_most(estimator: DisturbanceEstimator) -> None:
    rng = np.random.default_rng(3)
    flow = off_by(seconds(300, stream=STREAM), 0.25, rng)
    turned = off_by(seconds(300, stream=-STREAM, first=300), 0.25, rng)
    _, told = watched(estimator, [*flow, *turned])
    times = [time for news, time, *_ in told if news is ModelEvent.EXPLAINED]
    assert len(times) >= 2
    assert min(np.diff(times)) >= MIN_INTERVAL_S


def test_few_headings_leave_the_cause_open(estimator: DisturbanceEstimator) -> None:
    flow = off_by(seconds(200, stream=STREAM, headings=1), 0.25, np.random.default_rng(4))
    alarm, told = watched(estimator, flow)
    assert alarm.cause in (Cause.NOTHING, Cause.EITHER)
    assert next(news for news, *_ in told) is ModelEvent.WRONG
    assert "looks like 0" not in event_text(told[0][0], told[0][2], estimator.air, "14:32 UTC")


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
    assert after.misfit.past == ()


def test_a_model_that_cannot_be_solved_is_a_gap(estimator: DisturbanceEstimator) -> None:
    class Singular(DisturbanceEstimator):
        def observe(self, estimate, second):
            after, balance = super().observe(estimate, second)
            return after, replace(balance, slope_nu_dot=np.zeros((3, 3)))

    still = Singular(estimator.model, estimator.air, estimator.prior)
    alarm, event = Alarm.start(still).observe(still, next(iter(seconds(1))))
    assert event is None
    assert alarm.estimate.count == 0
