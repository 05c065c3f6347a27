"""What the autopilot says: which message carries which reading, and how often."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from benchmarks.hidden.boats import Boat
from benchmarks.hidden.sensors import GPS_AGE, GRAVITY, Reading

Message = Any
LATITUDE, LONGITUDE = 43.5361, -5.6615  # of the local origin [deg]
EQUATOR, FLATNESS = 6_378_137.0, 6.694_379_990e-3  # WGS 84: radius [m], eccentricity squared
MANUAL = 0  # custom mode


class Clock(NamedTuple):
    """The boat's clock: seconds since boot, and Unix time, at the moment of arming."""

    boot: float
    unix: float

    def boot_us(self, time: float) -> int:
        """Microseconds since boot."""
        return round((self.boot + time) * 1e6)

    def boot_ms(self, time: float) -> int:
        """Milliseconds since boot."""
        return self.boot_us(time) // 1000


def attitude(s: Reading, clock: Clock, boat: Boat) -> Message:
    """Angles and body rates."""
    yaw = math.remainder(s.yaw, 2.0 * math.pi)
    return mavlink.MAVLink_attitude_message(
        clock.boot_ms(s.time), s.roll, s.pitch, yaw, 0.0, 0.0, s.r
    )


def local_position_ned(s: Reading, clock: Clock, boat: Boat) -> Message:
    """Position and velocity of the estimate."""
    return mavlink.MAVLink_local_position_ned_message(
        clock.boot_ms(s.time), s.north, s.east, 0.0, s.v_north, s.v_east, 0.0
    )


def global_position_int(s: Reading, clock: Clock, boat: Boat) -> Message:
    """The same estimate as latitude and longitude; heading."""
    lat, lon = degrees_e7(s.north, s.east)
    v = (round(s.v_north * 100), round(s.v_east * 100), 0)
    heading = round(math.degrees(s.yaw) * 100) % 36000
    return mavlink.MAVLink_global_position_int_message(
        clock.boot_ms(s.time), lat, lon, 0, 0, *v, heading
    )


def gps_raw_int(s: Reading, clock: Clock, boat: Boat) -> Message:
    """What the receiver measured a moment ago."""
    lat, lon = degrees_e7(s.gps_north, s.gps_east)
    speed = math.hypot(s.gps_v_north, s.gps_v_east)
    course = round(math.degrees(math.atan2(s.gps_v_east, s.gps_v_north)) * 100) % 36000
    measured_us = clock.boot_us(s.time - GPS_AGE)
    return mavlink.MAVLink_gps_raw_int_message(
        measured_us, 3, lat, lon, 0, 80, 140, round(speed * 100), course, 14
    )


def servo_output_raw(s: Reading, clock: Clock, boat: Boat) -> Message:
    """The pulses; their clock is 32 bits of microseconds."""
    outputs = [0] * 8
    for output, pulse in zip(boat.outputs, s.pulses, strict=True):
        outputs[output.channel - 1] = pulse
    return mavlink.MAVLink_servo_output_raw_message(clock.boot_us(s.time) & 0xFFFFFFFF, 0, *outputs)


def vfr_hud(s: Reading, clock: Clock, boat: Boat) -> Message:
    """What a pilot reads."""
    speed = math.hypot(s.v_north, s.v_east)
    commands = [m.command(p) for m, p in zip(boat.motors, s.pulses, strict=False)]
    throttle = abs(round(100.0 * sum(commands) / len(commands)))
    heading = round(math.degrees(s.yaw)) % 360
    return mavlink.MAVLink_vfr_hud_message(0.0, speed, heading, throttle, 0.0, 0.0)


def raw_imu(s: Reading, clock: Clock, boat: Boat) -> Message:
    """Accelerations in mG, rates in mrad/s, as ArduPilot sends them."""
    milli_g = [round(f / GRAVITY * 1000.0) for f in (s.forward, s.starboard, -GRAVITY)]
    gyro = (0, 0, round(s.r * 1000.0))
    return mavlink.MAVLink_raw_imu_message(clock.boot_us(s.time), *milli_g, *gyro, 0, 0, 0)


def sys_status(s: Reading, clock: Clock, boat: Boat) -> Message:
    """The battery, in short."""
    present = 0x3F
    return mavlink.MAVLink_sys_status_message(
        present, present, present, 180, round(s.volts * 1000), round(s.amperes * 100), 80,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def battery_status(s: Reading, clock: Clock, boat: Boat) -> Message:
    """The battery: one pack whose cells are not told apart."""
    cells = [round(s.volts * 1000)] + [65535] * 9
    return mavlink.MAVLink_battery_status_message(
        0, 0, 1, 32767, cells, round(s.amperes * 100), round(s.used / 3.6), -1, 80
    )


def system_time(s: Reading, clock: Clock, boat: Boat) -> Message:
    """The boat's clock against Unix time."""
    unix_us = round((clock.unix + s.time) * 1e6)
    return mavlink.MAVLink_system_time_message(unix_us, clock.boot_ms(s.time))


def heartbeat(s: Reading, clock: Clock, boat: Boat) -> Message:
    """A surface boat that says whether it is armed."""
    mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if s.armed else 0
    status = mavlink.MAV_STATE_ACTIVE if s.armed else mavlink.MAV_STATE_STANDBY
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SURFACE_BOAT, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        mode | armed, MANUAL, status, 3,
    )  # fmt: skip


def degrees_e7(north: float, east: float) -> tuple[int, int]:
    """Metres from the local origin -> latitude, longitude [1e-7 deg]."""
    flat = 1.0 - FLATNESS * math.sin(math.radians(LATITUDE)) ** 2
    along_meridian = EQUATOR * (1.0 - FLATNESS) / flat**1.5
    along_parallel = EQUATOR / math.sqrt(flat) * math.cos(math.radians(LATITUDE))
    lat = LATITUDE + math.degrees(north / along_meridian)
    lon = LONGITUDE + math.degrees(east / along_parallel)
    return round(lat * 1e7), round(lon * 1e7)


Builder = Callable[[Reading, Clock, Boat], Message]
STREAMS: Mapping[str, Builder] = {
    "ATTITUDE": attitude,
    "LOCAL_POSITION_NED": local_position_ned,
    "GLOBAL_POSITION_INT": global_position_int,
    "GPS_RAW_INT": gps_raw_int,
    "SERVO_OUTPUT_RAW": servo_output_raw,
    "RAW_IMU": raw_imu,
    "VFR_HUD": vfr_hud,
    "SYS_STATUS": sys_status,
    "BATTERY_STATUS": battery_status,
    "SYSTEM_TIME": system_time,
    "HEARTBEAT": heartbeat,
}
