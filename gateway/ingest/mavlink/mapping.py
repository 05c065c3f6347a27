"""MAVLink messages -> quantities, and the boats that they come from.

Boats are the autopilots among the senders of HEARTBEAT; a ground station or a companion computer is
none. SIM_STATE and SIMSTATE are never read.

RAW_IMU has no unit by definition; ArduPilot sends mG and mrad/s in it, as in SCALED_IMU.
Source: the common and ardupilotmega message definitions.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as definitions

from gateway.ingest.log import Boat, Log, Table
from gateway.ingest.mapping import (
    FIX_2D,
    PX4_CONSTANT,
    PX4_STOPPED_US,
    UNIX_FROM_US,
    Column,
    Counter,
    Facts,
    Rule,
    along,
    as_given,
    estimator_faults,
    euler,
    heading_rate,
    known,
    latitude_longitude,
    only_where,
    quaternion,
    servo_pulses,
)
from gateway.samples import CHANNELS, Quantity

UINT16_UNKNOWN = 65535
MILLI_G = 9.80665e-3  # m/s²
X_ACC, Y_ACC, Z_GYRO = 1 << 0, 1 << 1, 1 << 5  # HIGHRES_IMU.fields_updated
LOCAL_NED, BODY_NED, BODY_FRD = 1, 8, 12  # MAV_FRAME_…
ARMED_BIT = 128  # MAV_MODE_FLAG_SAFETY_ARMED
EKF_GLITCH = 1 << 15  # EKF_STATUS_REPORT
ESTIMATOR_GLITCH = 1 << 10  # ESTIMATOR_STATUS
AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: ground stations, cameras, companions


def attitude(m: Any) -> Facts:
    """ATTITUDE -> yaw, yaw rate, tilt."""
    return (
        (Quantity.YAW, (m.yaw,)),
        (Quantity.YAW_RATE, (heading_rate(m.roll, m.pitch, m.pitchspeed, m.yawspeed),)),
        (Quantity.TILT, (m.roll, m.pitch)),
    )


def attitude_quaternion(m: Any) -> Facts:
    """ATTITUDE_QUATERNION -> yaw, yaw rate, tilt."""
    roll, pitch, yaw = euler(m.q1, m.q2, m.q3, m.q4)
    return (
        (Quantity.YAW, (yaw,)),
        (Quantity.YAW_RATE, (heading_rate(roll, pitch, m.pitchspeed, m.yawspeed),)),
        (Quantity.TILT, (roll, pitch)),
    )


def global_position_int(m: Any) -> Facts:
    """GLOBAL_POSITION_INT -> position, velocity over ground, heading."""
    heading = np.radians(known(m.hdg, UINT16_UNKNOWN) * 1e-2)
    return (
        (Quantity.GLOBAL_POSITION, latitude_longitude(m.lat, m.lon)),
        (Quantity.VELOCITY, (m.vx * 1e-2, m.vy * 1e-2)),
        (Quantity.YAW, (heading,)),
    )


def gps_fix(m: Any) -> Facts:
    """GPS_RAW_INT, GPS2_RAW -> fix."""
    return ((Quantity.FIX, (m.fix_type,)),)


def gps_raw_int(m: Any) -> Facts:
    """GPS_RAW_INT -> position and velocity where there is a fix."""
    fixed = np.asarray(m.fix_type) >= FIX_2D
    lat, lon = latitude_longitude(m.lat, m.lon)
    speed = only_where(fixed, known(m.vel, UINT16_UNKNOWN) * 1e-2)
    course = np.radians(known(m.cog, UINT16_UNKNOWN) * 1e-2)
    return (
        (Quantity.GLOBAL_POSITION, (only_where(fixed, lat), only_where(fixed, lon))),
        (Quantity.VELOCITY, along(speed, course)),
    )


def vfr_hud(m: Any) -> Facts:
    """VFR_HUD -> heading; velocity as if the boat moved ahead without drift (a last resort)."""
    heading = np.asarray(m.heading, dtype=np.float64)
    heading = np.radians(only_where((heading >= 0) & (heading <= 360), heading))
    return ((Quantity.YAW, (heading,)), (Quantity.VELOCITY, along(m.groundspeed, heading)))


def odometry(m: Any) -> Facts:
    """ODOMETRY -> pose where it is relative to north, velocity in the frame that it names."""
    local = np.asarray(m.frame_id) == LOCAL_NED
    child = np.asarray(m.child_frame_id)
    body, world = (child == BODY_FRD) | (child == BODY_NED), child == LOCAL_NED
    roll, pitch, yaw = euler(*quaternion(m.q))
    return (
        (Quantity.POSITION, (only_where(local, m.x), only_where(local, m.y))),
        (Quantity.YAW, (only_where(local, yaw),)),
        (Quantity.TILT, (roll, pitch)),
        (Quantity.YAW_RATE, (heading_rate(roll, pitch, m.pitchspeed, m.yawspeed),)),
        (Quantity.BODY_VELOCITY, (only_where(body, m.vx), only_where(body, m.vy))),
        (Quantity.VELOCITY, (only_where(world, m.vx), only_where(world, m.vy))),
    )


def gps_global_origin(m: Any) -> Facts:
    """GPS_GLOBAL_ORIGIN -> origin of the autopilot's local frame."""
    return ((Quantity.ORIGIN, latitude_longitude(m.latitude, m.longitude)),)


def scaled_imu(m: Any) -> Facts:
    """RAW_IMU, SCALED_IMU* in mG and mrad/s -> yaw rate, specific force."""
    return (
        (Quantity.YAW_RATE, (m.zgyro * 1e-3,)),
        (Quantity.ACCELERATION, (m.xacc * MILLI_G, m.yacc * MILLI_G)),
    )


def highres_imu(m: Any) -> Facts:
    """HIGHRES_IMU -> yaw rate, specific force, as far as the fields were updated."""

    def updated(bit: int, value: Column) -> Column:
        return only_where((np.asarray(m.fields_updated) & bit) != 0, value)

    return (
        (Quantity.YAW_RATE, (updated(Z_GYRO, m.zgyro),)),
        (Quantity.ACCELERATION, (updated(X_ACC, m.xacc), updated(Y_ACC, m.yacc))),
    )


def servo_output_raw(first: int, stopped_us: float = np.nan) -> Callable[[Any], Facts]:
    """SERVO_OUTPUT_RAW of one port -> 16 channels; MAVLink 1 has eight of them."""
    names = [f"servo{i}_raw" for i in range(1, 17)]
    return lambda m: servo_pulses(first, [getattr(m, name, 0) for name in names], stopped_us)


def actuator_output_status(m: Any) -> Facts:
    """ACTUATOR_OUTPUT_STATUS, of PX4 -> channels 1 to 32, where they are pulses at all."""
    outputs = np.asarray(m.actuator, dtype=np.float64)
    return servo_pulses(1, [outputs[..., i] for i in range(CHANNELS)], PX4_STOPPED_US)


def heartbeat(m: Any) -> Facts:
    """HEARTBEAT of an autopilot -> armed or not."""
    armed = (np.asarray(m.base_mode) & ARMED_BIT) != 0
    boat = np.asarray(m.autopilot) != AUTOPILOT_INVALID
    return ((Quantity.ARMED, (only_where(boat, armed),)),)


def system_time(m: Any) -> Facts:
    """SYSTEM_TIME -> Unix time by the boat's clock [s], once that was set."""
    unix = np.asarray(m.time_unix_usec, dtype=np.float64)
    return ((Quantity.UNIX_TIME, (only_where(unix >= UNIX_FROM_US, unix) * 1e-6,)),)


def sys_status(m: Any) -> Facts:
    """SYS_STATUS -> battery voltage [V]."""
    return ((Quantity.VOLTAGE, (volts(m.voltage_battery),)),)


def volts(millivolts: Column) -> Column:
    """mV -> V; 0 and 65535 mean that it is not measured."""
    return known(known(millivolts, UINT16_UNKNOWN), 0) * 1e-3


def battery_status(m: Any) -> Facts:
    """BATTERY_STATUS of the first battery -> the sum of its cells [V]."""
    cells = volts(m.voltages)
    extra = volts(getattr(m, "voltages_ext", 0))  # older definitions lack it
    known_cells = np.isfinite(cells).any(axis=-1)
    total = np.nansum(cells, axis=-1) + np.nansum(np.atleast_1d(extra), axis=-1)
    return ((Quantity.VOLTAGE, (only_where(known_cells, total),)),)


def ekf_status_report(m: Any) -> Facts:
    """EKF_STATUS_REPORT -> what ArduPilot's filter says is wrong with it."""
    ratios = m.velocity_variance, m.pos_horiz_variance, m.compass_variance
    return ((Quantity.ESTIMATOR, (estimator_faults(m.flags, EKF_GLITCH, ratios),)),)


def estimator_status(m: Any) -> Facts:
    """ESTIMATOR_STATUS -> the same of PX4's, whose ratios are roots already, as ArduPilot's are."""
    ratios = m.vel_ratio, m.pos_horiz_ratio, m.mag_ratio
    faults = estimator_faults(m.flags, ESTIMATOR_GLITCH, ratios, PX4_CONSTANT)
    return ((Quantity.ESTIMATOR, (faults,)),)


def wind(m: Any) -> Facts:
    """WIND (direction it comes from, degrees) -> velocity of the air towards north, east."""
    return ((Quantity.WIND, along(m.speed, np.radians(np.asarray(m.direction) + 180.0))),)


LOCAL_POSITION = {Quantity.POSITION: "x y", Quantity.VELOCITY: "vx vy"}
RULES: tuple[Rule, ...] = (
    Rule("ATTITUDE", attitude, Counter.BOOT_MS),
    Rule("ATTITUDE_QUATERNION", attitude_quaternion, Counter.BOOT_MS),
    Rule("LOCAL_POSITION_NED", as_given(LOCAL_POSITION), Counter.BOOT_MS),
    Rule("GLOBAL_POSITION_INT", global_position_int, Counter.BOOT_MS),
    Rule("GPS_RAW_INT", gps_raw_int, Counter.SAMPLE_US),
    # ArduPilot stamps it with the last fix: one that is lost would be the same message again.
    Rule(
        "GPS_RAW_INT", gps_fix, Counter.RECEIPT, source="GPS_RAW_INT fix", equivalent="GPS_RAW_INT"
    ),
    Rule("GPS2_RAW", gps_fix, Counter.RECEIPT, source="GPS2_RAW fix", equivalent="GPS2_RAW"),
    Rule("VFR_HUD", vfr_hud, Counter.RECEIPT),
    Rule("ODOMETRY", odometry, Counter.BOOT_US),
    Rule("GPS_GLOBAL_ORIGIN", gps_global_origin, Counter.RECEIPT),
    Rule("SCALED_IMU", scaled_imu, Counter.BOOT_MS),
    Rule("SCALED_IMU2", scaled_imu, Counter.BOOT_MS),
    Rule("SCALED_IMU3", scaled_imu, Counter.BOOT_MS),
    Rule("RAW_IMU", scaled_imu, Counter.BOOT_US32),
    Rule("HIGHRES_IMU", highres_imu, Counter.BOOT_US, instance=("id",)),
    Rule(
        "SERVO_OUTPUT_RAW",
        servo_output_raw(1),
        Counter.BOOT_US32,
        instance=("port",),
        channels=(1, 16),
    ),
    Rule(
        "SERVO_OUTPUT_RAW",
        servo_output_raw(17),
        Counter.BOOT_US32,
        source="SERVO_OUTPUT_RAW/1",
        instance=("port",),
        number=1,
        equivalent="SERVO_OUTPUT_RAW",
        channels=(17, 32),
    ),
    Rule("ACTUATOR_OUTPUT_STATUS", actuator_output_status, Counter.BOOT_US),
    Rule("HEARTBEAT", heartbeat, Counter.RECEIPT),
    Rule("SYSTEM_TIME", system_time, Counter.BOOT_MS),
    Rule("SYS_STATUS", sys_status, Counter.RECEIPT),
    Rule("BATTERY_STATUS", battery_status, Counter.RECEIPT, instance=("id",)),
    Rule("EKF_STATUS_REPORT", ekf_status_report, Counter.RECEIPT),
    Rule("ESTIMATOR_STATUS", estimator_status, Counter.BOOT_US),
    Rule("WIND", wind, Counter.RECEIPT),
    Rule("WIND_COV", as_given({Quantity.WIND: "wind_x wind_y"}), Counter.RECEIPT),
)
BY_SOURCE = {rule.source: rule for rule in RULES}
PX4_PULSES = {
    "SERVO_OUTPUT_RAW": servo_output_raw(1, PX4_STOPPED_US),
    "SERVO_OUTPUT_RAW/1": servo_output_raw(17, PX4_STOPPED_US),
}
PX4_RULES = tuple(replace(rule, facts=PX4_PULSES.get(rule.source, rule.facts)) for rule in RULES)


def rules_of(boat: Boat) -> tuple[Rule, ...]:
    """The rules for the messages of a boat, in the order of `RULES`."""
    return PX4_RULES if boat.autopilot == AUTOPILOTS[PX4] else RULES


GROUND_STATION = 6  # MAV_TYPE_GCS
AUTOPILOT_COMPONENT = 1
SENT_BY_BOATS = ("ATTITUDE", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW")
VTOLS, VTOL = {*range(19, 26), 47}, "VTOL aircraft"  # definitions call some of them "reserved"
ARDUPILOT, PX4 = 3, 12  # MAV_AUTOPILOT_…
AUTOPILOTS = {ARDUPILOT: "ArduPilot", PX4: "PX4", 0: "generic autopilot"}


def from_heartbeats(table: Table) -> tuple[Boat, ...]:
    """The autopilots among those that send HEARTBEAT, ordered by their address."""
    if not len(table):
        return ()
    autopilot = np.asarray(table.columns["autopilot"], np.int64)
    type_ = np.asarray(table.columns["type"], np.int64)
    boat = (autopilot != AUTOPILOT_INVALID) & (type_ != GROUND_STATION)
    rows = np.stack([table.system, table.component, autopilot, type_], axis=1)[boat]
    named = {(int(s), int(c)): (int(a), int(t)) for s, c, a, t in rows}
    return tuple(_boat(*address, *kind) for address, kind in sorted(named.items()))


def from_heartbeat(message: Any) -> Boat | None:
    """A HEARTBEAT of a live link -> the boat that sent it; None from anything else."""
    if message.autopilot == AUTOPILOT_INVALID or message.type == GROUND_STATION:
        return None
    address = message.get_srcSystem(), message.get_srcComponent()
    return _boat(*address, message.autopilot, message.type)


def from_motion(log: Log) -> tuple[Boat, ...]:
    """Without any HEARTBEAT: the systems whose component 1 reports motion."""
    tables = [log.table(name) for name in SENT_BY_BOATS]
    systems = {
        int(s) for t in tables for s in np.unique(t.system[t.component == AUTOPILOT_COMPONENT])
    }
    return tuple(Boat(system, AUTOPILOT_COMPONENT) for system in sorted(systems))


def vehicle_type(number: int) -> str:
    """MAV_TYPE: 11 -> "surface boat"."""
    return VTOL if number in VTOLS else _enum("MAV_TYPE", number)


def _boat(system: int, component: int, autopilot: int, type_: int) -> Boat:
    name = AUTOPILOTS.get(autopilot) or _enum("MAV_AUTOPILOT", autopilot)
    return Boat(system, component, name, vehicle_type(type_))


def _enum(name: str, value: int) -> str:
    """MAV_TYPE, 11 -> "surface boat"."""
    entry = definitions.enums[name].get(value)
    return str(entry.name).removeprefix(name + "_").lower().replace("_", " ") if entry else "?"
