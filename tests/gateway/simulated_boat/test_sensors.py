"""Sensor errors have the size and the pace that their table says; the IMU feels the turn."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import PCG64, Generator
from pymavlink.dialects.v20.ardupilotmega import MAVLink

from gateway.simulated_boat import FAST, SimulatedBoatSettings
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.simulated_boat.hull import TABLE, SensedValues, SensorModel, TrueState
from gateway.simulated_boat.telemetry import BoatSnapshot, battery_status, sys_status
from sim.body import Report
from sim.plants.waves import GRAVITY
from sim.vessel import Sensors
from tests.gateway.simulated_boat.frames import frames_of, messages_named, simulated_boat
from tests.sim.vessels import WAMV

REST = TrueState(Report(*[0.0] * 9), 0.0, 0.0, 14.0, 0.0)
MOVING = TrueState(Report(5.0, -3.0, 0.5, 1.0, 0.2, 0.1, 0.3, 0.0, 0.0), 0.4, -0.1, 14.0, 0.0)
NORTH, ROLL = SensedValues._fields.index("north"), SensedValues._fields.index("roll")


def readings(count, dt=0.02, seed=0):
    """Slow errors and readings (count, n) of a boat that lies still."""
    sensors, rng = SensorModel(dt, 1.0, 0.0), Generator(PCG64(seed))
    state, slow, sensed = sensors.start(rng), [], []
    for _ in range(count):
        state, values = sensors.read(state, REST, rng)
        slow.append(state.slow)
        sensed.append(values)
    return np.array(slow), np.array(sensed)


def test_slow_errors_are_as_large_as_their_table_says_from_the_start():
    starts = np.array([readings(1, seed=seed)[0][0] for seed in range(400)])
    assert np.std(starts, axis=0) == pytest.approx(TABLE[:, 0], rel=0.15)


def test_slow_errors_wander_at_their_own_pace():
    slow, _ = readings(20_000)
    leaps = np.std(np.diff(slow, axis=0), axis=0)
    assert leaps == pytest.approx(TABLE[:, 0] * np.sqrt(2.0 * 0.02 / TABLE[:, 1]), rel=0.05)


def test_white_noise_comes_on_top():
    slow, sensed = readings(4000)
    white = (sensed - slow)[:, [NORTH, ROLL]]
    assert np.std(white, axis=0) == pytest.approx(TABLE[[NORTH, ROLL], 2], rel=0.05)


def test_perfect_sensors_say_the_truth():
    sensors, rng = SensorModel(0.02, 0.0, 0.0), Generator(PCG64(0))
    _, s = sensors.read(sensors.start(rng), MOVING, rng)
    c, n = np.cos(0.5), np.sin(0.5)
    assert (s.north, s.east, s.yaw, s.yaw_rate) == (5.0, -3.0, 0.5, 0.1)
    assert (s.north_mps, s.east_mps) == pytest.approx((c - 0.2 * n, n + 0.2 * c))
    assert (s.forward, s.starboard, s.volts) == (0.4, -0.1, 14.0)
    assert s.gps_north == pytest.approx(5.0 - 0.12 * s.north_mps)  # a receiver tells the past
    assert s.gps_north_mps < s.north_mps  # the boat gathers way


def test_a_hull_that_heels_feels_gravity():
    sensors, rng = SensorModel(0.02, 1.0, 0.0), Generator(PCG64(1))
    felt = [sensors.read(sensors.start(rng), REST, rng)[1] for _ in range(2000)]
    lean = np.array([(s.roll, s.pitch, s.starboard, s.forward) for s in felt])
    assert np.polyfit(lean[:, 0], lean[:, 2], 1)[0] == pytest.approx(-GRAVITY, rel=0.1)
    assert np.polyfit(lean[:, 1], lean[:, 3], 1)[0] == pytest.approx(GRAVITY, rel=0.1)


@pytest.mark.slow
def test_the_imu_feels_acceleration_and_turn():
    """Specific force is the change of velocity in the world, seen in the body."""
    rates = dict.fromkeys(("HEARTBEAT", "ATTITUDE", "LOCAL_POSITION_NED", "RAW_IMU"), 50.0)
    frames = frames_of(simulated_boat(rates=rates, noise=0.0, gyro_filter_hz=0.0), 100.0)
    yaw = np.array([m.yaw for m in messages_named(frames, "ATTITUDE")])
    v = np.array([(m.vx, m.vy) for m in messages_named(frames, "LOCAL_POSITION_NED")])
    felt = np.array([(m.xacc, m.yacc) for m in messages_named(frames, "RAW_IMU")]) * 1e-3 * GRAVITY
    newton = np.gradient(v, 0.02, axis=0)
    c, s = np.cos(yaw), np.sin(yaw)
    body = np.stack([c * newton[:, 0] + s * newton[:, 1], c * newton[:, 1] - s * newton[:, 0]], 1)
    assert np.std(body[:, 1]) > 0.1
    assert np.std((felt - body)[:-60], axis=0) == pytest.approx([0.0, 0.0], abs=0.02)


@pytest.mark.slow
def test_an_imu_ahead_of_the_origin_feels_the_turn_pull_it_forward():
    """Centripetal acceleration −r² x, tangential ṙ x."""

    def felt(x):
        vessel = replace(WAMV, sensors=Sensors(imu=(x, 0.0)))
        settings = SimulatedBoatSettings(rates=FAST, noise=0.0, gyro_filter_hz=0.0)
        frames = frames_of(SimulatedBoat(vessel, settings), 45.0)
        imu = messages_named(frames, "RAW_IMU")
        rate = np.array([m.zgyro for m in imu]) * 1e-3
        return rate, np.array([(m.xacc, m.yacc) for m in imu]) * 1e-3 * GRAVITY

    (rate, here), (_, there) = felt(0.0), felt(2.0)
    off = there - here
    assert np.ptp(rate) > 0.2
    assert off[:, 0] == pytest.approx(-2.0 * rate**2, abs=0.03)
    assert np.std(off[:, 1] - 2.0 * np.gradient(rate, 0.04)) < 0.2 * np.std(off[:, 1])


@pytest.mark.parametrize(("amperes", "told"), [(12.34, 1234), (900.0, 32767)])
def test_a_current_beyond_what_its_message_holds_is_sent_as_the_most(amperes, told):
    """Of a boat of twice 1000 N: its motors draw more than 16 bits hold."""
    sensed = SensedValues(*[0.0] * len(SensedValues._fields))
    snapshot = BoatSnapshot(0, 0, True, sensed, (0,) * 32, 1.0, amperes, 10.0, 0.9, (0.0, 0.0),
                            (0.0, 0.0))  # fmt: skip
    for name in (sys_status, battery_status):
        message = name(snapshot)
        message.pack(MAVLink(None))
        assert message.current_battery == told
