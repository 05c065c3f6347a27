"""Outputs that the vessel has and the firmware does not drive, as real firmware leaves them."""

import pytest

from gateway.hil.outputs import OutputCheck
from gateway.vessel_file import load_vessel

OTTER, STEERED = load_vessel("otter"), load_vessel("steered")
SETTING_UP = (1.9, dict.fromkeys(range(1, 9), 1500.0))
TURNING = [(0.5, {1: 1500.0 + 5.0 * k}) for k in range(40)]


def said(vessel, phases, under_way=False):
    """Phases of so many seconds with pulses, each over those before -> the lines."""
    lines = []
    check = OutputCheck(vessel.actuators, lambda kind, text: lines.append(text))
    check.begin(under_way)
    time, pulses = 0.0, {}
    for seconds, changes in phases:
        pulses = pulses | changes
        for _ in range(round(seconds / 0.1)):
            time += 0.1
            check.look(dict(pulses), time)
    return lines


def test_an_output_without_a_function_that_rests_at_1000_is_said_once():
    """As ArduRover 4.6.3 leaves output 3 with SERVO3_FUNCTION 0."""
    phases = [SETTING_UP, (45.0, {3: 1000.0}), *TURNING, *TURNING]
    (line,) = said(OTTER, phases)
    assert line.startswith("output 3 (right) has held 1000 µs since the firmware started, away")
    assert "set SERVO3_FUNCTION" in line


def test_nothing_is_said_before_others_have_moved():
    assert said(OTTER, [SETTING_UP, (60.0, {3: 1000.0})]) == []
    assert said(OTTER, [SETTING_UP, (45.0, {3: 1000.0}), *TURNING[:10]]) == []


def test_outputs_that_are_off_while_disarmed_hide_nothing():
    off = [SETTING_UP, (18.0, {1: 0.0, 3: 1000.0}), *TURNING, *TURNING]
    assert len(said(OTTER, off)) == 1


STRAIGHT = [(0.5, {1: 1500.0 + 5.0 * k, 3: 1500.0 + 5.0 * k}) for k in range(40)]
RUDDER, MOTOR = (a.servo.channel for a in (STEERED.rudders[0], STEERED.thrusters[0]))
WEAVING = [(1.0, {RUDDER: 1500.0 + k}) for k in range(50)]
RISING = [(0.5, {MOTOR: 1500.0 + 5.0 * k}) for k in range(80)]


@pytest.mark.parametrize(
    ("vessel", "phases"),
    [
        (OTTER, [(40.0, {}), *STRAIGHT, (60.0, {})]),
        (OTTER, [(40.0, {}), (5.0, {3: 1700.0}), *TURNING, *TURNING]),
        (OTTER, [(40.0, {}), *TURNING, *TURNING]),
        (OTTER, [(40.0, {3: 1300.0}), *TURNING[:4], *STRAIGHT, *TURNING]),
        (OTTER, [(60.0, {})]),
        (STEERED, [(40.0, {}), *RISING]),
        (STEERED, [(40.0, {RUDDER: 1560.0}), *RISING]),
        (STEERED, [(20.0, {}), (5.0, {MOTOR: 1700.0}), *WEAVING]),
    ],
    ids=[
        "straight",
        "a motor held",
        "one neutral",
        "unlike trim",
        "holds",
        "rudder still",
        "trimmed",
        "cruise",
    ],
)
def test_a_boat_that_holds_or_goes_straight_is_no_false_alarm(vessel, phases):
    assert said(vessel, [SETTING_UP, *phases]) == []


def test_firmware_that_was_under_way_before_may_hold_what_it_likes():
    phases = [(40.0, {1: 1500.0, 3: 1000.0}), *TURNING, *TURNING]
    assert said(OTTER, phases, under_way=True) == []
    assert len(said(OTTER, phases)) == 1
