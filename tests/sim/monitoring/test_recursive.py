"""Numbers of a vessel are followed while something shows them, and stand still otherwise."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sim.model import Model, parameters_of
from sim.monitoring import SecondMeans
from sim.monitoring.recursive import (
    LIMITS,
    MAX_CHANGE_PER_S,
    NUMBER_PRIOR,
    NumberEstimates,
    NumberFollower,
    followed_numbers,
    with_shares,
)
from tests.sim.monitoring import live_seconds
from tests.sim.vessels import SHAPES
from tests.sim.voyages import WAM_V

PORT, STARBOARD, DRAG = 0, 1, 2
WEAK = np.array([-0.2, 0.0])
seconds = partial(live_seconds.seconds, leg_s=6, steer=0.25)


@pytest.fixture(scope="module")
def wam_v() -> NumberFollower:
    return NumberFollower.of(Model.of(WAM_V))


def unsmoothed(follower: NumberFollower) -> NumberEstimates:
    """Before the first second of a voyage whose accelerations are made up, not estimated."""
    now = follower.start()
    return replace(now, filter=replace(now.filter, mean=np.zeros(len(now.filter.mean))))


def after(
    follower: NumberFollower, voyage: Iterable[SecondMeans], start: NumberEstimates | None = None
) -> NumberEstimates:
    now = start or unsmoothed(follower)
    for second in voyage:
        now = follower.observe(now, second)
    return now


@pytest.fixture(scope="module")
def calm(wam_v: NumberFollower) -> NumberEstimates:
    return after(wam_v, seconds(240))


def test_a_right_vessel_stays_as_it_is(calm: NumberEstimates) -> None:
    assert np.abs(calm.shares).max() < 0.08
    assert calm.valid[[PORT, STARBOARD, DRAG]].all()
    assert not calm.left.any()
    assert (np.abs(calm.shares) < 2.0 * calm.std).all()


def test_a_thruster_that_changes_is_followed_within_three_minutes(
    wam_v: NumberFollower, calm: NumberEstimates
) -> None:
    now = after(wam_v, seconds(180, thrust=WEAK, first=240), calm)
    assert now.shares[PORT] == pytest.approx(-0.2, abs=0.07)
    assert np.abs(np.delete(now.shares, PORT)).max() < 0.08
    assert abs(now.shares[PORT] + 0.2) < 1.96 * now.std[PORT]
    assert now.left.tolist() == [True, False, False, False]


def test_a_number_that_has_left_is_back_once(wam_v: NumberFollower, calm: NumberEstimates) -> None:
    now, turns = after(wam_v, seconds(180, thrust=WEAK, first=240), calm), 0
    for second in seconds(300, first=420):
        before, now = now, wam_v.observe(now, second)
        turns += int((now.left != before.left).sum())
    assert turns == 1
    assert not now.left.any()


def test_drag_is_told_from_thrust(wam_v: NumberFollower, calm: NumberEstimates) -> None:
    now = after(wam_v, seconds(300, drag=0.3, first=240), calm)
    assert now.shares[DRAG] == pytest.approx(0.3, abs=0.12)
    assert np.abs(now.shares[[PORT, STARBOARD]]).max() < 0.1


def test_neither_a_current_nor_a_force_on_the_boat_is_put_down_to_a_number(
    wam_v: NumberFollower, calm: NumberEstimates
) -> None:
    stream, body = np.array([0.1, -0.28]), np.array([-12.0, 8.0, 6.0])
    for voyage in (seconds(240, stream=stream, first=240), seconds(240, body=body, first=240)):
        now = after(wam_v, voyage, calm)
        assert np.abs(now.shares).max() < 0.12
        assert not now.left.any()


def constant(count: int, first: int) -> Iterable[SecondMeans]:
    """One course at one speed, in a stream."""
    one = next(seconds(1, stream=np.array([0.2, 0.1])))
    rng = np.random.default_rng(3)
    for k in range(count):
        noise = 4.0 * rng.standard_normal(3)
        yield replace(one, time=float(first + k), missing=one.missing + noise)


def test_at_constant_speed_they_stand_still_and_are_known_less_and_less(
    wam_v: NumberFollower, calm: NumberEstimates
) -> None:
    soon = after(wam_v, constant(500, 240), calm)
    late = after(wam_v, constant(600, 740), soon)
    assert not late.excited.any()
    assert (late.shares == soon.shares).all()
    assert (late.std > soon.std).all()


def test_they_move_slowly_and_within_limits(wam_v: NumberFollower) -> None:
    now, low = wam_v.start(), 0.0
    for second in seconds(400, thrust=np.array([-3.0, 0.0])):
        before, now = now, wam_v.observe(now, second)
        assert np.abs(now.shares - before.shares).max() <= MAX_CHANGE_PER_S + 1e-12
        low = min(low, now.shares.min())
    assert low == LIMITS[0]
    assert not now.valid[PORT]


def test_after_a_silence_they_are_known_less(wam_v: NumberFollower, calm: NumberEstimates) -> None:
    later = next(seconds(1, first=240))
    soon, late = (
        wam_v.observe(calm, replace(later, time=calm.time + silence)) for silence in (1.0, 300.0)
    )
    assert (late.std > soon.std).all()


def test_a_second_without_finite_numbers_changes_nothing(
    wam_v: NumberFollower, calm: NumberEstimates
) -> None:
    broken = replace(next(seconds(1, first=240)), missing=np.full(3, np.nan))
    assert wam_v.observe(calm, broken) is calm


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda vessel: vessel.name)
def test_a_vessel_with_shares_is_the_slope_that_is_followed(vessel) -> None:
    """The vessel that `--adapt apply` uses lacks what the slopes say; no number is left out."""
    model, second = Model.of(vessel), next(seconds(1))
    na = model.actuator_count
    commands = np.full(na, 0.4)
    second = replace(second, commands=commands, mean_commands=commands)
    follower = NumberFollower.of(model)
    slopes = follower._slopes(second, np.zeros(2))
    row, time = second.motion[None], np.array([second.time])
    lacks, _ = model.missing_force(row, time, commands[None], commands[None])
    for number, h in zip(followed_numbers(model), slopes.T, strict=True):
        other = Model.of(with_shares(vessel, {number.name: 1e-3}))
        left, _ = other.missing_force(row, time, commands[None], commands[None])
        assert (lacks - left)[0] / 1e-3 == pytest.approx(h, rel=1e-6, abs=1e-6)
        changed = {
            name
            for name, value in parameters_of(other.vessel).items()
            if value != parameters_of(vessel)[name]
        }
        assert changed == {name for name in number.members if parameters_of(vessel)[name] != 0.0}


def test_that_all_numbers_are_wrong_alike_is_thought_unlikely(wam_v: NumberFollower) -> None:
    n = len(wam_v.numbers)
    alike = np.full(n, 1.0 / n)
    assert np.sqrt(alike @ wam_v.unknown @ alike) < 0.3 * NUMBER_PRIOR
