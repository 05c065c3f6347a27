"""What is told of recordings and of the vessel file beside every result."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.offline.notices import notices_of, outputs_set_otherwise, outputs_without_actuator
from gateway.offline.trials import outputs_of
from sim.trial import OutputsSet, Trial
from sim.vessel import Servo
from tests.sim.voyages import WAM_V, simulated


def test_outputs_that_move_and_are_not_in_the_file_are_told() -> None:
    """As of another boat's log; not those that only hold a pulse."""
    trial = simulated(WAM_V, 60.0)
    more = np.column_stack([trial.pwm, np.full(len(trial), 1500.0), trial.pwm[:, 0]])
    channels = (*trial.channels, 7, 8)
    other = replace(trial, channels=channels, pwm=more)
    assert outputs_without_actuator([trial], WAM_V) == []
    (told,) = outputs_without_actuator([other], WAM_V)
    assert told.startswith("output 8 moves too, and plain has nothing there")
    assert told in notices_of([other], WAM_V)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"pwm": (1000.0, 1500.0, 2000.0)}, "pulses of 1100 – 1500 – 1900 µs in the vessel file, "
         "but of 1000 – 1500 – 2000 µs in the autopilot's parameters"),
        ({"pwm": (1100.0, 1540.0, 1900.0)}, "what is neutral for one is not for the other"),
        ({"pwm": (1000.0, 1500.0, 1900.0)}, "what is full throttle or full helm for one is not"),
        ({"pwm": (1105.0, 1515.0, 1900.0)}, ""),
        ({"reversed": True}, "reversed in the autopilot's parameters, and not in the vessel file"),
        ({"channel": 9}, ""),  # another output: nothing is said of this one
    ],
)  # fmt: skip
def test_outputs_of_which_the_autopilot_says_something_else_are_told(
    change: dict[str, object], told: str
) -> None:
    motor = WAM_V.thrusters[0]
    own = Servo(motor.servo.channel, (1100.0, 1500.0, 1900.0))
    trial = replace(simulated(WAM_V, 60.0), outputs=(replace(own, **change),))
    notices = outputs_set_otherwise(trial, WAM_V)
    assert len(notices) == bool(told)
    if told:
        assert notices[0].startswith(f"output {motor.servo.channel} ({motor.name}): ")
        assert told in notices[0]
        (line,) = [n for n in notices_of([trial], WAM_V) if notices[0] in n]
        assert line.startswith(f"{trial.name}: ")


def test_each_output_has_a_notice_of_its_own_though_names_differ_by_a_digit() -> None:
    motors = [
        replace(m, name=f"motor_{i}", servo=replace(m.servo, channel=i))
        for i, m in enumerate(WAM_V.thrusters, 1)
    ]
    boat = replace(WAM_V, thrusters=tuple(motors))
    own = tuple(Servo(m.servo.channel, (1000.0, 1500.0, 2000.0)) for m in motors)
    trial = replace(simulated(WAM_V, 60.0), outputs=own)
    told = [n for n in notices_of([trial], boat) if "autopilot's parameters" in n]
    assert [f"motor_{i}" in n for i, n in enumerate(told, 1)] == [True] * len(motors)


def test_of_outputs_whose_parameters_are_not_all_in_the_log_nothing_is_said() -> None:
    known = {"FUNCTION": 73.0, "MIN": 1000.0, "TRIM": 1500.0, "MAX": 2000.0, "REVERSED": 1.0}
    parameters = {f"SERVO1_{name}": value for name, value in known.items()}
    parameters |= {f"SERVO3_{name}": known[name] for name in ("FUNCTION", "MIN", "MAX")}
    assert outputs_of(parameters) == (Servo(1, (1000.0, 1500.0, 2000.0), reversed=True),)


def turned_round(at: float) -> Trial:
    """A voyage of 60 s whose first motor is reversed in the parameters from a time on."""
    own = Servo(WAM_V.thrusters[0].servo.channel, (1100.0, 1500.0, 1900.0))
    later = OutputsSet(at, "SERVO1_REVERSED changes from 0 to 1", (replace(own, reversed=True),))
    return replace(simulated(WAM_V, 60.0), outputs=(own,), outputs_set=(later,))


def test_an_output_set_otherwise_midway_is_told_as_that() -> None:
    """It was "reversed in the autopilot's parameters, and not in the vessel file"."""
    trial = turned_round(30.0)
    told = notices_of([trial], WAM_V)
    assert [n for n in told if "reversed in" in n] == []
    text = "SERVO1_REVERSED changes from 0 to 1 at 30 s: what a pulse does is as before unless"
    (line,) = [n for n in told if text in n]
    assert line.startswith(f"{trial.name}: ")


@pytest.mark.parametrize(("used", "reversed_"), [((0.0, 25.0), False), ((35.0, 60.0), True)])
def test_of_one_side_of_the_change_only_its_own_parameters_count(
    used: tuple[float, float], reversed_: bool
) -> None:
    trial = turned_round(30.0)
    inside = (trial.time >= used[0]) & (trial.time < used[1])
    told = notices_of([replace(trial, usable=trial.usable & inside)], WAM_V)
    assert any("changes from" in n for n in told) is False
    assert any("reversed in the autopilot" in n for n in told) is reversed_


def test_what_a_boat_did_not_do_is_not_tested() -> None:
    turned = simulated(WAM_V, 60.0)
    straight = replace(turned, nu=turned.nu * np.array([1.0, 0.0, 0.0]))
    astray = replace(turned, nu=turned.nu * np.array([0.0, 1.0, 1.0]))
    for trial, told in ((straight, "the boat hardly turned"), (astray, "hardly moved ahead")):
        assert [n for n in notices_of([trial], WAM_V) if told in n]
        assert not [n for n in notices_of([trial, turned], WAM_V) if "hardly" in n]
    pushed = replace(turned, nu=np.tile([0.0, 1.0, 0.0], (len(turned), 1)))  # by a wind
    assert [n for n in notices_of([pushed], WAM_V) if "hardly turned" in n]
    (moored,) = [
        n for n in notices_of([replace(turned, nu=0.0 * turned.nu)], WAM_V) if "hardly" in n
    ]
    assert moored == "the boat hardly moved: these recordings say nothing of the model"
