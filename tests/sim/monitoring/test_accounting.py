"""A cause is told only where the error falls with it."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from sim.model import Model
from sim.monitoring import NO_CURRENT, Balance, SecondMeans, balances_at
from sim.monitoring.accounting import SUMMED_S, error_falls
from sim.monitoring.alarm import RETRY_S, Alarm, ModelEvent
from sim.monitoring.disturbances import Cause, DisturbanceEstimate, DisturbanceEstimator
from sim.state import Floats, Nu
from tests.sim.monitoring.live_seconds import seconds
from tests.sim.voyages import WAM_V

STREAM = np.array([0.1, -0.28])
MODEL = Model.of(WAM_V)
FAR_OFF = np.array([0.8, 0.0, 0.0])  # m/s, m/s, rad/s in a second: a file that was guessed


@pytest.fixture(scope="module")
def estimator() -> DisturbanceEstimator:
    return DisturbanceEstimator.of(MODEL)


def predicted(
    voyage: Iterable[SecondMeans], beside: Floats, off: float = 0.0
) -> Iterator[SecondMeans]:
    """Errors over one second as the missing force makes them, and `beside` (3,) more; those over
    the longer horizons off by so much ahead.
    """
    rng, end = np.random.default_rng(7), np.zeros(3)
    for second in voyage:
        start, end = end, np.sqrt(second.variance) * rng.standard_normal(3)
        short = made_by(second) + beside + end - start
        errors = np.sqrt(2.0 * second.variance) * rng.standard_normal((2, 3))
        errors[:, 0] += off
        yield replace(second, short_error=short, errors=errors)


def made_by(second: SecondMeans) -> Floats:
    """What the missing force makes of a velocity in a second (3,)."""
    balance = Balance.of(balances_at(MODEL, second, NO_CURRENT))
    both = np.zeros((5, 5))
    both[:4, :4] = balance.system_matrix
    both[:3, 4] = np.linalg.solve(balance.slope_nu_dot, second.missing)
    return np.asarray(expm(both)[:3, 4])


def learnt(
    estimator: DisturbanceEstimator, voyage: list[SecondMeans]
) -> tuple[DisturbanceEstimate, int]:
    """The estimate after that voyage, and the number of what predicts best."""
    estimate = estimator.start()
    for second in voyage:
        estimate, _ = estimator.observe(estimate, second)
    return estimate, estimate.named[0][2]


@pytest.mark.parametrize(
    ("cause", "channel"),
    [
        ({"stream": STREAM}, Nu.U), ({"compass": 0.2}, Nu.V),
        ({"thrust": np.array([0.0, 0.6])}, Nu.R), ({"drag": 1.0}, Nu.U),
    ],
)  # fmt: skip
def test_the_error_falls_with_what_makes_it_and_not_beside_a_larger_one(
    estimator: DisturbanceEstimator, cause: dict[str, object], channel: int
) -> None:
    voyage = list(seconds(120, **cause))  # type: ignore[arg-type]
    estimate, f = learnt(estimator, voyage)
    assert error_falls(estimator, estimate, f, list(predicted(voyage, np.zeros(3)))[-25:], channel)
    assert not error_falls(estimator, estimate, f, list(predicted(voyage, FAR_OFF))[-25:], Nu.U)


def test_too_few_seconds_tell_nothing_against_a_cause(estimator: DisturbanceEstimator) -> None:
    voyage = list(seconds(120, stream=STREAM))
    estimate, f = learnt(estimator, voyage)
    off = list(predicted(voyage, FAR_OFF))
    assert error_falls(estimator, estimate, f, off[-SUMMED_S + 1 :], Nu.U)
    assert not error_falls(estimator, estimate, f, off[-SUMMED_S:], Nu.U)
    opened = replace(estimate, opened=off[-SUMMED_S].time)  # the first of them was before it
    assert error_falls(estimator, opened, f, off, Nu.U)


def told(
    estimator: DisturbanceEstimator, voyage: Iterable[SecondMeans]
) -> list[tuple[float, Cause]]:
    """When the model was called wrong or explained, and what was named."""
    alarm, out = Alarm.start(estimator), []
    for second in voyage:
        alarm, news = alarm.observe(estimator, second)
        if news in (ModelEvent.WRONG, ModelEvent.EXPLAINED):
            out.append((second.time, alarm.cause))
    return out


def test_a_compass_is_not_blamed_for_an_error_that_it_does_not_make(
    estimator: DisturbanceEstimator,
) -> None:
    """Beside a vessel file that was guessed: "the compass reading 3° too far to port", 3.5 m/s."""
    voyage = list(seconds(240, compass=0.2))
    rightly = told(estimator, predicted(voyage, np.zeros(3), off=0.3))
    assert Cause.COMPASS in [cause for _, cause in rightly]
    beside = told(estimator, predicted(voyage, FAR_OFF, off=3.0))
    assert {cause for _, cause in beside} <= {Cause.NOTHING, Cause.OTHER}
    assert Cause.OTHER in [cause for _, cause in beside]


def test_what_was_refused_is_told_once_the_error_falls_with_it(
    estimator: DisturbanceEstimator,
) -> None:
    voyage = list(seconds(240, compass=0.2))
    begins = 100
    first = list(predicted(voyage, FAR_OFF, off=0.3))[:begins]
    then = list(predicted(voyage, np.zeros(3), off=0.3))[begins:]
    names = [
        (time, cause) for time, cause in told(estimator, [*first, *then]) if cause is Cause.COMPASS
    ]
    assert names
    assert begins < names[0][0] <= begins + 2.0 * RETRY_S + 10.0
