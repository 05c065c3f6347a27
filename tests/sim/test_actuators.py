"""Thrusters, rudders and steered motors: which way they turn, and what bounds them."""

from dataclasses import replace

import numpy as np
import pytest

from sim.actuators import (
    STALL_SINE,
    angle_of,
    axis_of,
    rudder_force,
    slipstream,
    thrust_at,
    thrust_of,
    thruster_force,
)
from sim.body import Body, Flow, RudderParameters, ThrusterParameters
from sim.model import Model
from tests.sim.simulated import on_floats
from tests.sim.vessels import RUDDER_BOAT, STEERED_BOAT, WAMV

DT = 0.05
BODY = Body(*[0.0] * len(Body._fields))
BLADE = RudderParameters(0.0, -1.2, 0.0, -0.6, 0.5, 0.02, 1.5)
DRIVE = ThrusterParameters(0.0, -0.7, 0.4, 0.0, -50.0, 90.0, 2.0)


def flow(u, v=0.0, r=0.0):
    """A flow past the hull at u, v [m/s], r [rad/s]."""
    return Flow(u, v, r, u, v, 0.0, 0.0, 0.0, 0.0, np.nan, 0.0, 0.0, 0.0, BODY)


def turn(vessel, throttle, angle, seconds=8.0, start=(0.0,) * 6):
    """Yaw rate [rad/s] after some seconds of throttle and rudder."""
    commands = np.tile([throttle, angle], (round(seconds / DT), 1))
    return on_floats(vessel).simulate(commands, DT, np.array(start))[0][0, -1, 5]


def test_thrust_follows_the_curve_and_reaches_its_ends():
    c = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(thrust_of(c, DRIVE), [-50.0, -12.5, 0.0, 22.5, 90.0])


def test_a_thrust_without_bend_is_the_same_without_a_power():
    c, straight = np.linspace(-1.0, 1.0, 41), DRIVE._replace(exponent=1.0)
    np.testing.assert_array_equal(thrust_at(c, c, straight), thrust_of(c, straight))


def test_a_thruster_pushes_along_its_azimuth_and_turns_by_its_arm():
    X, Y, N = thruster_force(10.0, axis_of(np.pi / 2), DRIVE)
    np.testing.assert_allclose([X, Y, N], [0.0, 10.0, -7.0], atol=1e-12)
    assert (
        pytest.approx(-4.0) == thruster_force(10.0, axis_of(0.0), DRIVE).N
    )  # starboard motor: to port


def test_more_thrust_to_port_turns_to_starboard():
    states, _ = Model.of(WAMV).simulate(np.tile([0.8, 0.2], (100, 1)), DT)
    assert states[0, -1, 5] > 0.1
    assert states[0, -1, 2] > 0.1


def test_a_command_reaches_the_angles_at_its_ends():
    np.testing.assert_allclose(
        angle_of(np.array([-1.0, 0.0, 0.5, 1.0]), BLADE), [-0.6, 0, 0.25, 0.5]
    )


@pytest.mark.parametrize("vessel", [RUDDER_BOAT, STEERED_BOAT], ids=["rudder", "motor"])
def test_a_positive_angle_turns_the_bow_to_starboard_ahead_and_to_port_astern(vessel):
    assert turn(vessel, 0.6, 0.5) > 0.02
    assert turn(vessel, 0.6, -0.5) < -0.02
    assert turn(vessel, -0.8, 0.5) < -0.005
    assert turn(vessel, -0.8, -0.5) > 0.005
    assert abs(turn(vessel, 0.6, 0.0)) < 1e-12


def test_a_blade_in_the_slipstream_steers_before_the_boat_moves():
    dry = replace(RUDDER_BOAT, rudders=(replace(RUDDER_BOAT.rudders[0], wash=None),))
    assert turn(RUDDER_BOAT, 1.0, 0.5, seconds=DT) > 20 * abs(turn(dry, 1.0, 0.5, seconds=DT))


def test_a_rudder_coasting_ahead_steers_too():
    start = (0.0, 0.0, 0.0, 1.5, 0.0, 0.0)
    assert turn(RUDDER_BOAT, 0.0, 0.5, 1.0, start) > 0.01


def test_lift_grows_with_the_square_of_speed_and_stops_at_stall():
    slow, fast = (rudder_force(0.2, flow(u), 0.0, BLADE) for u in (1.0, 2.0))
    np.testing.assert_allclose(fast, 4.0 * np.array(slow))
    normal = 0.5 * 1000.0 * 0.02 * (6.13 * 1.5 / 3.75) * STALL_SINE
    assert pytest.approx(normal * np.cos(0.8)) == -rudder_force(0.8, flow(1.0), 0.0, BLADE).Y


def test_a_blade_amidships_damps_drift_and_turn():
    for u in (-1.0, 0.5, 2.0):
        for v, r in ((0.3, 0.0), (-0.3, 0.0), (0.0, 0.4), (0.2, -0.4)):
            f = rudder_force(0.0, flow(u, v, r), 0.0, BLADE)
            assert f.X * u + f.Y * v + f.N * r < 0.0


def test_the_slipstream_is_that_of_the_actuator_disc():
    jet = slipstream(1.0, 40.0, BLADE)
    disc = 0.25 * np.pi * BLADE.area * BLADE.aspect
    through = 0.5 * (1.0 + (1.0 + jet))  # momentum theory: thrust = ρ A (mean speed) (gain)
    assert 1000.0 * disc * through * jet == pytest.approx(40.0)
    assert slipstream(1.0, -40.0, BLADE) == 0.0


def test_a_steered_motor_keeps_its_thrust_and_turns_it():
    commands = np.tile([0.5, 1.0], (1, 1))
    _, reports = Model.of(STEERED_BOAT).simulate(commands, DT)
    d, thrust = STEERED_BOAT.dynamics, 120.0 * 0.25
    X, Y, N = reports[0, 0, 6:] * [d.m11, d.m22, d.m33]
    np.testing.assert_allclose(
        [X, Y, N], thrust * np.array([np.cos(0.6), -np.sin(0.6), np.sin(0.6)])
    )
