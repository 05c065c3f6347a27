"""What the autopilot's parameters say of its actuators."""

import struct

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.log import choose_boat
from gateway.ingest.log_events import LogEvent, log_events
from gateway.ingest.mapping import OutputFunction, actuators
from gateway.ingest.parameter_changes import changes_text, outputs_changes, outputs_notice
from gateway.ingest.px4_outputs import named_only, named_outputs
from gateway.ingest.survey import survey
from tests.gateway.ingest.scripted import Script, attitude, heartbeat


def parameter(name: str, value: float) -> object:
    return dialect.MAVLink_param_value_message(name.encode(), value, 9, 1, 0)


def test_the_last_value_of_this_boat_counts() -> None:
    script = Script()
    script.send(0.0, heartbeat())
    script.send(0.1, parameter("SERVO1_FUNCTION", 73))
    script.send(0.2, parameter("SERVO1_FUNCTION", 74))
    script.send(0.3, parameter("SERVO1_FUNCTION", 26), system=255, component=190)
    script.send(0.4, parameter("SIXTEEN_CHARS_OK", 2))  # no NUL ends a name of 16 characters
    log = script.log()
    found = log.parameters(choose_boat(log))
    assert found == {"SERVO1_FUNCTION": 74.0, "SIXTEEN_CHARS_OK": 2.0}


def test_px4_sends_whole_numbers_bit_by_bit() -> None:
    def px4(name: str, value: int) -> object:
        (bits,) = struct.unpack("<f", struct.pack("<i", value))
        return dialect.MAVLink_param_value_message(name.encode(), bits, 6, 1, 0)

    script = Script()
    script.send(0.0, dialect.MAVLink_heartbeat_message(11, 12, 129, 0, 4, 3))
    script.send(0.1, px4("PWM_MAIN_FUNC1", 101))
    script.send(0.2, px4("PWM_MAIN_FUNC4", 102))
    script.send(0.3, px4("SYS_HITL", -1))
    script.send(0.4, parameter("MPC_XY_VEL_MAX", 2.5))
    script.send(0.5, dialect.MAVLink_param_value_message(b"MAV_TYPE", 11.0, 6, 1, 0))
    log = script.log()
    boat = choose_boat(log)
    assert log.parameters(boat) == {
        "PWM_MAIN_FUNC1": 101.0, "PWM_MAIN_FUNC4": 102.0, "SYS_HITL": -1.0,
        "MPC_XY_VEL_MAX": 2.5, "MAV_TYPE": 11.0,
    }  # fmt: skip
    (found,) = survey(log).boats
    assert found.named_outputs == (
        "motor 1 on output 1 of PWM_MAIN", "motor 2 on output 4 of PWM_MAIN",
    )  # fmt: skip


def test_many_outputs_are_not_all_told_in_one_sentence() -> None:
    outputs = named_outputs({f"PWM_AUX_FUNC{k}": 100.0 + k for k in range(1, 13)})
    assert len(outputs) == 12
    assert "motor 4 on output 4 of PWM_AUX and 8 more, but not" in named_only(outputs)
    assert named_only(()) == ""


def test_functions_become_kinds_with_their_limits() -> None:
    found = actuators(
        {
            "SERVO1_FUNCTION": 73.0,
            "SERVO1_MIN": 1000.0,
            "SERVO1_REVERSED": 1.0,
            "SERVO2_FUNCTION": 0.0,
            "SERVO3_FUNCTION": 26.0,
            "SERVO4_FUNCTION": 35.0,
            "SERVO5_FUNCTION": 1.0,
            "SERVO6_FUNCTION": 53.0,
            "SERVO7_FUNCTION": 120.0,
            "SERVO32_FUNCTION": 70.0,
        }
    )
    assert [(a.channel, a.kind) for a in found] == [
        (1, OutputFunction.THROTTLE_LEFT),
        (3, OutputFunction.STEERING),
        (4, OutputFunction.MOTOR),
        (5, OutputFunction.PASSTHROUGH),
        (6, OutputFunction.PASSTHROUGH),
        (32, OutputFunction.THROTTLE),
    ]
    assert found[0].pwm == (1000.0, 1500.0, 1900.0)
    assert found[0].reversed
    assert found[2].motor == 3


def listed_twice(*changes: tuple[str, float]) -> Script:
    """A port motor whose parameters are listed, then at 20 s once more with changes, then again."""
    before = {"SERVO1_FUNCTION": 73.0, "SERVO1_TRIM": 1500.0, "SERVO1_REVERSED": 0.0, "STAT": 1.0}
    script = Script()
    for t in range(40):
        script.send(float(t), heartbeat())
        script.send(float(t), attitude(100.0 + t))
        values = before if t < 20 else before | dict(changes)
        for name, value in values.items() if t % 10 == 0 else ():
            script.send(float(t), parameter(name, value))
    return script


def test_a_parameter_that_is_listed_again_is_no_change() -> None:
    log = listed_twice(("STAT", 2.0), ("SERVO1_TRIM", 1510.0)).log()
    boat = choose_boat(log)
    assert outputs_changes(log, boat) == []
    assert outputs_notice(log, boat) == ()


def test_an_output_that_is_set_otherwise_in_a_log_is_told() -> None:
    """`info` said "reversed" of the whole log, from its last value."""
    log = listed_twice(("SERVO1_REVERSED", 1.0)).log()
    boat = choose_boat(log)
    text = "SERVO1_REVERSED changes from 0 to 1"
    assert LogEvent(20.0, "autopilot", "notice", text) in log_events(log, boat)
    (found,) = survey(log).boats
    (told,) = [n for n in found.notices if text in n]
    assert told.startswith(f"{text} at 20 s: what a pulse does is as before unless motors were")
    assert "then a vessel file holds on one side alone" in told


def test_many_changes_are_one_sentence() -> None:
    assert changes_text([]) == ""
    told = changes_text([(10.0 * k, f"change {k}") for k in range(5)])
    assert told.startswith("change 0 at 0 s, change 1 at 10 s, change 2 at 20 s and 2 more: ")
