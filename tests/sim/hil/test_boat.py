"""The boat that an autopilot drives: its three degrees, its three more, its sensors, its day."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import EFFECTS
from sim.hil.boat import Boat, command_of
from sim.hil.day import Day, Moment, Schedule, Wind, vessel_of_day
from sim.model import Model
from sim.plants.waves import GRAVITY, Sea
from sim.vessel import AddedEffect, Sensors, Servo
from tests.sim.simulated import on_floats
from tests.sim.vessels import RUDDER_BOAT, WAMV

EFFECT = {effect.name: effect for effect in EFFECTS}
AHEAD = {1: 1700.0, 2: 1600.0}


def sail(boat, pulses, seconds, dt=0.01):
    """State, readings and truth after each step."""
    state, out = boat.start(), []
    for _ in range(round(seconds / dt)):
        state, readings, truth = boat.step(state, pulses, dt)
        out.append((state, readings, truth))
    return out


def column(steps, name):
    return np.array([getattr(truth, name) for _, _, truth in steps])


@pytest.mark.parametrize("dt", [1 / 1200, 1 / 400, 0.02, 0.1])
def test_in_calm_water_three_degrees_are_those_of_the_vessel(dt):
    lag = AddedEffect(EFFECT["thruster_lag"], {"tau": 0.4})
    vessel = replace(RUDDER_BOAT, effects=(lag,))
    boat, pulses = Boat.of(vessel), {1: 1750.0, 3: 1580.0}
    steps = sail(boat, pulses, 10.0, dt)
    model, cuts = Model.of(vessel), int(np.ceil(dt / boat.longest_step - 1e-9))
    commands = np.tile(boat.commands(pulses), (len(steps) * cuts, 1))
    states, _ = model.simulate(commands, dt / cuts)
    rows = np.array([state.row for state, _, _ in steps])
    assert np.abs(rows[:, :6] - states[0, cuts::cuts, :6]).max() < 1e-6
    assert np.abs(rows[:, model.state_size :]).max() == 0.0
    assert abs(rows[-1, 0]) > 1.0


def test_at_rest_it_feels_gravity_and_nothing_else():
    _, readings, truth = Boat.of(WAMV).step(Boat.of(WAMV).start(), {}, 0.01)
    assert readings.accel == (0.0, 0.0, -GRAVITY)
    assert readings.gyro == readings.velocity == readings.position == (0.0, 0.0, 0.0)
    assert max(map(abs, truth[1:-1])) == 0.0
    assert readings.wind is readings.vane is readings.depth is None


def test_readings_are_derivatives_of_each_other_in_waves():
    """Gyro and accelerometer, integrated, give the attitude and the velocity that are reported."""
    dt = 1e-3
    boat = Boat.of(WAMV, Day(sea=Sea(0.6, 4.0, 0.7)), seed=3)
    steps = sail(boat, AHEAD, 6.0, dt)
    readings = [r for _, r, _ in steps]
    for k in range(1000, len(readings) - 1, 500):
        now, then = readings[k], readings[k + 1]
        f, t, y = now.attitude
        rates = (np.array(then.attitude) - readings[k - 1].attitude) / (2 * dt)
        body = (
            rates[0] - rates[2] * np.sin(t),
            rates[1] * np.cos(f) + rates[2] * np.cos(t) * np.sin(f),
            -rates[1] * np.sin(f) + rates[2] * np.cos(t) * np.cos(f),
        )
        assert now.gyro == pytest.approx(body, abs=2e-3)
        a = (np.array(then.velocity) - readings[k - 1].velocity) / (2 * dt)
        felt = rotation(f, t, y).T @ (a - [0.0, 0.0, GRAVITY])
        assert now.accel == pytest.approx(felt, abs=2e-2)
    moved = np.array(readings[-1].position) - readings[0].position
    mean = np.mean([r.velocity for r in readings[:-1]], axis=0)
    assert moved == pytest.approx(mean * dt * (len(readings) - 1), abs=5e-3)


def rotation(roll, pitch, yaw):
    """Body -> world, written out anew."""
    c, s = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    about_y = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    about_z = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def test_an_imu_off_the_centre_feels_the_turn_of_the_hull():
    """Against the second derivative of the place of the unit itself."""
    dt, lever = 1e-3, np.array([0.8, -0.5, 0.0])
    vessel = replace(WAMV, sensors=Sensors(imu=(0.8, -0.5)))
    steps = sail(Boat.of(vessel, Day(sea=Sea(0.5, 4.0, 0.7)), seed=3), {1: 1900.0}, 3.0, dt)
    place = np.array(
        [np.array([t.north, t.east, t.down]) + rotation(t.roll, t.pitch, t.yaw) @ lever
         for _, _, t in steps]
    )  # fmt: skip
    for k in range(500, len(steps) - 1, 250):
        a = (place[k + 1] - 2 * place[k] + place[k - 1]) / dt**2
        t = steps[k][2]
        felt = rotation(t.roll, t.pitch, t.yaw).T @ (a - [0.0, 0.0, GRAVITY])
        assert steps[k][1].accel == pytest.approx(felt, abs=3e-2)
    assert abs(steps[-1][1].accel[1]) > 0.02, "the lever arm matters here"


def test_a_hull_on_long_waves_follows_the_surface():
    boat = Boat.of(WAMV, Day(sea=Sea(1.0, 12.0)), seed=1)
    steps = sail(boat, {}, 60.0, 0.02)
    up, elevation = -column(steps, "down"), column(steps, "elevation")
    assert np.std(elevation) == pytest.approx(0.25, rel=0.4), "a quarter of the height"
    assert np.corrcoef(up, elevation)[0, 1] > 0.99
    assert np.std(column(steps, "pitch")) > 5 * np.std(column(steps, "roll")), "head on: it pitches"


def test_waves_from_abeam_roll_and_push_sideways():
    steps = sail(Boat.of(WAMV, Day(sea=Sea(0.5, 5.0, np.pi / 2)), seed=1), {}, 20.0, 0.02)
    assert np.std(column(steps, "roll")) > 5 * np.std(column(steps, "pitch"))
    assert np.std(column(steps, "wave_Y")) > 5 * np.std(column(steps, "wave_X"))
    for name in ("u", "v", "w", "r", "roll_rate", "pitch_rate"):
        assert np.std(column(steps, name)) > 0.0, f"{name}: all six degrees move"


def test_waves_are_those_of_their_seed():
    def heave(seed):
        return column(sail(Boat.of(WAMV, Day(sea=Sea(0.4, 4.0)), seed=seed), {}, 2.0), "down")

    assert np.array_equal(heave(1), heave(1))
    assert not np.array_equal(heave(1), heave(2))


def test_waves_that_would_break_are_refused():
    with pytest.raises(ValueError, match="such waves break"):
        Sea(2.0, 2.0)


@pytest.mark.usefixtures("plain_laws")
def test_a_current_that_rises_carries_the_boat():
    moment = Moment(5.0, 2.0, EFFECT["steady_current"], {"speed": 0.6, "direction": np.pi / 2})
    steps = sail(Boat.of(WAMV, Day(moments=(moment,))), {}, 60.0, 0.02)
    east = column(steps, "water_east")
    assert east[240] == 0.0
    assert east[299] == pytest.approx(0.3, abs=0.01), "half way up"
    assert east[400] == pytest.approx(0.6)
    assert column(steps, "v")[-1] == pytest.approx(0.6, abs=0.05)


def test_a_motor_that_fails_gives_no_thrust_from_its_moment_on():
    steps = sail(Boat.of(WAMV, Day(moments=(Moment(2.0, thruster="left", gain=0.0),))), AHEAD, 4.0)
    force = column(steps, "X")
    left, right = 90.0 * 0.5, 90.0 * 0.25
    assert force[100] == pytest.approx(left + right)
    assert force[300] == pytest.approx(right)


def test_a_thruster_that_is_not_there_cannot_fail():
    with pytest.raises(ValueError, match="no thruster 'middle': there are left, right"):
        vessel_of_day(WAMV, Day(moments=(Moment(1.0, thruster="middle", gain=0.0),)))


def test_a_wind_that_turns_is_seen_by_the_vane():
    day = Day(wind=Wind(5.0, 0.0), moments=(Moment(1.0, wind=Wind(5.0, np.pi / 2)),))
    steps = sail(Boat.of(WAMV, day), {}, 2.0)
    before, after = steps[50][1], steps[150][1]
    assert before.vane == pytest.approx((0.0, 5.0), abs=1e-6)
    assert after.vane == pytest.approx((np.pi / 2, 5.0), abs=1e-6)
    assert after.wind == pytest.approx((0.0, -5.0), abs=1e-9)


def test_a_wind_that_rises_on_a_day_without_wind_rises_from_calm():
    rising = Moment(1.0, over=4.0, wind=Wind(8.0, 0.3))
    steps = sail(Boat.of(WAMV, Day(moments=(rising,))), {}, 6.0)
    speed = np.hypot(column(steps, "wind_north"), column(steps, "wind_east"))
    time = column(steps, "time")
    begun = time > 1.02
    assert np.allclose(speed[time < 0.98], 0.0)
    assert np.abs(speed - 8.0 * np.clip((time - 1.0) / 4.0, 0.0, 1.0))[begun].max() < 0.05


WITH_NOTHING = [  # effects that can be nothing; a lag or a battery acts from the start
    effect
    for effect in EFFECTS
    if any(p.neutral is not None or p.unit == "m/s" for p in effect.parameters)
    and not WAMV.unmet_needs(effect)
]


@pytest.mark.parametrize("effect", WITH_NOTHING, ids=lambda effect: effect.name)
def test_what_a_moment_brings_is_nothing_before_it_and_rises_from_there(effect):
    """Currents, winds, waves that push, faults: none of them acts, or jumps, ahead of its time."""
    full = {p.name: p.start for p in effect.parameters}
    still = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
    still = still or {p.name: 0.0 for p in effect.parameters if p.unit == "m/s"}
    moment = Moment(10.0, over=20.0, effect=effect, values=full)
    day = Day(moments=(moment,))
    model = on_floats(vessel_of_day(WAMV, day))  # names and numbers alone: nothing is compiled
    schedule = Schedule(model, day)
    for name, nothing in still.items():
        column = model.names.index(f"{effect.name}.{name}")
        seen = [schedule.at(time)[0][column] for time in (0.0, 9.9, 10.0, 20.0, 30.0, 99.0)]
        half = 0.5 * (nothing + full[name])
        assert seen == pytest.approx([nothing, nothing, nothing, half, full[name], full[name]])


@pytest.mark.usefixtures("plain_laws")
def test_a_wind_of_an_effect_does_not_push_before_its_moment():
    values = {"speed": 10.0, "direction": 0.0}  # from north: on the bow
    moment = Moment(5.0, over=5.0, effect=EFFECT["steady_wind"], values=values)
    surge = column(sail(Boat.of(WAMV, Day(moments=(moment,))), {}, 12.0), "u")
    assert np.abs(surge[:490]).max() == 0.0
    assert surge[-1] < -0.01


def test_the_vane_feels_the_speed_of_the_boat():
    steps = sail(Boat.of(WAMV, Day(wind=Wind(3.0, 0.0))), {1: 1800.0, 2: 1800.0}, 20.0, 0.02)
    angle, speed = steps[-1][1].vane
    assert angle == pytest.approx(0.0, abs=1e-6)
    assert speed == pytest.approx(3.0 + steps[-1][2].u)


@pytest.mark.usefixtures("plain_laws")
def test_commands_that_act_late_act_late():
    vessel = replace(WAMV, effects=(AddedEffect(EFFECT["command_delay"], {"delay": 0.5}),))
    speed = column(sail(Boat.of(vessel), AHEAD, 1.0), "u")
    at_once = column(sail(Boat.of(WAMV), AHEAD, 0.5), "u")
    assert np.abs(speed[:49]).max() == 0.0
    assert speed[-50:] == pytest.approx(at_once, abs=1e-9)


@pytest.mark.usefixtures("plain_laws")
def test_effects_on_sensors_are_felt_by_the_autopilot():
    off = AddedEffect(EFFECT["heading_offset"], {"angle": 0.2})
    biased = AddedEffect(EFFECT["yaw_rate_bias"], {"bias": 0.01})
    steps = sail(Boat.of(replace(WAMV, effects=(off, biased))), {1: 1700.0, 2: 1700.0}, 5.0)
    _, readings, truth = steps[-1]
    assert readings.attitude[2] == pytest.approx(truth.yaw + 0.2)
    assert readings.gyro[2] == pytest.approx(truth.r + 0.01)
    assert readings.velocity[:2] == pytest.approx((truth.u, 0.0), abs=1e-9), "GNSS has no compass"


def test_errors_have_the_size_that_the_vessel_file_says():
    dt = 0.01
    sensors = Sensors(
        gyro_noise=1e-3, gyro_bias=(0.01, 0.02, 0.03), accel_noise=2e-2,
        accel_bias=(0.1, 0.2, 0.3), position_noise=0.5, velocity_noise=0.1,
    )  # fmt: skip
    steps = sail(Boat.of(replace(WAMV, sensors=sensors), seed=5), {}, 40.0, dt)
    expected = {
        "gyro": ((0.01, 0.02, 0.03), 1e-3 / dt**0.5),
        "accel": ((0.1, 0.2, 0.3 - GRAVITY), 2e-2 / dt**0.5),
        "position": ((0.0, 0.0, 0.0), 0.5),
        "velocity": ((0.0, 0.0, 0.0), 0.1),
        "attitude": ((0.0, 0.0, 0.0), 0.0),
    }
    for name, (mean, std) in expected.items():
        values = np.array([getattr(r, name) for _, r, _ in steps])
        assert values.std(axis=0) == pytest.approx([std] * 3, rel=0.05)
        assert values.mean(axis=0) == pytest.approx(mean, abs=5 * std / len(values) ** 0.5 + 1e-12)


def test_the_battery_sags_and_drains():
    boat = Boat.of(WAMV)
    idle, full = (sail(boat, pulses, 60.0, 0.1)[-1][1] for pulses in ({}, {1: 1900.0, 2: 1900.0}))
    assert idle.current == 0.0
    assert full.current == pytest.approx(boat.battery.full_current)
    assert full.voltage == pytest.approx(14.8 * (1.1 - 0.06 - 0.15 * 60.0 / 3600.0))
    assert idle.voltage == pytest.approx(14.8 * 1.1)


def test_depth_is_what_is_under_the_hull():
    steps = sail(Boat.of(WAMV, Day(depth=4.0, sea=Sea(0.5, 5.0)), seed=2), {}, 5.0)
    _, readings, truth = steps[-1]
    assert readings.depth == pytest.approx((4.0 - truth.down) / np.cos(truth.pitch), rel=1e-3)


@pytest.mark.parametrize(
    "servo", [Servo(1), Servo(1, (1000, 1000, 2000)), Servo(1, (1200, 1450, 1800), True)]
)
def test_one_pulse_gives_the_command_that_a_table_of_them_gives(servo):
    pulses = np.array([0.0, 65535.0, np.nan, 900.0, 1000.0, 1333.0, 1450.0, 1500.0, 1777.0, 3000.0])
    assert [command_of(servo, p) for p in pulses] == pytest.approx(servo.command(pulses).tolist())


def test_a_motion_without_bounds_is_an_error_that_says_so():
    wild = replace(WAMV, dynamics=replace(WAMV.dynamics, X_uu=60.0, X_u=20.0))
    with pytest.raises(ArithmeticError, match=r"its motion left all bounds .* check the signs"):
        sail(Boat.of(wild), {1: 1900.0, 2: 1900.0}, 60.0, 0.02)
