"""Messages and parameters of the simulated boat, with the units and fields that ArduPilot fills.

`MESSAGES` is the one table of what it can send on a stream or on request. The parameters are those
that `shadow init` reads.

Faults of sensors, in seconds since the start: without GPS the autopilot's filter reckons on, its
velocity drifts away, and after some seconds it says that it has no position. Without position it
holds its place: velocity zero. A compass that is off turns the heading; the gyro knows nothing of
it. What is frozen is sent on with new time stamps.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.ingest.mapping import Origin, metres_per_degree
from gateway.simulated_boat.hull import GPS_AGE, SensedValues
from sim.plants.waves import GRAVITY
from sim.vessel import Servo, Thruster, Vessel

DRIFT_MPS2, MAX_DRIFT_MPS = 0.04, 1.0  # of the velocity that is reckoned without GPS
RECKONS_S = 10.0  # so long the autopilot's filter trusts that
WELL = (
    mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_VELOCITY_VERT
    | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_POS_VERT_ABS
)  # fmt: skip
HOLDS = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_CONST_POS_MODE
FROZEN = {
    "heading": ("yaw",),
    "turn": ("yaw_rate",),
    "velocity": ("north_mps", "east_mps"),
    "position": ("north", "east"),
}


class Span(NamedTuple):
    """A stretch of time, from one moment to another [s]."""

    from_s: float
    to_s: float

    def has(self, time_s: float) -> bool:
        """Is that moment inside?"""
        return self.from_s <= time_s < self.to_s


class CompassError(NamedTuple):
    """The heading is off by `angle` [rad] for a span."""

    span: Span
    angle: float


class Frozen(NamedTuple):
    """One of `FROZEN` keeps its value for a span."""

    what: str
    span: Span


@dataclass(frozen=True)
class SensorFaults:
    """All faults of one voyage; none by default."""

    gps_lost: tuple[Span, ...] = ()
    ekf_holds: tuple[Span, ...] = ()
    compass: tuple[CompassError, ...] = ()
    frozen: tuple[Frozen, ...] = ()

    def __post_init__(self) -> None:
        for one in self.frozen:
            if one.what not in FROZEN:
                raise BadInput(f"frozen = {one.what!r}: expected one of {', '.join(FROZEN)}")

    def fix(self, time_s: float) -> int:
        """GNSS fix type."""
        lost = any(span.has(time_s) for span in self.gps_lost)
        return int(mavlink.GPS_FIX_TYPE_NO_FIX if lost else mavlink.GPS_FIX_TYPE_3D_FIX)

    def ekf_flags(self, time_s: float) -> int:
        """What the autopilot's filter says that it has."""
        reckoned = (Span(s.from_s + RECKONS_S, s.to_s) for s in self.gps_lost)
        lost = any(span.has(time_s) for span in (*self.ekf_holds, *reckoned))
        return int(HOLDS if lost else WELL)

    def reported(
        self, sensed: SensedValues, held: dict[str, SensedValues], time_s: float
    ) -> tuple[SensedValues, dict[str, SensedValues]]:
        """What is sensed -> what is reported, and what is held of it while it is frozen."""
        for span in self.gps_lost:
            if span.has(time_s):
                seconds = time_s - span.from_s
                drift = min(DRIFT_MPS2 * seconds, MAX_DRIFT_MPS)
                north = sensed.north + 0.5 * drift * seconds
                sensed = sensed._replace(north=north, north_mps=sensed.north_mps + drift)
        if any(span.has(time_s) for span in self.ekf_holds):
            sensed = sensed._replace(north_mps=0.0, east_mps=0.0)
        for error in self.compass:
            if error.span.has(time_s):
                sensed = sensed._replace(yaw=sensed.yaw + error.angle)
        kept = {}
        for one in self.frozen:
            if one.span.has(time_s):
                kept[one.what] = held.get(one.what, sensed)
                names = FROZEN[one.what]
                sensed = sensed._replace(**{n: getattr(kept[one.what], n) for n in names})
        return sensed, kept


Message = Any
MAX_CENTIAMPERES = 32767  # 16 bits with a sign
MANUAL = 0  # custom mode of ArduRover
SENSORS = 0x2C  # gyro, accelerometer, compass, GPS: present, enabled, healthy
FIRMWARE = (4, 6, 0)
BANNER = "ArduRover V4.6.0 (played: no real boat)"
CHANNELS = 32
CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
)


class BoatSnapshot(NamedTuple):
    """Everything that an autopilot can report at one moment."""

    boot_us: int
    unix_us: int
    armed: bool
    sensed: SensedValues
    pulses: tuple[int, ...]  # of channels 1 … 32 [µs], 0 where nothing is connected
    throttle: float  # 0 … 1
    amperes: float
    used_as: float
    remaining: float  # 1 full … 0 empty
    local: tuple[float, float]  # where the local frame starts [m from the origin of the run]
    origin: Origin  # of the run
    fix: int = mavlink.GPS_FIX_TYPE_3D_FIX
    ekf_flags: int = WELL


def heartbeat(m: BoatSnapshot) -> Message:
    mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if m.armed else 0
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SURFACE_BOAT, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mode | armed, MANUAL,
        mavlink.MAV_STATE_ACTIVE if m.armed else mavlink.MAV_STATE_STANDBY, 3,
    )  # fmt: skip


def attitude(m: BoatSnapshot) -> Message:
    s = m.sensed
    yaw = math.remainder(s.yaw, 2.0 * math.pi)
    return mavlink.MAVLink_attitude_message(_boot_ms(m), s.roll, s.pitch, yaw, 0.0, 0.0, s.yaw_rate)


def local_position_ned(m: BoatSnapshot) -> Message:
    s = m.sensed
    return mavlink.MAVLink_local_position_ned_message(
        _boot_ms(m), s.north - m.local[0], s.east - m.local[1], 0.0, s.north_mps, s.east_mps, 0.0
    )


def global_position_int(m: BoatSnapshot) -> Message:
    s = m.sensed
    velocity = (round(s.north_mps * 100.0), round(s.east_mps * 100.0), 0)
    heading = round(math.degrees(s.yaw) * 100.0) % 36000
    return mavlink.MAVLink_global_position_int_message(
        _boot_ms(m), *degrees_e7(m.origin, s.north, s.east), 0, 0, *velocity, heading
    )


def gps_raw_int(m: BoatSnapshot) -> Message:
    s = m.sensed
    speed = math.hypot(s.gps_north_mps, s.gps_east_mps)
    course = round(math.degrees(math.atan2(s.gps_east_mps, s.gps_north_mps)) * 100.0) % 36000
    return mavlink.MAVLink_gps_raw_int_message(
        max(m.boot_us - round(GPS_AGE * 1e6), 0), m.fix,
        *degrees_e7(m.origin, s.gps_north, s.gps_east), 0, 80, 140, round(speed * 100.0), course,
        14, 0, 900, 1500, 120,
    )  # fmt: skip


def servo_output_raw(m: BoatSnapshot) -> Message:
    return _servo(m, 0)


def servo_output_raw_second(m: BoatSnapshot) -> Message:
    return _servo(m, 1)


def raw_imu(m: BoatSnapshot) -> Message:
    s = m.sensed
    milli_g = [round(f / GRAVITY * 1000.0) for f in (s.forward, s.starboard, -GRAVITY)]
    field = [round(400.0 * math.cos(s.yaw)), round(-400.0 * math.sin(s.yaw)), 300]  # mgauss
    return mavlink.MAVLink_raw_imu_message(
        m.boot_us, *milli_g, 0, 0, round(s.yaw_rate * 1000.0), *field
    )


def vfr_hud(m: BoatSnapshot) -> Message:
    s = m.sensed
    speed = math.hypot(s.north_mps, s.east_mps)
    heading = round(math.degrees(s.yaw)) % 360
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, heading, round(100.0 * m.throttle), 0.0, 0.0
    )


def _centiamperes(m: BoatSnapshot) -> int:
    """Current [0.01 A]; of a large boat the most that 16 bits hold."""
    return min(round(m.amperes * 100.0), MAX_CENTIAMPERES)


def sys_status(m: BoatSnapshot) -> Message:
    return mavlink.MAVLink_sys_status_message(
        SENSORS, SENSORS, SENSORS, 180, round(m.sensed.volts * 1000.0), _centiamperes(m),
        round(m.remaining * 100.0), 0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def battery_status(m: BoatSnapshot) -> Message:
    cells = [round(m.sensed.volts * 1000.0)] + [65535] * 9  # ArduPilot: the whole pack as one
    return mavlink.MAVLink_battery_status_message(
        0, 0, 1, 32767, cells, _centiamperes(m), round(m.used_as / 3.6), -1,
        round(m.remaining * 100.0),
    )  # fmt: skip


def ekf_status_report(m: BoatSnapshot) -> Message:
    return mavlink.MAVLink_ekf_status_report_message(m.ekf_flags, 0.1, 0.1, 0.1, 0.05, 0.0)


def system_time(m: BoatSnapshot) -> Message:
    return mavlink.MAVLink_system_time_message(m.unix_us, _boot_ms(m))


def gps_global_origin(m: BoatSnapshot) -> Message:
    lat, lon = degrees_e7(m.origin, *m.local)
    return mavlink.MAVLink_gps_global_origin_message(lat, lon, 0, m.boot_us)


def autopilot_version(m: BoatSnapshot) -> Message:
    major, minor, patch = FIRMWARE
    release = mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL
    version = major << 24 | minor << 16 | patch << 8 | release
    none = [0] * 8
    return mavlink.MAVLink_autopilot_version_message(
        CAPABILITIES, version, 0, 0, 0, none, none, none, 0, 0, 0
    )


def _servo(m: BoatSnapshot, port: int) -> Message:
    outputs = m.pulses[16 * port : 16 * port + 16]
    return mavlink.MAVLink_servo_output_raw_message(m.boot_us & 0xFFFFFFFF, port, *outputs)


def _boot_ms(m: BoatSnapshot) -> int:
    return m.boot_us // 1000 & 0xFFFFFFFF


def degrees_e7(origin: Origin, north: float, east: float) -> tuple[int, int]:
    """Metres from the origin -> latitude, longitude [1e-7 deg]."""
    per_lat, per_lon = metres_per_degree(origin)
    lat, lon = origin.latitude_deg + north / per_lat, origin.longitude_deg + east / per_lon
    return round(lat * 1e7), round(lon * 1e7)


MESSAGES: Mapping[str, tuple[Callable[[BoatSnapshot], Message], ...]] = {
    "HEARTBEAT": (heartbeat,),
    "ATTITUDE": (attitude,),
    "LOCAL_POSITION_NED": (local_position_ned,),
    "SERVO_OUTPUT_RAW": (servo_output_raw, servo_output_raw_second),
    "RAW_IMU": (raw_imu,),
    "GLOBAL_POSITION_INT": (global_position_int,),
    "GPS_RAW_INT": (gps_raw_int,),
    "VFR_HUD": (vfr_hud,),
    "SYS_STATUS": (sys_status,),
    "BATTERY_STATUS": (battery_status,),
    "SYSTEM_TIME": (system_time,),
    "EKF_STATUS_REPORT": (ekf_status_report,),
    "GPS_GLOBAL_ORIGIN": (gps_global_origin,),
    "AUTOPILOT_VERSION": (autopilot_version,),
}
BY_ID: Mapping[int, str] = {
    number: kind.msgname for number, kind in mavlink.mavlink_map.items() if kind.msgname in MESSAGES
}


def messages_named(name: str, m: BoatSnapshot) -> list[Message]:
    """The message of that name; outputs 17 to 32 only where there are any."""
    first, *more = MESSAGES[name]
    return [first(m), *(build(m) for build in more if any(m.pulses[16:]))]


THROTTLE, LEFT, RIGHT, STEERING, MOTOR_1 = 70, 73, 74, 26, 33  # SERVOn_FUNCTION
CORNERS = {(1, 1): 0, (-1, -1): 1, (1, -1): 2, (-1, 1): 3}  # ahead?, starboard? -> motor


def parameters(vessel: Vessel, system_id: int, gyro_filter_hz: float) -> dict[str, float]:
    """Name -> value of all parameters, in the order in which they are listed."""
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
