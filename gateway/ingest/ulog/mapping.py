"""uORB topics of PX4 -> quantities: those that PX4 itself sends as MAVLink messages.

`equivalent` names that message: its errors and its rank among the sources hold for the topic too.
PX4's world is NED and its body FRD, as here. Topics and fields changed over its versions; both the
newer and the older names are read. Source: PX4-Autopilot, msg/*.msg and src/modules/mavlink/streams
(v1.9 to v1.16).

Where the log holds no pulses, the commands of motors and servos (−1 … 1, NaN: stopped) stand for
them: 1100 … 1900 µs, motors 1 … 12 on channels 1 … 12, servos 1 … 8 on channels 13 … 20. Which
instances are read, `instances.py` says.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gateway.ingest.mapping import (
    FIX_2D,
    PX4_CONSTANT,
    PX4_STOPPED_US,
    STATUS_ATTITUDE,
    STATUS_POSITION,
    STATUS_VELOCITY,
    UNIX_FROM_US,
    Column,
    Counter,
    EstimatorFault,
    Facts,
    Rule,
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
from gateway.ingest.mavlink.mapping import ESTIMATOR_GLITCH
from gateway.samples import Quantity
from sim.state import Floats, Ints

ARMED = 2  # vehicle_status.arming_state in all versions
NEUTRAL_US, FULL_US = 1500.0, 400.0  # of a motor or servo at a command of 0; from there to ±1
INSTANCE = "multi_id"  # column that numbers the instance of a topic
OUTPUTS = "actuator_outputs"
COMMANDS = ("actuator_motors", "actuator_servos")  # of the allocation, whatever drives them
ESTIMATORS = ("estimator_status", "estimator_status_flags")  # one instance for each EKF that runs
PORTS, PORT = 2, 16  # instances of outputs that have channels, and how many each has
# heading, horizontal position met a numerical error; horizontal velocity did until v1.14 at bits
# that say since v1.15 that the vertical accelerometer is bad, which it is in a sea
FAULTY = 0b11_0000_0000_1111
REJECTED = 0b100_0011  # horizontal velocity, position, yaw


def attitude(m: Any) -> Facts:
    """vehicle_attitude -> yaw, tilt; yaw rate where it is still in it (before v1.10)."""
    roll, pitch, yaw = euler(*quaternion(m.q))
    facts: Facts = ((Quantity.YAW, (yaw,)), (Quantity.TILT, (roll, pitch)))
    if not hasattr(m, "yawspeed"):
        return facts
    turn = heading_rate(roll, pitch, getattr(m, "pitchspeed", 0.0), m.yawspeed)
    return (*facts, (Quantity.YAW_RATE, (turn,)))


def angular_velocity(m: Any) -> Facts:
    """vehicle_angular_velocity -> yaw rate, without the gyro's bias."""
    return ((Quantity.YAW_RATE, (m.xyz[..., 2],)),)


def acceleration(m: Any) -> Facts:
    """vehicle_acceleration -> specific force."""
    return ((Quantity.ACCELERATION, (m.xyz[..., 0], m.xyz[..., 1])),)


def sensor_combined(m: Any) -> Facts:
    """sensor_combined -> yaw rate with the gyro's bias still in it, specific force."""
    force = m.accelerometer_m_s2
    return (
        (Quantity.YAW_RATE, (m.gyro_rad[..., 2],)),
        (Quantity.ACCELERATION, (force[..., 0], force[..., 1])),
    )


def local_position(m: Any) -> Facts:
    """vehicle_local_position -> position from the filter's origin, velocity over ground."""
    placed, moving = np.asarray(m.xy_valid) != 0, np.asarray(m.v_xy_valid) != 0
    return (
        (Quantity.POSITION, (only_where(placed, m.x), only_where(placed, m.y))),
        (Quantity.VELOCITY, (only_where(moving, m.vx), only_where(moving, m.vy))),
    )


def local_heading(m: Any) -> Facts:
    """vehicle_local_position -> heading (until v1.10 called yaw)."""
    return ((Quantity.YAW, (_either(m, "heading", "yaw"),)),)


def local_origin(m: Any) -> Facts:
    """vehicle_local_position -> origin of the filter's local frame, once it is known."""
    placed = np.asarray(m.xy_global) != 0
    return ((Quantity.ORIGIN, (only_where(placed, m.ref_lat), only_where(placed, m.ref_lon))),)


def global_position(m: Any) -> Facts:
    """vehicle_global_position -> position; velocity over ground too before v1.13."""
    valid = np.asarray(getattr(m, "lat_lon_valid", 1)) != 0
    place = only_where(valid, m.lat), only_where(valid, m.lon)
    facts: Facts = ((Quantity.GLOBAL_POSITION, place),)
    return (*facts, (Quantity.VELOCITY, (m.vel_n, m.vel_e))) if hasattr(m, "vel_n") else facts


def gps(m: Any) -> Facts:
    """vehicle_gps_position, sensor_gps -> fix, Unix time; with a fix, position and velocity."""
    fixed = np.asarray(m.fix_type) >= FIX_2D
    moving = fixed & (np.asarray(m.vel_ned_valid) != 0)
    lat, lon = (
        (m.latitude_deg, m.longitude_deg)
        if hasattr(m, "latitude_deg")  # since v1.14
        else latitude_longitude(m.lat, m.lon)
    )
    unix = np.asarray(m.time_utc_usec, dtype=np.float64)
    return (
        (Quantity.FIX, (m.fix_type,)),
        (Quantity.GLOBAL_POSITION, (only_where(fixed, lat), only_where(fixed, lon))),
        (Quantity.VELOCITY, (only_where(moving, m.vel_n_m_s), only_where(moving, m.vel_e_m_s))),
        (Quantity.UNIX_TIME, (only_where(unix >= UNIX_FROM_US, unix) * 1e-6,)),
    )


def outputs(first: int) -> Callable[[Any], Facts]:
    """One instance of actuator_outputs, of pulses -> 16 channels."""

    def facts(m: Any) -> Facts:
        pulses = [m.output[..., i] for i in range(16)]
        return _where_any(servo_pulses(first, pulses, PX4_STOPPED_US))

    return facts


def controls(first: int, count: int) -> Callable[[Any], Facts]:
    """actuator_motors, actuator_servos (−1 … 1) -> pulses of `count` channels."""

    def facts(m: Any) -> Facts:
        pulses = NEUTRAL_US + FULL_US * np.asarray(m.control, np.float64)
        return _where_any(servo_pulses(first, [pulses[..., i] for i in range(count)]))

    return facts


def _where_any(facts: Facts) -> Facts:
    """Pulses, or nothing where there never is one: another topic may hold them."""
    ((_, channels),) = facts
    return facts if np.isfinite(np.stack(channels)).any() else ()


def status(m: Any) -> Facts:
    """vehicle_status -> armed or not."""
    return ((Quantity.ARMED, (np.asarray(m.arming_state) == ARMED,)),)


def battery(m: Any) -> Facts:
    """battery_status -> battery voltage [V]; 0 where it is not measured."""
    return ((Quantity.VOLTAGE, (known(_either(m, "voltage_v", "voltage_filtered_v"), 0.0),)),)


def estimator_status(m: Any) -> Facts:
    """estimator_status -> what PX4's filter says is wrong with it.

    Its test ratios are of innovations to their limits already, and not squared. The one of the
    heading was called mag_test_ratio before v1.16.
    """
    heading = m.hdg_test_ratio if hasattr(m, "hdg_test_ratio") else m.mag_test_ratio
    ratios = (m.vel_test_ratio, m.pos_test_ratio, heading)
    well = STATUS_ATTITUDE | STATUS_VELOCITY | STATUS_POSITION  # where nothing tells otherwise
    flags = _bits(getattr(m, "solution_status_flags", np.full(np.shape(heading), well)))
    told = estimator_faults(flags, ESTIMATOR_GLITCH, ratios, PX4_CONSTANT)
    rejected = _bits(getattr(m, "innovation_check_flags", 0)) & REJECTED
    wrong = ((_bits(getattr(m, "filter_fault_flags", 0)) & FAULTY) | rejected) != 0
    return ((Quantity.ESTIMATOR, (_with_rejects(told, wrong),)),)


def estimator_flags(m: Any) -> Facts:
    """estimator_status_flags -> the same as far as it tells: what is rejected, what went wrong."""
    told = [_bits(getattr(m, name)) for name in ("reject_hor_vel", "reject_hor_pos", "reject_yaw")]
    until_v1_14 = ("fs_bad_vel_n", "fs_bad_vel_e", "fs_bad_pos_n", "fs_bad_pos_e")
    told += [_bits(getattr(m, name)) for name in ("fs_bad_hdg", *until_v1_14) if hasattr(m, name)]
    flags = np.stack(told).any(axis=0)
    none = (_bits(m.cs_tilt_align) == 0) | (_bits(m.cs_yaw_align) == 0)
    faults = none * float(EstimatorFault.ATTITUDE)
    return ((Quantity.ESTIMATOR, (_with_rejects(faults, flags),)),)


def _bits(flags: Column) -> Ints:
    return np.asarray(np.nan_to_num(np.asarray(flags, np.float64)), np.int64)


def _with_rejects(faults: Column, wrong: Column) -> Floats:
    bits = np.asarray(faults, np.int64) | np.where(wrong, int(EstimatorFault.REJECTS), 0)
    return np.asarray(bits, np.float64)


def _either(m: Any, newer: str, older: str) -> Column:
    return getattr(m, newer if hasattr(m, newer) else older)


def _rule(
    topic: str, facts: Callable[[Any], Facts], equivalent: str = "", part: str = "", **more: Any
) -> Rule:
    return Rule(
        topic,
        facts,
        Counter.BOOT_US,
        source=topic + part,
        instance=(INSTANCE,),
        field="timestamp",
        equivalent=equivalent,
        **more,
    )


def output_rule(instance: int, port: int) -> Rule:
    """One instance of actuator_outputs as the channels of a port, 0 or 1."""
    first = 1 + PORT * port
    return _rule(
        OUTPUTS,
        outputs(first),
        "SERVO_OUTPUT_RAW",
        f"/{instance}" if instance else "",
        number=instance,
        channels=(first, first + PORT - 1),
    )


WIND = {Quantity.WIND: "windspeed_north windspeed_east"}  # velocity of the air
RULES: tuple[Rule, ...] = (
    _rule("vehicle_attitude", attitude, "ATTITUDE"),
    _rule("vehicle_angular_velocity", angular_velocity, "ATTITUDE"),
    _rule("vehicle_local_position", local_position, "LOCAL_POSITION_NED"),
    _rule("vehicle_local_position", local_heading, "GLOBAL_POSITION_INT", "/heading"),
    _rule("vehicle_local_position", local_origin, "GPS_GLOBAL_ORIGIN", "/origin"),
    _rule("vehicle_global_position", global_position, "GLOBAL_POSITION_INT"),
    _rule("vehicle_gps_position", gps, "GPS_RAW_INT"),
    _rule("sensor_gps", gps, "GPS"),
    _rule("sensor_combined", sensor_combined, "HIGHRES_IMU"),
    _rule("vehicle_acceleration", acceleration),
    output_rule(0, 0),
    _rule("actuator_motors", controls(1, 12), "ACTUATOR_OUTPUT_STATUS", channels=(1, 12)),
    _rule("actuator_servos", controls(13, 8), "ACTUATOR_OUTPUT_STATUS", channels=(13, 20)),
    _rule("estimator_status", estimator_status, "ESTIMATOR_STATUS"),
    _rule("estimator_status_flags", estimator_flags, "ESTIMATOR_STATUS"),
    _rule("vehicle_status", status, "HEARTBEAT"),
    _rule("battery_status", battery, "BATTERY_STATUS"),
    _rule("wind", as_given(WIND), "WIND_COV"),
    _rule("wind_estimate", as_given(WIND), "WIND_COV"),
)
