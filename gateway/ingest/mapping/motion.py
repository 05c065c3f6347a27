"""ATTITUDE, ATTITUDE_QUATERNION: yaw, body yaw rate, roll and pitch [rad, rad/s].

RAW_IMU, SCALED_IMU*, HIGHRES_IMU: body yaw rate [rad/s] and specific force [m/s²].

RAW_IMU has no unit by definition; ArduPilot sends mG and mrad/s in it, as in SCALED_IMU.

LOCAL_POSITION_NED, GLOBAL_POSITION_INT, GPS_RAW_INT, VFR_HUD, ODOMETRY, GPS_GLOBAL_ORIGIN.
"""

from typing import Any

import numpy as np

from gateway.ingest.mapping.rule import Column, Counter, Facts, Rule, known, only_where
from gateway.samples import Quantity


def attitude(m: Any) -> Facts:
    """ATTITUDE -> yaw, yaw rate, tilt."""
    return (
        (Quantity.YAW, (m.yaw,)),
        (Quantity.YAW_RATE, (m.yawspeed,)),
        (Quantity.TILT, (m.roll, m.pitch)),
    )


def euler(w: Column, x: Column, y: Column, z: Column) -> tuple[Column, Column, Column]:
    """Quaternion body -> NED -> roll, pitch, yaw [rad]; NaN where it has no length."""
    w, x, y, z = (np.asarray(part, dtype=np.float64) for part in (w, x, y, z))
    length = w * w + x * x + y * y + z * z
    valid = length > 0.5
    length = only_where(valid, length)
    roll = np.arctan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
    pitch = np.arcsin(np.clip(2 * (w * y - z * x) / length, -1.0, 1.0))
    yaw = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
    return only_where(valid, roll), pitch, only_where(valid, yaw)


def attitude_quaternion(m: Any) -> Facts:
    """ATTITUDE_QUATERNION -> yaw, yaw rate, tilt."""
    roll, pitch, yaw = euler(m.q1, m.q2, m.q3, m.q4)
    return (
        (Quantity.YAW, (yaw,)),
        (Quantity.YAW_RATE, (m.yawspeed,)),
        (Quantity.TILT, (roll, pitch)),
    )


ATTITUDE_RULES = (
    Rule("ATTITUDE", attitude, Counter.BOOT_MS),
    Rule("ATTITUDE_QUATERNION", attitude_quaternion, Counter.BOOT_MS),
)


MILLI_G = 9.80665e-3  # m/s²
X_ACC, Y_ACC, Z_GYRO = 1 << 0, 1 << 1, 1 << 5  # HIGHRES_IMU.fields_updated


def scaled_imu(m: Any) -> Facts:
    """mG and mrad/s -> yaw rate, specific force."""
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


INERTIAL_RULES = (
    Rule("SCALED_IMU", scaled_imu, Counter.BOOT_MS),
    Rule("SCALED_IMU2", scaled_imu, Counter.BOOT_MS),
    Rule("SCALED_IMU3", scaled_imu, Counter.BOOT_MS),
    Rule("RAW_IMU", scaled_imu, Counter.BOOT_US32),
    Rule("HIGHRES_IMU", highres_imu, Counter.BOOT_US, instance=("id",)),
)


UINT16_UNKNOWN = 65535
LOCAL_NED, BODY_NED, BODY_FRD = 1, 8, 12  # MAV_FRAME_…
FIX_2D = 2


def latitude_longitude(lat_e7: Column, lon_e7: Column) -> tuple[Column, Column]:
    """Degrees × 1e7 -> degrees; 0, 0 is what an autopilot says that does not know."""
    lat, lon = np.asarray(lat_e7) * 1e-7, np.asarray(lon_e7) * 1e-7
    given = (lat != 0.0) | (lon != 0.0)
    return only_where(given, lat), only_where(given, lon)


def along(speed: Column, course: Column) -> tuple[Column, Column]:
    """Speed [m/s] towards a course [rad from north] -> north, east [m/s]."""
    return speed * np.cos(course), speed * np.sin(course)


def local_position_ned(m: Any) -> Facts:
    """LOCAL_POSITION_NED -> position from the autopilot's origin, velocity over ground."""
    return ((Quantity.POSITION, (m.x, m.y)), (Quantity.VELOCITY, (m.vx, m.vy)))


def global_position_int(m: Any) -> Facts:
    """GLOBAL_POSITION_INT -> position, velocity over ground, heading."""
    heading = np.radians(known(m.hdg, UINT16_UNKNOWN) * 1e-2)
    return (
        (Quantity.GLOBAL_POSITION, latitude_longitude(m.lat, m.lon)),
        (Quantity.VELOCITY, (m.vx * 1e-2, m.vy * 1e-2)),
        (Quantity.YAW, (heading,)),
    )


def gps_raw_int(m: Any) -> Facts:
    """GPS_RAW_INT -> fix, and position and velocity where there is a fix."""
    fixed = np.asarray(m.fix_type) >= FIX_2D
    lat, lon = latitude_longitude(m.lat, m.lon)
    speed = only_where(fixed, known(m.vel, UINT16_UNKNOWN) * 1e-2)
    course = np.radians(known(m.cog, UINT16_UNKNOWN) * 1e-2)
    return (
        (Quantity.FIX, (m.fix_type,)),
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
        (Quantity.YAW_RATE, (m.yawspeed,)),
        (Quantity.BODY_VELOCITY, (only_where(body, m.vx), only_where(body, m.vy))),
        (Quantity.VELOCITY, (only_where(world, m.vx), only_where(world, m.vy))),
    )


def quaternion(q: Column) -> tuple[Column, ...]:
    """A list of four numbers or a (K, 4) column -> its four components."""
    parts = np.asarray(q, dtype=np.float64)
    return tuple(parts[..., i] for i in range(4))


def gps_global_origin(m: Any) -> Facts:
    """GPS_GLOBAL_ORIGIN -> where the autopilot's local frame starts."""
    return ((Quantity.ORIGIN, latitude_longitude(m.latitude, m.longitude)),)


MOTION_RULES = (
    Rule("LOCAL_POSITION_NED", local_position_ned, Counter.BOOT_MS),
    Rule("GLOBAL_POSITION_INT", global_position_int, Counter.BOOT_MS),
    Rule("GPS_RAW_INT", gps_raw_int, Counter.SAMPLE_US),
    Rule("VFR_HUD", vfr_hud, Counter.RECEIPT),
    Rule("ODOMETRY", odometry, Counter.BOOT_US),
    Rule("GPS_GLOBAL_ORIGIN", gps_global_origin, Counter.RECEIPT),
)
