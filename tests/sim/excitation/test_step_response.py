"""Rise and settling time against closed forms, and against a boat whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from sim.excitation.responses import responses_to, step_response, step_responses
from sim.model import Model
from tests.sim.vessels import RUDDER_BOAT, SHAPES, WAMV

TIME = np.arange(0.0, 60.0, 0.05)


@pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (-3.0, 2.0), (0.001, 5.0)])
def test_a_first_order_lag(gain, offset):
    tau = 4.0
    found = step_response(TIME, offset + gain * (1.0 - np.exp(-TIME / tau)))
    assert found.rise == pytest.approx(tau * np.log(9.0), rel=1e-3)
    assert found.settling_2 == pytest.approx(tau * np.log(50.0), rel=1e-3)
    assert found.settling_5 == pytest.approx(tau * np.log(20.0), rel=1e-3)
    assert found.overshoot == pytest.approx(0.0, abs=1e-4)
    assert (found.before, found.after) == pytest.approx((offset, offset + gain), rel=1e-4)


def test_a_swinging_response_settles_after_its_last_swing_out():
    damping, omega = 0.3, 2.0
    damped = omega * np.sqrt(1.0 - damping**2)
    swing = np.exp(-damping * omega * TIME)
    signal = 1.0 - swing * (
        np.cos(damped * TIME) + damping * omega / damped * np.sin(damped * TIME)
    )
    found = step_response(TIME, signal)
    assert found.overshoot == pytest.approx(
        np.exp(-np.pi * damping / np.sqrt(1 - damping**2)), rel=1e-3
    )
    outside = TIME[np.abs(signal - 1.0) > 0.02][-1]
    assert found.settling_2 == pytest.approx(outside, abs=0.05)
    assert found.rise < found.settling_5 < found.settling_2


def test_what_is_not_at_rest_has_no_times():
    assert not step_response(TIME, TIME).settled
    assert not step_response(TIME, 1.0 - np.exp(-TIME / 30.0)).settled
    assert not step_response(TIME, np.zeros_like(TIME)).settled
    assert not step_response(TIME, np.full_like(TIME, np.nan)).settled


def test_each_step_of_a_table_has_its_response():
    command = np.where(TIME < 10.0, 0.0, np.where(TIME < 40.0, 1.0, 0.4))
    signal, tau = np.zeros_like(TIME), 2.0
    for k in range(1, len(TIME)):
        held = command[k - 1]
        signal[k] = held + (signal[k - 1] - held) * np.exp(-0.05 / tau)
    up, down = responses_to(command, TIME, signal)
    assert (up.start, down.start) == pytest.approx((10.0, 40.0))
    assert up.rise == pytest.approx(tau * np.log(9.0), rel=0.02)
    assert down.rise == pytest.approx(tau * np.log(9.0), rel=0.02)
    assert (down.before, down.after) == pytest.approx((1.0, 0.4), abs=1e-3)


def test_a_ramp_is_no_step():
    assert responses_to(TIME, TIME, TIME) == []


def test_a_linear_boat_answers_as_its_time_constants_say():
    plain = replace(WAMV.dynamics, X_uu=-0.0, N_rr=-0.0, X_u=-40.0, N_r=-90.0)
    surge, yaw = step_responses(Model.of(replace(WAMV, dynamics=plain)))
    assert surge.rise == pytest.approx(plain.m11 / 40.0 * np.log(9.0), rel=0.01)
    assert surge.after == pytest.approx(90.0 / 40.0, rel=1e-3)
    assert yaw.settling_2 == pytest.approx(plain.m33 / 90.0 * np.log(50.0), rel=0.02)


@pytest.mark.parametrize("vessel", SHAPES, ids=lambda v: v.name)
def test_every_shape_answers_and_a_heavier_one_more_slowly(vessel):
    light = step_responses(Model.of(vessel))
    d = vessel.dynamics
    heavy = step_responses(Model.of(replace(vessel, dynamics=replace(d, m11=2 * d.m11))))
    assert light.surge.settled
    assert light.yaw.settled
    assert heavy.surge.rise == pytest.approx(2.0 * light.surge.rise, rel=0.02)


def test_a_boat_with_a_rudder_is_under_way_when_it_turns():
    assert step_responses(Model.of(RUDDER_BOAT)).yaw.after > 0.05
