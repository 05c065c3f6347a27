"""LOCAL_POSITION_NED, GLOBAL_POSITION_INT, GPS_RAW_INT, VFR_HUD, ODOMETRY, GPS_GLOBAL_ORIGIN."""

from typing import Any

import numpy as np

from gateway.ingest.mapping.attitude import euler
from gateway.ingest.mapping.rule import Column, Counter, Facts, Rule, known, only_where
from gateway.samples import Quantity

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
