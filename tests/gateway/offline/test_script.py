"""The Lua script in a Lua interpreter: a whole run, every reason to stop, every refusal."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.offline.plan import SafetyLimits, pulse_bounds, safety_for, script_text
from sim.excitation import StickLimits, plan_of
from sim.excitation.catalogue import MANOEUVRES, Steps, Zigzag
from sim.model import Model
from tests.gateway.offline.autopilot import GUIDED, HOLD, MANUAL, Autopilot
from tests.sim.vessels import RUDDER_BOAT, WAMV

LIMITS = StickLimits(throttle=0.6, steer=0.5)
SAFETY = SafetyLimits(radius_m=50.0, highest_speed_mps=2.0, time_out_s=65.0)


@pytest.fixture(scope="module")
def plan():
    return plan_of(Zigzag(), Model.of(WAMV), LIMITS)


@pytest.fixture(scope="module")
def text(plan):
    return script_text(plan, SAFETY, "1.2.3")


@pytest.fixture
def boat(text):
    return Autopilot(text)


def neutral(boat):
    return boat.driven[-1][1:] == (0, 0)


def test_a_whole_run_plays_the_plan_and_ends_in_neutral_and_hold(boat, plan):
    boat.started(70.0)
    assert boat.said[-1] == "Plan: done"
    assert boat.modes == [HOLD]
    assert neutral(boat)
    ms, steer, throttle = np.array(boat.driven).T
    since = (ms - ms[0]) / 1000.0 + 0.05
    expected = [np.interp(since, plan.time, column) for column in plan.sticks.T]
    assert throttle[:-1] == pytest.approx(expected[0][:-1], abs=0.06)  # a step of the slew
    assert steer[:-1] == pytest.approx(expected[1][:-1], abs=0.11)
    assert since[-1] == pytest.approx(60.0, abs=0.2)


def test_sticks_keep_amplitude_and_slew_even_if_the_table_is_spoiled(text):
    head, _, _ = text.partition("local PLAN = {")
    _, _, tail = text.partition("local PLAN = {")[2].partition("}\n")
    wild = "0, 0, 0, 100, 3000, -3000, 4000, 3000, 3000, 9000, -3000, 3000,"
    boat = Autopilot(f"{head}local PLAN = {{{wild}}}\n{tail}").started(8.0)
    ms, steer, throttle = np.array(boat.driven).T
    assert np.abs(throttle).max() == pytest.approx(0.6)
    assert np.abs(steer).max() == pytest.approx(0.5)
    assert (np.abs(np.diff(throttle)) <= 1.0 * np.diff(ms) / 1000 + 1e-9).all()
    assert (np.abs(np.diff(steer)) <= 2.0 * np.diff(ms) / 1000 + 1e-9).all()


REASONS = [
    ({"switch": 0}, "switch"),
    ({"switch": 1}, "switch"),
    ({"has_switch": False}, "switch"),
    ({"remote": False}, "remote lost"),
    ({"sticks": {1: 1600, 3: 1500}}, "stick moved"),
    ({"sticks": {1: 1500, 3: 1400}}, "stick moved"),
    ({"sticks": {}}, "remote lost"),
    ({"north_m": 151.0}, "out of the circle"),
    ({"north_m": 49.0}, "out of the circle"),
    ({"speed_mps": 2.1}, "too fast"),
    ({"fix": False}, "position lost"),
    ({"ekf": False}, "position lost"),
    ({"volts": 11.9}, "battery low"),
    ({"battery_healthy": False}, "battery low"),
    ({"pulses": {1: 1950, 2: 1500}}, "output 1 beyond the plan"),
    ({"pulses": {1: 1500, 2: 1110}}, "output 2 beyond the plan"),
    ({"takes_sticks": False}, "sticks refused"),
]


@pytest.mark.parametrize(("change", "says"), REASONS, ids=lambda x: str(x))
def test_it_stops_in_neutral_and_hold(boat, change, says):
    boat.started()
    assert boat.driven[-1][2] > 0.2
    for name, value in change.items():
        setattr(boat, name, value)
    before = boat.clock_ms
    while not boat.modes and boat.clock_ms < before + 5000:
        boat.step()
    assert boat.said[-1] == f"Plan: stopped, {says}"
    assert boat.mode == HOLD
    assert not boat.takes_sticks or neutral(boat)
    patient = {"battery low": 2100, "output": 600}
    allowed = next((ms for key, ms in patient.items() if says.startswith(key)), 50)
    assert boat.clock_ms - before <= allowed
    count = len(boat.driven)
    boat.run(5.0)
    assert len(boat.driven) == count  # and is silent from then on


TAKEN = [
    ({"armed": False}, "disarmed"),
    ({"mode": MANUAL}, "mode changed"),
    ({"mode": HOLD}, "mode changed"),
]


@pytest.mark.parametrize(("change", "says"), TAKEN, ids=str)
def test_who_takes_over_is_left_alone(boat, change, says):
    boat.started()
    for name, value in change.items():
        setattr(boat, name, value)
    count = len(boat.driven)
    boat.run(3.0)
    assert boat.said[-1] == f"Plan: stopped, {says}"
    assert len(boat.driven) == count
    assert boat.modes == []


def test_a_dip_of_the_battery_and_a_moment_of_a_pulse_are_borne(boat):
    boat.started()
    boat.volts, boat.pulses = 11.0, {1: 1950}
    boat.run(0.4)
    boat.volts, boat.pulses = 13.0, {1: 1500}
    boat.run(3.0)
    assert boat.modes == []


def test_a_script_that_was_held_up_stops(boat):
    boat.started()
    boat.step(late_ms=900)
    assert boat.said[-1] == "Plan: stopped, script held up"
    assert neutral(boat)


def test_time_out(plan):
    boat = Autopilot(script_text(plan, replace(SAFETY, time_out_s=20.0), "1"))
    boat.started(25.0)
    assert boat.said[-1] == "Plan: stopped, time is out"
    assert neutral(boat)


def test_an_error_of_the_script_itself_leaves_neutral(boat):
    boat.started()
    boat.volts = "not a number at all"
    boat.step()
    assert "error" in boat.said[-1]
    assert len(boat.said[-1]) <= 50
    assert boat.mode == HOLD
    assert neutral(boat)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"armed": False}, "not armed"),
        ({"mode": MANUAL}, "mode is not Guided"),
        ({"remote": False}, "no remote control"),
        ({"fix": False}, "no position"),
        ({"volts": 11.0}, "battery low"),
        ({"battery_healthy": False}, "no battery voltage"),
    ],
    ids=str,
)
def test_it_does_not_start(text, change, says):
    boat = Autopilot(text, **change).started(2.0)
    assert boat.said[1:] == [f"Plan: will not start, {says}"]  # once
    for name in change:
        setattr(boat, name, getattr(Autopilot(text), name))
    boat.run(2.0)
    assert boat.driven == []  # the switch must go low first
    boat.switch = 0
    boat.run(0.2)
    boat.switch = 2
    assert boat.run(3.0).driven


def test_a_switch_that_is_high_when_the_autopilot_boots_starts_nothing(text):
    boat = Autopilot(text, switch=2).run(5.0)
    assert boat.driven == []
    assert len(boat.said) == 1


def test_without_a_switch_nothing_starts(text):
    assert Autopilot(text, has_switch=False).started().driven == []


def test_it_runs_again_from_where_it_is_then(boat):
    boat.started(70.0)
    boat.switch, boat.mode, boat.north_m, boat.driven = 0, GUIDED, 500.0, []
    boat.started(10.0)
    assert boat.said[-1].startswith("Plan: starts")
    assert len(boat.driven) > 100


def test_no_limit_of_voltage_is_said(text):
    boat = Autopilot(text, params={"BATT_LOW_VOLT": 0}, battery_healthy=False).started(3.0)
    assert "Plan: no limit of battery voltage" in boat.said
    assert boat.driven


def test_a_voltage_of_ones_own_goes_before_the_autopilots(plan):
    boat = Autopilot(script_text(plan, replace(SAFETY, lowest_voltage_v=14.0), "1"), volts=13.5)
    assert "battery low" in boat.started(2.0).said[-1]


@pytest.mark.parametrize("vessel", [WAMV, RUDDER_BOAT], ids=lambda v: v.name)
@pytest.mark.parametrize("manoeuvre", MANOEUVRES, ids=lambda m: m.name)
def test_every_manoeuvre_is_played_to_its_end_in_words_that_fit(vessel, manoeuvre):
    plan = plan_of(manoeuvre, Model.of(vessel), LIMITS, seconds=30.0)
    boat = Autopilot(script_text(plan, safety_for(plan, 200.0, None, None), "1")).started(33.0)
    assert boat.said[-1] == "Plan: done"
    assert max(map(len, boat.said)) <= 50  # of a STATUSTEXT


def test_it_fits_into_the_memory_of_an_autopilot():
    plan = plan_of(MANOEUVRES[0], Model.of(WAMV), LIMITS)
    assert len(script_text(plan, SAFETY, "1")) < 20_000
    assert len(plan.corner_time) < 700


def test_pulses_of_the_plan_lie_within_its_bounds_and_the_servos():
    plan = plan_of(Steps(), Model.of(WAMV), StickLimits())
    bounds = pulse_bounds(plan)
    channels, pulses = WAMV.pulses(plan.commands)
    for k, channel in enumerate(channels):
        low, high = bounds[channel]
        assert 1100 <= low <= pulses[:, k].min()
        assert pulses[:, k].max() <= high <= 1900
