"""What the autopilot's parameters say of its actuators."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.log import choose_boat
from gateway.ingest.mapping import OutputFunction, actuators
from tests.gateway.ingest.scripted import Script, heartbeat


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
