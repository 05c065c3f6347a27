"""Prediction errors beside their floor: what the model is not to blame for, and single outliers."""

from dataclasses import replace

import numpy as np
import pytest

from sim.monitoring import Balance
from sim.monitoring.consistency import WRONG_ABOVE, Misfit, transition
from tests.sim.monitoring.live_seconds import seconds


def linear(A: np.ndarray) -> Balance:
    """A balance with that system matrix."""
    mass = np.diag([126.0, 121.0, 70.0])
    return Balance(-mass @ A, mass, np.zeros(3))


SLOW = linear(-0.3 * np.eye(3))


def test_an_unstable_hull_is_no_wrong_model() -> None:
    """Where the start state's error grows, so does the floor."""
    second = next(iter(seconds(1)))
    fast = linear(np.diag([0.0, 0.5, 0.0]))
    stable, unstable = Misfit(), Misfit()
    for k in range(40):
        off = np.tile([0.0, 0.12, 0.0], (2, 1))
        now = replace(second, time=float(k), errors=off)
        stable = stable.observe(now, SLOW, (5, 10))
        unstable = unstable.observe(now, fast, (5, 10))
    assert stable.level > 3.0 * unstable.level
    assert not unstable.wrong


def test_where_a_prediction_may_be_anywhere_it_judges_nothing() -> None:
    """A model that runs away from any start: its floor would be larger than any boat's motion."""
    second = next(iter(seconds(1)))
    away = linear(np.diag([0.0, 3.0, 0.0]))
    misfit = Misfit()
    for k in range(40):
        off = np.tile([0.0, 4.0, 0.0], (2, 1))
        misfit = misfit.observe(replace(second, time=float(k), errors=off), away, (5, 10))
    assert np.isnan(misfit.z)
    assert not misfit.wrong
    assert (misfit.errors[1] == 0.0).all()
    short = Misfit()
    for k in range(40):
        off = np.tile([0.0, 4.0, 0.0], (2, 1))
        short = short.observe(replace(second, time=float(k), errors=off), SLOW, (5, 10))
    assert short.wrong


def test_after_a_jump_nothing_counts_until_predictions_are_new() -> None:
    second = replace(next(iter(seconds(1))), errors=np.ones((2, 3)))
    misfit = Misfit()
    for _ in range(4):
        misfit = misfit.observe(second, SLOW, (5, 10))
    assert misfit.level == 0.0
    assert np.isnan(misfit.z)


def test_a_command_whose_moment_is_not_known_is_no_wrong_model() -> None:
    second = next(iter(seconds(1)))
    levels = []
    for changing in (True, False):
        misfit = Misfit()
        for k in range(60):
            force = np.array([100.0 * (k % 2 and changing), 0.0, 0.0])
            off = np.tile([0.14, 0.0, 0.0], (2, 1))
            now = replace(second, time=float(k), errors=off, commanded=force)
            misfit = misfit.observe(now, SLOW, (5, 10))
        levels.append(misfit.level)
    assert levels[0] < 0.3 * levels[1]


def test_one_outlier_is_no_misfit() -> None:
    second = next(iter(seconds(1)))
    misfit = Misfit()
    for k in range(60):
        errors = np.full((2, 3), 100.0 if k in (30, 31) else 0.0)
        misfit = misfit.observe(replace(second, time=float(k), errors=errors), SLOW, (5, 10))
        assert not misfit.wrong


def test_a_model_is_wrong_only_by_an_error_that_clearly_exceeds_the_noise() -> None:
    """ "The model is wrong (off by 0.046 m/s sideways, noise explains 0.052)" was said."""
    quiet = next(iter(seconds(1)))
    rough = replace(quiet, variance=100.0 * quiet.variance + 0.01)
    for often, wrong in ((5, True), (2, False)):
        misfit = Misfit()
        for k in range(80):  # small errors in quiet seconds, none in rough ones
            judged = quiet if k % 5 < often else rough
            floor = 0.05 if judged is quiet else 0.0
            errors = np.tile([0.0, 6.0 * floor, 0.0], (2, 1))
            misfit = misfit.observe(replace(judged, time=float(k), errors=errors), SLOW, (5, 10))
        assert misfit.wrong is wrong
        error, noise = misfit.errors
        assert bool(error[1] > 1.4 * noise[1]) is wrong
        assert misfit.level > WRONG_ABOVE


def test_a_transition_is_that_of_the_linear_model() -> None:
    A = np.array([
        [-0.4, 0.1, 0.0, 0.2], [0.2, -0.8, 1.1, -0.3], [0.0, 0.3, -2.5, 0.0], [0.0, 0.0, 1.0, 0.0]
    ])  # fmt: skip
    x, h = np.array([1.0, -2.0, 0.5, 0.3]), 1e-4
    for _ in range(round(1.0 / h)):
        x = x + h * A @ x
    assert transition(A) @ np.array([1.0, -2.0, 0.5, 0.3]) == pytest.approx(x, abs=0.02)


def after(errors: np.ndarray, short: np.ndarray | None = None) -> Misfit:
    """Errors ahead (K,) after five and ten seconds and after one, of so many quiet seconds."""
    second, misfit = next(iter(seconds(1))), Misfit()
    short = np.zeros(len(errors)) if short is None else short
    for k, (error, one) in enumerate(zip(errors, short, strict=True)):
        due = np.tile([error, 0.0, 0.0], (2, 1))
        now = replace(second, time=float(k), errors=due, short_error=np.array([one, 0.0, 0.0]))
        misfit = misfit.observe(now, SLOW, (5, 10))
    return misfit


@pytest.mark.parametrize("period", [2.3, 3.0, 4.0])
def test_a_chop_is_no_wrong_model_and_a_force_in_it_is(period: float) -> None:
    """Waves of 0.14 m/s called exact boats wrong; a force makes an error that lasts."""
    t = np.arange(120.0)

    def errors(seconds: float) -> np.ndarray:
        chop = np.sin(2.0 * np.pi * t / period) - np.sin(2.0 * np.pi * (t - seconds) / period)
        return 0.14 * chop

    swings = after(errors(5.0), errors(1.0))
    assert not swings.wrong
    assert swings.chop[0] == pytest.approx(0.14**2, rel=0.2)
    assert after(errors(5.0) + 0.6, errors(1.0) + 0.15).wrong


def test_what_lasts_over_a_second_takes_nothing_from_what_lasts_longer() -> None:
    lasting = after(np.full(60, 0.3), np.full(60, 0.2))
    assert lasting.wrong
    np.testing.assert_array_equal(lasting.chop, 0.0)


def test_what_a_gap_lies_between_is_not_compared() -> None:
    misfit = after(np.full(30, 0.3), np.full(30, 0.2)).after_gap()
    assert np.isnan(misfit.short_error).all()
    second = replace(
        next(iter(seconds(1))), errors=np.full((2, 3), -0.3), short_error=np.full(3, -0.2)
    )
    later = misfit.observe(second, SLOW, (5, 10))
    np.testing.assert_array_equal(later.chop, misfit.chop)


def test_what_comes_after_a_wrong_that_has_ended_has_an_onset_of_its_own() -> None:
    """An alarm two seconds after "right again" was dated from the trouble before it."""
    errors = np.concatenate([np.full(40, 0.3), np.zeros(60), np.full(25, 0.3)])
    second, misfit, ended = next(iter(seconds(1))), Misfit(), 0.0
    for k, error in enumerate(errors):
        before = misfit
        due = np.tile([error, 0.0, 0.0], (2, 1))
        misfit = misfit.observe(replace(second, time=float(k), errors=due), SLOW, (5, 10))
        if before.wrong and not misfit.wrong:
            assert not np.isfinite(misfit.since)
            ended = float(k)
    assert ended > 40.0
    assert misfit.wrong
    assert ended < misfit.since < 110.0
