"""RAW_IMU, SCALED_IMU*, HIGHRES_IMU: body yaw rate [rad/s] and specific force [m/s²].

RAW_IMU has no unit by definition; ArduPilot sends mG and mrad/s in it, as in SCALED_IMU.
"""

from typing import Any

import numpy as np

from gateway.ingest.mapping.rule import Column, Counter, Facts, Rule, only_where
from gateway.samples import Quantity

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
