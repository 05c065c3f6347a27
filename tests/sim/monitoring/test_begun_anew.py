"""Causes that end, begin and come together while the model stays wrong."""

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim.model import Model
from sim.monitoring import SecondMeans
from sim.monitoring.alarm import MIN_ADRIFT_S, Alarm, ModelEvent
from sim.monitoring.begun_anew import (
    LASTS_S,
    MIN_SCORE_ANEW_NATS,
    SOON_FACTOR,
    SOON_S,
    BegunAnew,
    of_what_is_known,
    simpler,
)
from sim.monitoring.causes import Law
from sim.monitoring.disturbances import AIR, WATER, Cause, DisturbanceEstimator, KnownCause
from sim.monitoring.sentences import event_text
from tests.sim.monitoring.live_seconds import seconds
from tests.sim.monitoring.test_alarm import off_by
from tests.sim.voyages import WAM_V

STREAM = np.array([0.1, -0.28])
CURRENT: dict[str, Any] = {"stream": STREAM}
DRAG: dict[str, Any] = {"drag": 0.8}
NOISE = np.full(3, 0.2)
PORT: dict[str, Any] = {"thrust": np.array([-0.5, 0.0])}


@pytest.fixture(scope="module")
def estimator() -> DisturbanceEstimator:
    return DisturbanceEstimator.of(Model.of(WAM_V))


def sailed(*parts: tuple[int, dict[str, Any]]) -> list[SecondMeans]:
    """Parts of a voyage, each so many seconds with what is wrong there; off by 0.25 m/s where
    something is.
    """
    rng, first, out = np.random.default_rng(6), 0, list[SecondMeans]()
    for count, wrong in parts:
        part = seconds(count, first=first, **wrong)
        out += off_by(part, 0.25 if wrong else 0.0, rng)
        first += count
    return out


def watched(
    estimator: DisturbanceEstimator, voyage: Iterable[SecondMeans]
) -> list[tuple[float, str, Alarm]]:
    """When something was told, what, and the alarm then."""
    alarm, told = Alarm.start(estimator), []
    for second in voyage:
        alarm, news = alarm.observe(estimator, second)
        if news is not None:
            text = event_text(news, alarm, estimator.air, "then")
            told.append((second.time, text, alarm))
    return told


@pytest.mark.parametrize(
    ("before", "after", "name", "gone"),
    [
        (CURRENT, DRAG, "more drag ahead", "of current"),
        (DRAG, CURRENT, "of current towards", "drag"),
        (CURRENT, PORT, "thruster left giving", "of current"),
        (PORT, CURRENT, "of current towards", "thruster"),
    ],
)
def test_a_cause_that_begins_as_another_ends_is_named_in_its_place(
    estimator: DisturbanceEstimator, before: dict[str, Any], after: dict[str, Any], name: str,
    gone: str,
) -> None:  # fmt: skip
    """A stranger's drag was "0.0097 m/s of current" for five minutes: a current had been there."""
    told = watched(estimator, sailed((120, {}), (200, before), (200, after)))
    assert any(f"looks like 0.3 m/s {gone}" in text or gone in text for _, text, _ in told[:3])
    late = [(time, text) for time, text, _ in told if time > 320]
    at = next(time for time, text in late if name in text and gone not in text)
    assert at - 320 < 90
    assert all(gone not in text for time, text in late if time > at)


def test_a_second_cause_is_told_beside_the_first_which_is_not_forgotten(
    estimator: DisturbanceEstimator,
) -> None:
    """A motor at 60 % was replaced by a current that came, and was thought whole again."""
    told = watched(estimator, sailed((120, {}), (200, PORT), (200, PORT | CURRENT)))
    assert "looks like thruster left giving" in told[1][1]
    time, text, alarm = told[-1]
    assert 320 < time < 420
    assert re.search(r"looks like 0\.\d+ m/s of current towards (2[789]|30)\d°, beside thr", text)
    assert re.search(r"beside thruster left giving (4[89]|5[012]) % less thrust$", text)
    assert alarm.cause is Cause.CURRENT
    assert [one.cause for one in alarm.beside] == [Cause.THRUST]
    np.testing.assert_allclose(alarm.estimate.around(WATER), STREAM, atol=0.15)
    assert sum("beside" in text for _, text, _ in told) == len(told) - 2


def test_what_a_cause_left_is_not_told_beside_the_next_trouble(
    estimator: DisturbanceEstimator,
) -> None:
    voyage = sailed((120, {}), (200, PORT), (120, PORT | CURRENT), (300, {}), (200, DRAG))
    told = watched(estimator, voyage)
    again = [text for time, text, _ in told if time > 450]
    assert "the model is right again" in again[0]
    assert all("beside" not in text for text in again)
    assert "more drag ahead" in again[-1]


def test_one_cause_that_lasts_is_told_once(estimator: DisturbanceEstimator) -> None:
    for wrong in (CURRENT, DRAG, PORT):
        told = watched(estimator, sailed((120, {}), (900, wrong)))
        assert len(told) <= 3, [text for _, text, _ in told]
        assert all(time < 160 for time, _, _ in told)


@pytest.mark.parametrize("law", [Law.CURRENT, Law.DRAG, Law.THRUST, Law.COMPASS, Law.WIND])
def test_beside_a_cause_that_is_known_a_second_is_as_it_would_be_without_it(
    estimator: DisturbanceEstimator, law: Law
) -> None:
    """The same voyage with and without it, from the same dice."""
    f = estimator.all.laws.index(law)
    wrong: dict[Law, tuple[dict[str, Any], list[float]]] = {
        Law.CURRENT: (CURRENT, STREAM.tolist()),
        Law.DRAG: (DRAG, [0.8]),
        Law.THRUST: (PORT, [-0.5]),
        Law.COMPASS: ({"compass": 0.2}, [0.2]),
        Law.WIND: ({"push": np.zeros(2)}, [0.0, 0.0]),
    }
    start = estimator.start()
    size = wrong[law][1]
    start.means[f, 10 : 10 + len(size)] = size
    start.scores[f] = 50.0
    known = KnownCause(
        {Law.CURRENT: Cause.CURRENT, Law.DRAG: Cause.DRAG, Law.THRUST: Cause.THRUST,
         Law.COMPASS: Cause.COMPASS, Law.WIND: Cause.WIND}[law], start
    )  # fmt: skip
    assert (known.law, known.size.tolist()) == (law, size)
    for ill, well in zip(seconds(20, **wrong[law][0]), seconds(20), strict=True):
        without = estimator.without(ill, (known,))
        np.testing.assert_allclose(without.missing, well.missing, atol=1.5)
        if law is Law.CURRENT:
            np.testing.assert_allclose(without.nu, well.nu, atol=1e-9)
        if law is Law.COMPASS:
            assert without.yaw == pytest.approx(ill.yaw - 0.2)
            speed = np.hypot(*ill.nu[:2])
            assert np.hypot(*without.nu[:2]) == pytest.approx(speed)


def test_a_current_that_is_known_is_told_with_what_it_has_gained(
    estimator: DisturbanceEstimator,
) -> None:
    start = estimator.start()
    start.means[WATER, 10:12] = STREAM
    start.scores[WATER] = 50.0
    beside = estimator.reopened(start, 0.0, (KnownCause(Cause.CURRENT, start),))
    np.testing.assert_allclose(beside.around(WATER), STREAM)
    beside.means[WATER, 10:12] = [0.05, 0.0]
    np.testing.assert_allclose(beside.around(WATER), np.array([0.15, -0.28]))
    np.testing.assert_allclose(beside.around(AIR), 0.0)


def test_what_is_known_is_not_looked_for_again(estimator: DisturbanceEstimator) -> None:
    """A current beside a current, or all motors beside one of them, would be the same once more."""
    start = estimator.start()
    start.scores[estimator.all.laws.index(Law.THRUST)] = 50.0
    beside = estimator.reopened(start, 0.0, (KnownCause(Cause.THRUST, start),))
    told = [(kind, beside.all.names[f]) for score, kind, f in beside.named if np.isfinite(score)]
    assert (Cause.CURRENT, "") in told
    assert Cause.THRUST not in {kind for kind, _ in told}  # adrift yet
    driven = replace(beside, driven=60)
    told = [(kind, driven.all.names[f]) for score, kind, f in driven.named if np.isfinite(score)]
    assert {name for kind, name in told if kind is Cause.THRUST} == {"right"}


def test_it_begins_anew_beside_all_that_is_known_all_but_one_of_it_and_nothing(
    estimator: DisturbanceEstimator,
) -> None:
    start = estimator.start()
    a, b, c = (KnownCause(cause, start) for cause in (Cause.CURRENT, Cause.DRAG, Cause.COMPASS))

    def sets(*known: KnownCause) -> set[tuple[Cause, ...]]:
        each = of_what_is_known(estimator, start, start, known, start.noise)
        return {tuple(one.cause for one in anew.estimate.beside) for anew in each}

    current, drag, compass = Cause.CURRENT, Cause.DRAG, Cause.COMPASS
    assert sets() == {()}
    assert sets(a) == {(), (current,)}
    assert sets(a, b) == {(), (current,), (drag,), (current, drag)}
    assert sets(a, b, c) == {(), (drag,), (compass,), (drag, compass)}  # no more than two


@pytest.mark.parametrize(
    ("law", "score", "over", "gain"),
    [
        (Law.DRAG, 20.0, False, 17.0),
        (Law.ANYTHING, 20.0, False, -np.inf),  # a force that wanders is no explanation
        (Law.ANYTHING, 20.0, True, 4.0),  # … but what was told may have ended
    ],
)
def test_only_a_cause_or_its_end_takes_over(
    estimator: DisturbanceEstimator, law: Law, score: float, over: bool, gain: float
) -> None:
    start = replace(estimator.start(), driven=60)
    start.scores[:] = -5.0
    start.scores[estimator.all.laws.index(Law.NOTHING)] = 7.0
    start.scores[estimator.all.laws.index(law)] = score
    assert BegunAnew(start, over, NOISE, 3.0).gain == gain
    assert not BegunAnew(start, over, NOISE, score - MIN_SCORE_ANEW_NATS + 0.1).is_better(1e9)


def test_what_changes_often_is_asked_for_more(estimator: DisturbanceEstimator) -> None:
    start = replace(estimator.start(), driven=60)
    start.scores[estimator.all.laws.index(Law.DRAG)] = 1.01 * MIN_SCORE_ANEW_NATS
    anew = BegunAnew(start, True, NOISE)
    assert anew.is_better(SOON_S)
    assert not anew.is_better(SOON_S - 1.0)
    start.scores[estimator.all.laws.index(Law.DRAG)] = 1.01 * SOON_FACTOR * MIN_SCORE_ANEW_NATS
    assert replace(anew, estimate=replace(start)).is_better(0.0)
    assert not replace(anew, estimate=replace(start, opened=0.0, time=LASTS_S)).is_over
    assert replace(anew, estimate=replace(start, opened=0.0, time=LASTS_S + 1.0)).is_over


def test_what_sets_in_is_not_noise_because_those_that_go_on_take_it_for_noise(
    estimator: DisturbanceEstimator,
) -> None:
    """A drag beside a current that had held for forty minutes was never told: within as many
    seconds it was noise, a hundred times as much as before.
    """
    start = replace(estimator.start(), noise=np.array([0.1, 0.1, 0.1]))
    loud = replace(start, noise=np.array([10.0, 0.1, 0.01]))
    (first,) = of_what_is_known(estimator, start, start, (), start.noise)
    (again,) = of_what_is_known(estimator, start, loud, (), first.noise)
    np.testing.assert_array_equal(again.estimate.noise, [0.1, 0.1, 0.01])
    np.testing.assert_array_equal(again.noise, loud.noise)
    (third,) = of_what_is_known(estimator, start, loud, (), again.noise)
    np.testing.assert_array_equal(third.estimate.noise, loud.noise)


@pytest.mark.parametrize(
    ("boat", "drag", "driven", "over", "fewer"),
    [
        (-1.0, -9.0, 25, True, ()),  # nothing does as well as a motor beside a current
        (-1.0, -9.0, 25, False, None),  # … before the time is over
        (-1.0, -9.0, 15, True, None),  # … nor while the motors rest
        (-9.0, -1.0, 25, True, ()),  # a drag alone does
        (-9.0, -3.0, 25, True, None),
    ],
)
def test_fewer_causes_take_over_where_they_do_as_well(
    estimator: DisturbanceEstimator, boat: float, drag: float, driven: int, over: bool,
    fewer: tuple[Cause, ...] | None,
) -> None:  # fmt: skip
    """ "All thrusters giving 71 % more thrust, beside 80 % more drag": both had ended."""
    start = estimator.start()
    start.scores[:] = -20.0
    start.scores[estimator.all.laws.index(Law.NOTHING)] = boat
    start.scores[estimator.all.laws.index(Law.DRAG)] = drag
    last = LASTS_S + (1.0 if over else -1.0)
    estimate = replace(start, opened=0.0, time=last, driven=driven)
    now = replace(start, beside=(KnownCause(Cause.CURRENT, start),))
    found = simpler((BegunAnew(estimate, True, NOISE),), now, told=True)
    assert (None if found is None else found.beside) == fewer
    assert simpler((BegunAnew(estimate, True, NOISE),), start, told=True) is None  # one alone stays


def test_of_fewer_causes_the_fewest_are_taken(estimator: DisturbanceEstimator) -> None:
    start = estimator.start()
    start.scores[:] = -20.0
    start.scores[estimator.all.laws.index(Law.NOTHING)] = 0.0
    ends = replace(start, opened=0.0, time=LASTS_S + 1.0, driven=25)
    current, drag = KnownCause(Cause.CURRENT, start), KnownCause(Cause.DRAG, start)
    anew = [BegunAnew(replace(ends, beside=one), True, NOISE) for one in ((current,), (), (drag,))]
    assert [one.fewest for one in anew] == [1, 0, 1]
    now = replace(start, beside=(current, drag))
    assert simpler(anew, now, told=False).beside == ()
    assert simpler(anew[::2], now, told=False).beside in {(current,), (drag,)}
    assert simpler(anew[:1], replace(start, beside=(current,)), told=False) is None


def test_adrift_a_current_is_not_told_from_a_wind_and_no_motor_or_compass_is_blamed(
    estimator: DisturbanceEstimator,
) -> None:
    """Of a boat adrift in a wind "0.41 m/s of current" was told alone, and a compass 82° off."""
    idle = np.zeros(4)
    voyage = [
        replace(s, mean_commands=idle) if s.time >= 110 else s
        for s in sailed((120, {}), (200, CURRENT))
    ]
    told = watched(estimator, voyage)
    assert "looks like current or wind (" in told[1][1]
    assert "what she does under way tells" in told[1][1]
    for _, text, _ in told:
        assert "looks like 0" not in text
        assert not re.search("compass|thruster|drag", text)

    voyage += sailed((320, {}), (200, CURRENT))[320:]
    later = [text for time, text, _ in watched(estimator, voyage) if time > 320]
    assert re.search(r"looks like 0\.3\d* m/s of current", later[-1])


def test_what_explains_a_boat_that_was_adrift_is_judged_anew_under_way(
    estimator: DisturbanceEstimator,
) -> None:
    alarm = Alarm.start(estimator)
    estimate = replace(alarm.estimate, opened=100.0, time=100.0 + MIN_ADRIFT_S)
    assert not replace(alarm, estimate=estimate).was_adrift
    assert replace(alarm, estimate=replace(estimate, time=131.0)).was_adrift


def test_nothing_is_begun_anew_of_a_model_that_is_right(estimator: DisturbanceEstimator) -> None:
    alarm = Alarm.start(estimator)
    for second in sailed((200, {})):
        alarm, news = alarm.observe(estimator, second)
        assert news is not ModelEvent.WRONG
        assert alarm.anew == ()
        assert alarm.calm is None
