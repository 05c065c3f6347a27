"""The parameters that such a boat's autopilot would have: enough for `shadow init`."""

from collections.abc import Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.played.telemetry import Message
from sim.vessel import Servo, Thruster, Vessel

THROTTLE, LEFT, RIGHT, STEERING, MOTOR_1 = 70, 73, 74, 26, 33  # SERVOn_FUNCTION
CORNERS = {(1, 1): 0, (-1, -1): 1, (1, -1): 2, (-1, 1): 3}  # ahead?, starboard? -> motor


def parameters(vessel: Vessel, system_id: int, gyro_filter_hz: float) -> dict[str, float]:
    """Name -> value, in the order in which they are listed."""
    values = {
        "SYSID_THISMAV": float(system_id),
        "FRAME_CLASS": 2.0,  # boat
        "FRAME_TYPE": 0.0,
        "ARMING_REQUIRE": 0.0,
        "INS_GYRO_FILTER": gyro_filter_hz,
    }
    functions = _functions(vessel.thrusters) + [STEERING] * len(vessel.rudders)
    for actuator, function in zip(vessel.actuators, functions, strict=True):
        values |= _output(actuator.servo, function)
    return values


def _output(servo: Servo, function: int) -> dict[str, float]:
    low, neutral, high = servo.pwm
    key = f"SERVO{servo.channel}"
    return {
        f"{key}_FUNCTION": float(function),
        f"{key}_MIN": float(low),
        f"{key}_MAX": float(high),
        f"{key}_TRIM": float(neutral),
        f"{key}_REVERSED": float(servo.reversed),
    }


def _functions(thrusters: tuple[Thruster, ...]) -> list[int]:
    """One in the middle, one to each side, a motor in each corner; else motors by number."""
    sides = [_sign(t.position[1]) for t in thrusters]
    if len(set(sides)) == len(sides):
        return [{0: THROTTLE, -1: LEFT, 1: RIGHT}[side] for side in sides]
    places = [
        CORNERS.get((_sign(t.position[0]), side)) for t, side in zip(thrusters, sides, strict=True)
    ]
    if None in places or len(set(places)) < len(places):
        places = list(range(len(thrusters)))
    return [MOTOR_1 + place for place in places if place is not None]


def _sign(x: float) -> int:
    return (x > 0.0) - (x < 0.0)


def parameter_messages(values: Mapping[str, float]) -> list[Message]:
    """The answer to PARAM_REQUEST_LIST."""
    real = mavlink.MAV_PARAM_TYPE_REAL32
    return [
        mavlink.MAVLink_param_value_message(name.encode(), value, real, len(values), i)
        for i, (name, value) in enumerate(values.items())
    ]
