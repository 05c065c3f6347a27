"""What is told of recordings and of the vessel file beside every result."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.offline.notices import notices_of, outputs_set_otherwise, outputs_without_actuator
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
        ({"pwm": (1100.0, 1540.0, 1900.0)}, "but of 1100 – 1540 – 1900 µs"),
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
