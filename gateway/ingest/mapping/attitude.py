"""ATTITUDE, ATTITUDE_QUATERNION: yaw, body yaw rate, roll and pitch [rad, rad/s]."""

from typing import Any

import numpy as np

from gateway.ingest.mapping.rule import Column, Counter, Facts, Rule, only_where
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
