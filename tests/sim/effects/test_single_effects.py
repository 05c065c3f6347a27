"""What single effects do, in figures that their equations give by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim.body import Report
from sim.effects.catalogue import named
from sim.effects.effect import ResidualForce
from sim.effects.velocity_latency import observe
from sim.model import Model
from sim.vessel import AddedEffect, Hull
from tests.sim.simulated import on_floats
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, WAMV, excitation

DT = 0.02


def with_effect(vessel, name, **values):
    return vessel.with_effects(AddedEffect(named(name), values))


def run(vessel, commands, x0=None, plain=True, **air):
    """States (T+1, nx) and reports (T+1, 9) of a free run."""
    model = on_floats(vessel) if plain else Model.of(vessel)
    states, reports = model.simulate(commands, DT, x0, **air)
    return states[0], reports[0]


def first_push(vessel, x0, commands=None, **air):
    """M ν̇ at the start (3,), less that of the vessel without effects: the force of the effect."""
    rest = np.zeros((1, len(vessel.actuators))) if commands is None else np.array([commands])
    d = vessel.dynamics
    bare = replace(vessel, effects=())
    rates = [run(v, rest, np.array(x0, float), **air)[1][0, 6:] for v in (vessel, bare)]
    return (rates[0] - rates[1]) * [d.m11, d.m22, d.m33]


# -- water and air --


@pytest.mark.parametrize(("u", "v", "yaw"), [(0.0, 0.0, 0.0), (1.0, 0.3, 2.1), (-0.5, -0.4, -1.0)])
@pytest.mark.parametrize(
    "given", [{}, {"c_x": 0.5, "c_n": 0.07, "centre": 0.2}], ids=["as published", "own"]
)
def test_wind_has_fossens_form(u, v, yaw, given):
    """Coefficients that a file does not name are the middle of the published ranges, and the
    centre of the lateral area lies midships: what lies ahead of there is pushed with its lever."""
    vessel = with_effect(WAMV, "steady_wind", speed=6.0, direction=0.8, **given)
    air = 6.0 * np.array([np.cos(0.8 + np.pi), np.sin(0.8 + np.pi)])
    u_rw = u - (np.cos(yaw) * air[0] + np.sin(yaw) * air[1])
    v_rw = v - (np.cos(yaw) * air[1] - np.sin(yaw) * air[0])
    angle = -np.arctan2(v_rw, u_rw)
    q, (front, side) = 0.5 * 1.225 * (u_rw**2 + v_rw**2), WAMV.hull.wind_area
    expected = q * np.array(
        [
            -given.get("c_x", 0.7) * np.cos(angle) * front,
            0.825 * np.sin(angle) * side,
            (
                given.get("c_n", 0.125) * np.sin(2.0 * angle)
                + given.get("centre", 0.0) * 0.825 * np.sin(angle)
            )
            * side
            * WAMV.hull.length,
        ]
    )
    np.testing.assert_allclose(first_push(vessel, [0, 0, yaw, u, v, 0]), expected, atol=1e-9)


def test_a_measured_wind_counts_and_the_assumed_one_does_not():
    """The wind that blows from 0.8 rad at 6 m/s, once assumed and once measured."""
    commands = excitation(WAMV, 4.0, DT)
    blowing = np.tile([-6.0 * np.cos(0.8), -6.0 * np.sin(0.8)], (len(commands), 1))
    assumed = run(with_effect(WAMV, "steady_wind", speed=6.0, direction=0.8), commands)[1]
    other = with_effect(WAMV, "steady_wind", speed=30.0, direction=-2.0)
    np.testing.assert_allclose(run(other, commands, wind=blowing)[1], assumed, atol=1e-12)


BARE = replace(WAMV, hull=Hull(4.9, 2.3, 180.0))


def test_wind_acts_on_assumed_areas_where_there_are_none():
    """The same force as with these very areas given; another one with others."""
    wind = {"speed": 5.0, "direction": 0.7}
    given = replace(BARE, hull=replace(BARE.hull, wind_area=BARE.hull.areas))
    assumed = with_effect(BARE, "steady_wind", **wind)
    here = first_push(assumed, [0, 0, 0.3, 0.5, 0.1, 0])
    np.testing.assert_array_equal(
        here, first_push(with_effect(given, "steady_wind", **wind), [0, 0, 0.3, 0.5, 0.1, 0])
    )
    other = first_push(with_effect(WAMV, "steady_wind", **wind), [0, 0, 0.3, 0.5, 0.1, 0])
    assert np.abs(here - other).max() > 1.0
    assert not BARE.unmet_needs(named("steady_wind"))


def test_only_a_vessel_whose_effects_need_areas_that_it_lacks_says_assumed():
    wind = {"speed": 5.0, "direction": 0.7}
    (text,) = with_effect(BARE, "steady_wind", **wind).assumptions
    assert "frontal 1.13 m², lateral 2.88 m²" in text
    assert "hull.wind_area" in text
    assert not BARE.assumptions
    assert not with_effect(WAMV, "steady_wind", **wind).assumptions
    assert not with_effect(BARE, "steady_current", speed=0.3, direction=0.0).assumptions


@pytest.mark.parametrize("factor", [0.5, 0.7, 1.0, 1.4, 2.0])
def test_the_range_of_a_wind_holds_the_true_speed_for_areas_of_half_to_twice(factor):
    """Areas k times as large and a wind 1/√k times as fast push a boat at rest alike."""
    true = 8.0
    front, side = BARE.hull.areas
    real = replace(BARE, hull=replace(BARE.hull, wind_area=(factor * front, factor * side)))
    push = first_push(with_effect(real, "steady_wind", speed=true, direction=0.7), np.zeros(6))
    told = {"speed": true * np.sqrt(factor), "direction": 0.7}
    alike = first_push(with_effect(BARE, "steady_wind", **told), np.zeros(6))
    np.testing.assert_allclose(alike, push, rtol=1e-9)
    known = AddedEffect(named("steady_wind"), told).values
    found = named("steady_wind").assumption(BARE, known, {"speed": (told["speed"],) * 2})
    low, high = found.ci95["speed"]
    assert low - 1e-9 <= true <= high + 1e-9
    assert high / low == pytest.approx(2.0 * 1.4)  # areas, and the coefficients beside them
    abeam = first_push(with_effect(BARE, "steady_wind", speed=told["speed"], direction=np.pi / 2),
                       np.zeros(6))  # fmt: skip
    assert found.numbers["force_abeam_N"] == pytest.approx(-abeam[1])
    assert f"from 40° with about {-abeam[1]:.0f} N abeam" in found.description


def test_nothing_is_assumed_of_a_wind_on_known_areas():
    told = {"speed": 8.0, "direction": 0.7}
    assert named("steady_wind").assumption(WAMV, told, {"speed": (7.0, 9.0)}) is None


def test_steering_effects_need_something_that_steers():
    with pytest.raises(ValueError, match="steering_lag needs a rudder"):
        with_effect(WAMV, "steering_lag", tau=0.3)
    assert with_effect(RUDDER_BOAT, "steering_lag", tau=0.3).effects


def test_a_boat_that_runs_with_the_wave_feels_one_phase():
    p = {"force": 10.0, "omega": 2.0, "direction": 0.5, "phase": 1.0}
    law, parameters = named("wave_motion").force, SimpleWave(**p)
    time = np.linspace(0.0, 30.0, 20)
    along = 9.81 / 2.0 * time  # celerity g/ω
    push = law(Place(time, along * np.cos(0.5), along * np.sin(0.5), 0.5), parameters)
    np.testing.assert_allclose(push.X, 10.0 * np.sin(1.0), atol=1e-9)
    np.testing.assert_allclose(push.Y, 0.0, atol=1e-9)


def test_the_search_for_waves_begins_at_the_train_that_pushes():
    """A boat that wanders, a train of 3 N and noise of 1 N; the phase is that of a plain sine."""
    rng, time = np.random.default_rng(1), 0.2 * np.arange(1500)
    place = np.cumsum(rng.normal(0.1, 0.2, (len(time), 2)), axis=0)
    omega, direction, unit = 2.1, 1.0, np.array([np.cos(1.0), np.sin(1.0)])
    push = 3.0 * np.sin(omega * time - omega**2 / 9.81 * (place @ unit) + 0.3)
    force = push[:, None] * unit + rng.normal(0.0, 1.0, place.shape)
    search = named("wave_motion").search
    assert search is not None
    found, other = search(WAMV, lambda: ResidualForce(time, place, force))
    assert found["omega"] == pytest.approx(omega, abs=0.01)
    assert found["direction"] == pytest.approx(direction, abs=0.05)
    assert found["force"] == pytest.approx(3.0, rel=0.1)
    assert other["force"] < 0.5


class SimpleWave:
    def __init__(self, **values):
        vars(self).update(values)


class Place:
    def __init__(self, time, north, east, yaw):
        self.time, self.north, self.east, self.yaw = time, north, east, yaw


# -- thrust --


def test_wiring_is_read_digit_by_digit():
    commands = excitation(IACQUABOT, 4.0, DT)
    wired = with_effect(IACQUABOT, "actuator_wiring", order=3142.0, reversed=24.0)
    expected = run(IACQUABOT, commands[:, [2, 0, 3, 1]] * [1.0, -1.0, 1.0, -1.0])[1]
    np.testing.assert_allclose(run(wired, commands)[1], expected, atol=1e-12)


def test_wiring_reaches_the_rudder():
    commands = excitation(RUDDER_BOAT, 4.0, DT)
    wired = with_effect(RUDDER_BOAT, "actuator_wiring", order=0.0, reversed=2.0)
    expected = run(RUDDER_BOAT, commands * [1.0, -1.0])[1]
    np.testing.assert_allclose(run(wired, commands)[1], expected, atol=1e-12)


@pytest.mark.parametrize("plain", [pytest.param(False, marks=pytest.mark.slow), True])
def test_sag_goes_with_the_measured_voltage_and_is_none_without(plain):
    commands = np.full((100, 2), 0.6)
    sagging = with_effect(WAMV, "battery_sag", nominal=16.0)
    unknown = run(sagging, commands, plain=plain)[1]
    np.testing.assert_array_equal(unknown, run(WAMV, commands, plain=plain)[1])
    volts = np.linspace(16.0, 12.0, 100)
    sagged = run(sagging, commands, plain=plain, voltage=volts)[1]
    weaker = run(WAMV, commands * (volts[:, None] / 16.0) ** 2, plain=plain)[1]
    np.testing.assert_allclose(sagged[:-1, :6], weaker[:-1, :6], atol=1e-9)


def test_a_fault_comes_at_its_time():
    commands = np.full((200, 2), 0.6)
    faulty = with_effect(WAMV, "thruster_fault", thruster=2.0, gain=0.25, time=2.0)
    broken = commands * np.where(np.arange(200)[:, None] * DT < 2.0, 1.0, [1.0, 0.25])
    poses = [run(v, c)[1][:, :3] for v, c in ((faulty, commands), (WAMV, broken))]
    np.testing.assert_allclose(poses[0], poses[1], atol=2e-3)  # its last stage sees the step
    assert np.abs(poses[0] - run(WAMV, commands)[1][:, :3]).max() > 0.1


def test_dead_band_and_curve_keep_full_throttle():
    for name, values in (("thruster_deadband", {"width": 0.2}), ("thrust_curve", {"exponent": 2})):
        vessel = with_effect(WAMV, name, **values)
        for c in (1.0, -1.0):
            full = first_push(vessel, np.zeros(6), [c, c])
            np.testing.assert_allclose(full, 0.0, atol=1e-9)
        assert first_push(vessel, np.zeros(6), [0.5, 0.5])[0] < -10.0
        assert first_push(vessel, np.zeros(6), [-0.5, -0.5])[0] > 10.0


def test_a_dead_band_may_jump_and_may_be_left_out_of_a_file():
    rest, half = np.zeros(6), [0.5, 0.5]
    for jump, instead in ((0.0, 0.375), (1.0, 0.5), (0.5, 0.4375)):
        vessel = with_effect(WAMV, "thruster_deadband", width=0.2, jump=jump)
        for given, turned in ((0.5, instead), (0.19, 0.0), (-0.19, 0.0), (1.0, 1.0)):
            there = run(vessel, np.array([[given, given]]), rest)[1][0, 6:]
            expected = run(WAMV, np.array([[turned, turned]]), rest)[1][0, 6:]
            np.testing.assert_allclose(there, expected, atol=1e-9)
    older = with_effect(WAMV, "thruster_deadband", width=0.2)
    assert older.effects[0].values == {"width": 0.2, "jump": 0.0}
    none = first_push(with_effect(WAMV, "thruster_deadband", width=0.0, jump=1.0), rest, half)
    np.testing.assert_allclose(none, 0.0, atol=1e-6)


def test_loss_ahead_and_stall_astern_know_their_quadrant():
    advance = with_effect(WAMV, "advance_loss", per_mps=0.2)
    stall = with_effect(WAMV, "astern_stall", per_mps=0.5, above=0.4)
    for u in (-1.0, 0.0, 1.0, 9.0):
        at, left = [0, 0, 0, u, 0, 0], max(1.0 - 0.2 * max(u, 0.0), 0.0)
        assert first_push(advance, at, [1.0, 1.0])[0] == pytest.approx(180.0 * (left - 1.0))
        assert first_push(advance, at, [-1.0, -1.0])[0] == pytest.approx(0.0, abs=1e-9)
        left = max(1.0 - 0.5 * max(u - 0.4, 0.0), 0.0)
        assert first_push(stall, at, [-1.0, -1.0])[0] == pytest.approx(-170.0 * (left - 1.0))
        assert first_push(stall, at, [1.0, 1.0])[0] == pytest.approx(0.0, abs=1e-9)


# -- hull --


def test_a_load_that_comes_aboard_slows_every_change_and_no_speed():
    vessel = with_effect(WAMV, "payload_change", factor=2.0, time=1.0)
    states, reports = run(vessel, np.full((6000, 2), 0.5))
    plain = run(WAMV, np.full((6000, 2), 0.5), plain=False)[1]
    k = round(1.0 / DT)
    np.testing.assert_allclose(states[:k], run(WAMV, np.full((k - 1, 2), 0.5))[0], atol=1e-9)
    assert reports[k + 1, 6] == pytest.approx(0.5 * plain[k + 1, 6], rel=1e-2)
    assert reports[-1, 3] == pytest.approx(plain[-1, 3], rel=1e-3)


def test_the_optional_terms_of_a_vessel_file_are_the_same_as_their_effects():
    d, commands = WAMV.dynamics, excitation(WAMV, 6.0, DT)
    pairs = (
        ("cg_offset", {"x_g": -0.2}),
        ("cross_damping", {"Y_r": -14.0, "N_v": 11.0}),
        ("hull_lift", {"Y_uv": -30.0, "Y_ur": 12.0, "N_uv": 15.0, "N_ur": -20.0}),
    )
    for name, values in pairs:
        by_file = replace(WAMV, dynamics=replace(d, **values))
        by_effect = with_effect(WAMV, name, **values)
        np.testing.assert_allclose(
            run(by_effect, commands)[1], run(by_file, commands)[1], atol=1e-10, err_msg=name
        )


# -- sensors --


def over_ground(reports):
    """Reports (T, 9) -> position and velocity north, east (T, 4)."""
    c, s = np.cos(reports[:, 2]), np.sin(reports[:, 2])
    u, v = reports[:, 3], reports[:, 4]
    return np.stack([reports[:, 0], reports[:, 1], c * u - s * v, s * u + c * v], axis=1)


@pytest.mark.parametrize("plain", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_late_receiver_shows_the_boats_own_past(plain):
    commands = excitation(WAMV, 6.0, DT)
    _, now = run(WAMV, commands, plain=plain)
    for steps in (5, 7.5):
        late = with_effect(WAMV, "velocity_latency", delay=steps * DT)
        _, reported = run(late, commands, plain=plain)
        np.testing.assert_array_equal(reported[:, [2, 5, 6, 7, 8]], now[:, [2, 5, 6, 7, 8]])
        low, high = int(np.floor(steps)), int(np.ceil(steps))
        track, at = over_ground(now), np.arange(high, len(now))
        past = 0.5 * (track[at - low] + track[at - high])
        np.testing.assert_allclose(over_ground(reported)[high:], past, atol=1e-12)


def test_a_late_receiver_shows_an_extrapolation_where_the_past_is_not_known():
    """A boat that has been under way for long: its first rows are as if it had been seen before."""
    commands = np.full((400, 2), 0.7)
    states, now = run(WAMV, commands)
    late = with_effect(WAMV, "velocity_latency", delay=0.1)
    _, reported = run(late, commands[200:], states[200])
    np.testing.assert_allclose(over_ground(reported)[:20], over_ground(now)[195:215], atol=1e-3)
    assert np.abs(over_ground(reported)[:20] - over_ground(now)[200:220]).max() > 0.05


def test_a_late_place_lies_back_along_the_course_over_ground():
    """On a heading to the south-east and in a turn: north and east, ahead and aside are told."""
    now = Report(10.0, 20.0, 2.0, 3.0, -0.5, 0.4, 0.2, 0.1, 0.05)
    seen, delay = observe(now, SimpleNamespace(delay=0.5)), 0.5
    rotation = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    rate = np.array([0.2 - 0.4 * -0.5, 0.1 + 0.4 * 3.0])  # of the velocity over ground, in the body
    speed = np.array([3.0, -0.5])
    place = np.array([10.0, 20.0]) - rotation @ (delay * speed - 0.5 * delay**2 * rate)
    np.testing.assert_allclose((seen.north, seen.east), place, atol=1e-12)
    np.testing.assert_allclose((seen.u, seen.v), speed - delay * rate, atol=1e-12)
    assert (seen.yaw, *seen[5:]) == (2.0, 0.4, 0.2, 0.1, 0.05)


def test_the_true_motion_is_found_behind_all_sensors_at_once():
    sensors = (
        AddedEffect(named("antenna_offset"), {"x": 0.5, "y": -0.4}),
        AddedEffect(named("velocity_latency"), {"delay": 0.3}),
        AddedEffect(named("compass_deviation"), {"b": 0.2, "c": -0.15}),
        AddedEffect(named("heading_offset"), {"angle": 0.3}),
        AddedEffect(named("yaw_rate_bias"), {"bias": 0.05}),
    )
    model = on_floats(IACQUABOT.with_effects(*sensors))
    rng = np.random.default_rng(4)
    states = rng.uniform(-2.0, 2.0, (200, 6))
    commands = np.zeros((1, 4))
    reported = np.stack([model.simulate(commands, DT, x)[1][0, 0] for x in states])
    np.testing.assert_allclose(model.true_states(reported), states, rtol=0, atol=1e-9)


def test_deviation_goes_round_with_the_heading():
    vessel = with_effect(WAMV, "compass_deviation", b=0.1, c=0.05)
    for yaw, d in ((0.0, 0.05), (0.5 * np.pi, 0.1), (np.pi, -0.05), (-0.5 * np.pi, -0.1)):
        _, reported = run(vessel, np.zeros((1, 2)), np.array([0.0, 0.0, yaw, 1.0, 0.0, 0.0]))
        assert reported[0, 2] == pytest.approx(yaw + d)
        assert reported[0, 4] == pytest.approx(-np.sin(d))
