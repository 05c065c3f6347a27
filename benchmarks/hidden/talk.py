"""Who says what and when: streams at their rates, greetings, parameters, the ground station."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.outputs import Motor, Output, Rudder
from benchmarks.hidden.sail import PRELUDE, Truth
from benchmarks.hidden.sensors import Sensors
from benchmarks.hidden.telemetry import LATITUDE, LONGITUDE, STREAMS, Clock, Message

BOAT, STATION = 1, 255  # system ids
THROTTLE, STEERING, LEFT, RIGHT = 70, 26, 73, 74  # SERVOn_FUNCTION; throttle left, right
STAGGER = 0.0037  # s between the phases of two streams

Rates = Mapping[str, float]  # Hz; a message that is not there is not sent
RAISED: Rates = {
    "ATTITUDE": 50.0, "LOCAL_POSITION_NED": 25.0, "SERVO_OUTPUT_RAW": 25.0, "RAW_IMU": 25.0,
    "GLOBAL_POSITION_INT": 10.0, "GPS_RAW_INT": 5.0, "VFR_HUD": 5.0, "SYS_STATUS": 2.0,
    "BATTERY_STATUS": 2.0, "SYSTEM_TIME": 2.0, "HEARTBEAT": 1.0,
}  # fmt: skip
MODEST: Rates = {
    "ATTITUDE": 20.0, "LOCAL_POSITION_NED": 12.5, "SERVO_OUTPUT_RAW": 20.0,
    "GLOBAL_POSITION_INT": 4.0, "GPS_RAW_INT": 4.0, "VFR_HUD": 2.0, "SYS_STATUS": 2.0,
    "BATTERY_STATUS": 1.0, "SYSTEM_TIME": 1.0, "HEARTBEAT": 1.0,
}  # fmt: skip
THIN: Rates = {
    "ATTITUDE": 4.0, "LOCAL_POSITION_NED": 3.0, "SERVO_OUTPUT_RAW": 2.0,
    "GLOBAL_POSITION_INT": 2.0, "GPS_RAW_INT": 2.0, "VFR_HUD": 4.0, "SYS_STATUS": 2.0,
    "SYSTEM_TIME": 1.0, "HEARTBEAT": 1.0,
}  # fmt: skip
RATES: Mapping[str, Rates] = {"raised": RAISED, "modest": MODEST, "thin": THIN}


class Said(NamedTuple):
    """A message, who sends it, and when [s after arming]."""

    time: float
    system: int
    message: Message


def conversation(
    boat: Boat, sensors: Sensors, truth: Truth, rates: Rates, clock: Clock
) -> list[Said]:
    """All that boat and ground station say during a voyage, in order of time."""
    said = [*parameters(boat), *events(truth), *station(truth)]
    for i, (name, rate) in enumerate(rates.items()):
        times = np.arange(-PRELUDE + 0.25 + i * STAGGER, truth.time[-1], 1.0 / rate)
        build = STREAMS[name]
        readings = sensors.read(times)
        said += [Said(s.time, BOAT, build(s, clock, boat)) for s in readings]
    return sorted(said, key=lambda s: s.time)


def parameters(boat: Boat) -> Iterator[Said]:
    """The answer to a ground station that asks for all parameters."""
    values = {"SYSID_THISMAV": 1.0, "FRAME_CLASS": 2.0, "FRAME_TYPE": 0.0, "ARMING_REQUIRE": 1.0}
    for output in boat.outputs:
        low, neutral, high = output.pulses
        servo = f"SERVO{output.channel}"
        values |= {
            f"{servo}_FUNCTION": float(_function(boat, output)),
            f"{servo}_MIN": float(low),
            f"{servo}_TRIM": float(neutral),
            f"{servo}_MAX": float(high),
            f"{servo}_REVERSED": float(output.reversed),
        }
    for i, (name, value) in enumerate(values.items()):
        real = mavlink.MAV_PARAM_TYPE_REAL32
        message = mavlink.MAVLink_param_value_message(name.encode(), value, real, len(values), i)
        yield Said(-PRELUDE + 0.5 + 0.01 * i, BOAT, message)


def _function(boat: Boat, output: Output) -> int:
    if isinstance(output, Rudder):
        return STEERING
    if boat.rudders:
        return THROTTLE
    return LEFT if isinstance(output, Motor) and output.y < 0.0 else RIGHT


def events(truth: Truth) -> Iterator[Said]:
    """Texts, and the origin of the local frame."""
    disarmed = float(truth.time[np.flatnonzero(truth.armed)[-1]])
    for time, text in (
        (-PRELUDE + 0.05, "Invented voyage: no real autopilot"),
        (0.01, "Throttle armed"),
        (disarmed, "Throttle disarmed"),
    ):
        yield Said(time, BOAT, mavlink.MAVLink_statustext_message(6, text.encode()))
    for time in (-PRELUDE + 0.1, 0.02):
        origin = (round(LATITUDE * 1e7), round(LONGITUDE * 1e7), 0)
        yield Said(time, BOAT, mavlink.MAVLink_gps_global_origin_message(*origin))


def station(truth: Truth) -> Iterator[Said]:
    """The ground station's heartbeat."""
    for time in np.arange(-PRELUDE, truth.time[-1], 1.0):
        yield Said(float(time), STATION, mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
        ))  # fmt: skip
