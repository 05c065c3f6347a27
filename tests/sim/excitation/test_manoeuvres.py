"""Every manoeuvre, for every shape of vessel: in range, slow enough, neutral at both ends."""

from dataclasses import replace

import numpy as np
import pytest

from sim.excitation import (
    Stick,
    StickLimits,
    manoeuvre_commands,
    manoeuvre_sticks,
    mix_sticks,
    mixing_matrix,
    slew_limited,
)
from sim.excitation.catalogue import (
    BY_NAME,
    MANOEUVRES,
    Circles,
    Mixed,
    MotorsOff,
    Ramp,
    Spin,
    Square,
    Zigzag,
)
from sim.model import Model
from sim.state import Eta
from sim.vessel import Servo, Thruster
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, SHAPES, STEERED_BOAT, WAMV

TIGHT = StickLimits(throttle=0.5, steer=0.4, throttle_rate=0.5, steer_rate=0.7)
every_manoeuvre = pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
every_vessel = pytest.mark.parametrize("vessel", SHAPES, ids=lambda v: v.name)


@every_manoeuvre
@every_vessel
def test_it_keeps_its_limits_and_begins_and_ends_in_neutral(manoeuvre, vessel):
    sticks = manoeuvre_sticks(manoeuvre, vessel, 0.1, seed=3, limits=TIGHT)
    assert (np.abs(sticks) <= TIGHT.largest + 1e-12).all()
    around = np.vstack([np.zeros(2), sticks, np.zeros(2)])
    assert (np.abs(np.diff(around, axis=0)) <= 0.1 * TIGHT.rates + 1e-9).all()
    assert not sticks[0].any()
    assert manoeuvre == MotorsOff() or np.ptp(sticks) > 0.1


@every_manoeuvre
@every_vessel
def test_a_seed_makes_it_and_a_finer_grid_is_the_same_manoeuvre(manoeuvre, vessel):
    sticks = manoeuvre_sticks(manoeuvre, vessel, 0.1, seed=5)
    assert np.array_equal(sticks, manoeuvre_sticks(manoeuvre, vessel, 0.1, seed=5))
    fine = manoeuvre_sticks(manoeuvre, vessel, 0.02, seed=5)[::5]
    same = np.abs(fine[: len(sticks)] - sticks[: len(fine)]).max(axis=1) < 0.25
    assert same.mean() > 0.99  # edges may fall between two rows


@pytest.mark.parametrize("name", ["random", "joystick", "mixed"])
def test_another_seed_is_another_manoeuvre(name):
    one, other = (manoeuvre_sticks(BY_NAME[name], WAMV, 0.1, seed) for seed in (1, 2))
    assert not np.array_equal(one, other)


@every_manoeuvre
def test_longer_begins_again_and_shorter_is_cut(manoeuvre):
    whole = manoeuvre_sticks(manoeuvre, WAMV, 0.1)
    seconds = manoeuvre.adapted_to(WAMV, StickLimits()).seconds
    assert len(whole) == round(seconds / 0.1)
    short = manoeuvre_sticks(manoeuvre, WAMV, 0.1, seconds=9.0)
    assert len(short) == 90
    assert short[:70] == pytest.approx(whole[:70])
    again = manoeuvre_sticks(manoeuvre, WAMV, 0.1, seconds=seconds + 30.0)[len(whole) :]
    assert again[30:250] == pytest.approx(whole[30:250], abs=1e-9)


def test_names_differ_and_each_tells_something():
    assert len(BY_NAME) == len(MANOEUVRES)
    assert all(len(manoeuvre.reveals) > 20 for manoeuvre in MANOEUVRES)


@every_vessel
def test_throttle_pushes_ahead_and_helm_turns_to_starboard(vessel):
    def end(throttle, steer):
        commands = mix_sticks(vessel, np.tile([throttle, steer], (100, 1)))
        return Model.of(vessel).simulate(commands, 0.1)[0][0, -1]

    ahead, turning = end(0.5, 0.0), end(0.5, 0.3)
    assert ahead[3] > 0.3
    assert abs(ahead[5]) < 1e-9
    assert turning[5] > 0.02


def test_the_mixture_is_that_of_skid_steering():
    assert mixing_matrix(WAMV) == pytest.approx(np.array([[1.0, 1.0], [1.0, -1.0]]))
    assert mixing_matrix(IACQUABOT) == pytest.approx(np.array([[1.0, 1.0], [1.0, -1.0]] * 2))
    assert mixing_matrix(RUDDER_BOAT) == pytest.approx(np.array([[1.0, 0.0], [0.0, 1.0]]))


def test_a_bow_thruster_has_no_share_of_the_throttle_and_steers_by_its_lever():
    bow = Thruster("bow", Servo(5), (1.4, 0.0), (-20.0, 20.0), azimuth=np.pi / 2)
    boat = replace(WAMV, thrusters=(*WAMV.thrusters, bow))
    assert mixing_matrix(boat) == pytest.approx(np.array([[1.0, 0.5], [1.0, -0.5], [0.0, 1.0]]))


def test_the_helm_goes_before_the_throttle():
    straight = replace(BY_NAME["constant"], throttle=0.9, steer=0.4)
    commands = manoeuvre_commands(straight, WAMV, 0.1)[100]
    assert commands == pytest.approx([1.0, 0.2])  # 0.6 ahead, 0.4 of helm


@pytest.mark.parametrize("vessel", [WAMV, RUDDER_BOAT, STEERED_BOAT], ids=lambda v: v.name)
@pytest.mark.parametrize("limits", [StickLimits(), StickLimits(0.7, 0.5)], ids=["full", "gentle"])
def test_circles_are_full_circles_whatever_the_vessel(vessel, limits):
    circles = Circles().adapted_to(vessel, limits)
    commands = manoeuvre_commands(circles, vessel, 0.1, limits=limits)
    yaw = Model.of(vessel).simulate(commands, 0.1)[0][0, :, Eta.YAW]
    ends = np.cumsum([round(seconds / 0.1) for seconds, _, _ in circles.legs])
    for start, end, side in zip((0, *ends[:-1]), ends, (1, -1, 1, -1), strict=True):
        assert side * (yaw[min(end, len(yaw) - 1)] - yaw[start]) > 2.0 * np.pi * 0.98


def test_on_the_spot_means_on_the_spot():
    motion = Model.of(WAMV).simulate(manoeuvre_commands(Spin(), WAMV, 0.1), 0.1)[0][0]
    assert np.hypot(motion[:, 0], motion[:, 1]).max() < 1.0
    turned = motion[:, Eta.YAW]
    assert turned.max() > np.pi
    assert abs(turned[-1]) < 0.2  # as far to port as to starboard
    assert motion[:, 5].min() < -0.3


def test_parts_of_the_mixture_follow_one_another_without_a_gap():
    whole = manoeuvre_sticks(Mixed((Zigzag(), Spin(), Square())), WAMV, 0.1)
    start = 0
    for part in (Zigzag(), Spin(), Square()):
        alone = manoeuvre_sticks(part, WAMV, 0.1)
        inside = slice(10, len(alone) - 10)  # their own ends are neutral
        assert whole[start : start + len(alone)][inside] == pytest.approx(alone[inside])
        start += len(alone)
    assert start == len(whole)


def test_the_ramp_is_slow_near_neutral():
    throttle = manoeuvre_sticks(Ramp(), WAMV, 0.1)[:, Stick.THROTTLE]
    near = np.abs(throttle) < 0.1
    assert np.abs(np.diff(throttle))[near[1:]].max() < 0.003
    assert near.sum() * 0.1 > 15.0


def test_a_slew_follows_as_fast_as_it_may():
    wanted = np.array([[0.0], [1.0], [1.0], [1.0], [1.0], [1.0], [-1.0], [-1.0], [-1.0]])
    got = slew_limited(wanted, np.array([2.5]), 0.1)[:, 0]
    assert got == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 0.75, 0.5, 0.25])  # and then 0


@pytest.mark.parametrize("wrong", [{"throttle": 1.2}, {"steer": 0.0}, {"steer_rate": np.inf}])
def test_limits_that_are_none_are_refused(wrong):
    with pytest.raises(ValueError, match="expected"):
        StickLimits(**wrong)
