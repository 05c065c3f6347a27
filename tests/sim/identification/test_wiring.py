"""Swapped sides and motors the wrong way round are told; straight runs tell nothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from sim.effects.actuator_wiring import EFFECT as WIRING
from sim.identification import wiring
from sim.identification.wiring import (
    CommandResponse,
    command_response,
    rewired,
    wiring_notices,
    wiring_of,
)
from sim.state import Nu
from sim.vessel import AddedEffect
from tests.sim.identification.noisy_trials import noisy
from tests.sim.vessels import RUDDER_BOAT, WAMV


def plugged(swap=False, turn=False):
    """The WAM-V as a vessel file may have its channels."""
    left, right = (replace(t.servo, reversed=turn) for t in WAMV.thrusters)
    a, b = (right, left) if swap else (left, right)
    thrusters = (replace(WAMV.thrusters[0], servo=a), replace(WAMV.thrusters[1], servo=b))
    return replace(WAMV, thrusters=thrusters)


@pytest.fixture(scope="module")
def sailed():
    return [noisy(WAMV, 120.0, seed) for seed in (1, 2)]


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("turn", [False, True])
def test_what_is_plugged_wrong_is_told_and_put_right(sailed, swap, turn):
    vessel = plugged(swap, turn)
    found = wiring_of(sailed, vessel)
    assert (found.swapped, found.reversed) == (swap, turn)
    assert rewired(vessel, found) == WAMV
    told = wiring_notices(found, vessel)
    assert len(told) == swap + turn
    if swap:
        assert "port and starboard commands look swapped" in told[0]
        assert "left (2)" in told[0]


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("which", [0, 1])
def test_one_motor_the_wrong_way_round_is_told_and_put_right(sailed, swap, which):
    right = plugged(swap)
    motors = [
        replace(t, servo=replace(t.servo, reversed=i == which))
        for i, t in enumerate(right.thrusters)
    ]
    vessel = replace(right, thrusters=tuple(motors))
    found = wiring_of(sailed, vessel)
    assert rewired(vessel, found) == WAMV
    told = wiring_notices(found, vessel)
    assert len(told) == 1 + swap
    name = f"`reversed` of {motors[which].name} ({motors[which].servo.channel})"
    assert "one motor" in told[0]
    assert name in told[0]
    assert sum("swapped" in text for text in told) == swap
    assert sum(text.startswith("with that motor turned port and") for text in told) == swap


def test_no_motor_is_turned_of_a_boat_that_only_drifted(sailed):
    adrift = [replace(t, nu=np.random.default_rng(5).normal(0.0, 0.3, t.nu.shape)) for t in sailed]
    found = wiring_of(adrift, WAMV)
    assert found.backwards is None
    assert not wiring_notices(found, WAMV)


@pytest.mark.slow
def test_the_effect_that_is_named_cures_it(sailed):
    vessel = plugged(swap=True)
    order = wiring_notices(wiring_of(sailed, vessel), vessel)[0].partition("order = ")[2].split()[0]
    cure = AddedEffect(WIRING, {"order": float(order), "reversed": 0.0})
    assert not wiring_of(sailed, vessel.with_effects(cure)).swapped


def test_straight_runs_tell_nothing():
    straight = [noisy(WAMV, 120.0, seed, steering=0.0) for seed in (1, 2)]
    found = wiring_of(straight, plugged(swap=True))
    assert found.yaw == 0
    assert not wiring_notices(found, WAMV)


def test_runs_that_tell_are_named(sailed):
    trials = [
        replace(sailed[0], name="turning"),
        replace(noisy(WAMV, 60.0, 3, steering=0.0), name="straight"),
    ]
    found = wiring_of(trials, plugged(swap=True))
    assert found.runs == ("turning",)


@pytest.mark.parametrize(("steered", "sign"), [(0.3, -1), (0.01, None)])
def test_a_boat_that_was_hardly_steered_says_nothing_however_it_turned(steered, sign):
    rng = np.random.default_rng(4)
    command = steered * np.repeat(rng.uniform(-1.0, 1.0, 60), 20)
    turning = -0.5 * np.sign(command) + rng.normal(0.0, 0.05, 1200)
    found = command_response(command, turning, np.ones(1200, bool), 0.1, Nu.R)
    assert (None if found is None else found.sign) == sign


def test_a_boat_that_did_not_turn_says_nothing():
    command = np.repeat(np.random.default_rng(4).uniform(-1.0, 1.0, 60), 20)
    assert command_response(command, -0.01 * command, np.ones(1200, bool), 0.1, Nu.R) is None


def test_a_rudder_that_a_tight_turn_drives_the_water_against_is_not_reversed():
    """The boat turns as she is steered, and drifts so far that her rudder brakes the turn."""
    rng = np.random.default_rng(6)
    length, servo = 20, RUDDER_BOAT.rudders[0].servo.channel
    helm = np.repeat(rng.uniform(-1.0, 1.0, 60), length)
    turn = lfilter([0.1], [1.0, -0.9], helm)
    one = noisy(WAMV, 120.0)
    pwm = np.stack([np.full(len(helm), 1700.0), 1500.0 + 400.0 * helm], axis=1)
    screw = RUDDER_BOAT.thrusters[0].servo.channel
    trial = replace(
        one, channels=(screw, servo), pwm=pwm, nu=np.stack([0.0 * turn + 0.8, -turn, turn], axis=1)
    )
    for helm_sign in (1, -1):
        steered = replace(trial, nu=trial.nu * [1.0, helm_sign, helm_sign])
        assert wiring_of([steered], RUDDER_BOAT).yaw == helm_sign


def test_one_motor_the_wrong_way_round_is_told_though_its_force_follows_a_motion_by_chance(
    monkeypatch,
):
    """One recording in five contradicts both axes; with the motor turned all five agree."""
    said = {False: [CommandResponse(-0.91, -9.0)] + 4 * [CommandResponse(0.1, 1.0)],
            True: 5 * [CommandResponse(0.95, 20.0)]}  # fmt: skip
    trials = [SimpleNamespace(name=f"r{k}", channels=(1, 2)) for k in range(5)]

    def response(trial, model, axis):
        return said[model.vessel.thrusters[0].servo.reversed][int(trial.name[1:])]

    monkeypatch.setattr(wiring, "_response", response)
    found = wiring_of(trials, WAMV)
    assert (found.backwards, found.yaw, found.surge) == (0, 1, 1)
    assert found.runs == ("r0", "r1", "r2", "r3", "r4")
    (told,) = wiring_notices(found, WAMV)
    assert told.startswith("one motor looks as if it ran the wrong way round")
    # and where the channels are right nothing is turned, however clear it would be
    said[False] = 5 * [CommandResponse(0.6, 5.0)]
    assert wiring_of(trials, WAMV).backwards is None


def test_an_output_that_never_gets_a_pulse_is_told_with_those_that_do(sailed):
    left, right = WAMV.thrusters
    wrong = replace(WAMV, thrusters=(left, replace(right, servo=replace(right.servo, channel=7))))
    (told,) = wiring_notices(wiring_of(sailed, wrong), wrong)
    mine, other = (t.servo.channel for t in WAMV.thrusters)
    first, last = sorted((mine, other))
    assert told.startswith(
        f"right (channel 7): this log never drives output 7; it drives {first} and {last}; "
    )
    assert all(trial.name in told for trial in sailed)
    adrift = [replace(t, channels=(), pwm=t.pwm[:, :0]) for t in sailed]
    assert not wiring_notices(wiring_of(adrift, wrong), wrong)
