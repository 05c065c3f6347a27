"""DataFlash messages -> quantities: what an ArduPilot autopilot wrote on board.

Columns are in the unit of the log's own definition after its multiplier: degrees, m, m/s, rad/s.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gateway.ingest.mapping import (
    FIX_2D,
    Counter,
    Facts,
    Rule,
    along,
    as_given,
    estimator_faults,
    known,
    only_where,
    servo_pulses,
)
from gateway.samples import Quantity

EVENT_ARMED, EVENT_DISARMED = 10, 11
MAX_STATUS = 1 << 32  # more bits than SS has, as a damaged definition may hold
KALMAN_GLITCH = 1 << 14  # SS of XKF4: nav_filter_status of ArduPilot


def kalman(m: Any) -> Facts:
    """XKF1, NKF1 of one lane, EKF1 -> position from the origin, velocity, yaw."""
    return (
        (Quantity.POSITION, (m.PN, m.PE)),
        (Quantity.VELOCITY, (m.VN, m.VE)),
        (Quantity.YAW, (np.radians(m.Yaw),)),
    )


def kalman_status(m: Any) -> Facts:
    """XKF4, NKF4 of one lane -> what it says is wrong with it.

    SS is its solution status, SV, SP and SM the square roots of its test ratios.
    """
    status = np.clip(np.nan_to_num(np.asarray(m.SS, np.float64)), 0, MAX_STATUS)
    faults = estimator_faults(status, KALMAN_GLITCH, (m.SV, m.SP, m.SM))
    return ((Quantity.ESTIMATOR, (faults,)),)


def att(m: Any) -> Facts:
    """ATT -> yaw, tilt of the lane in use."""
    return (
        (Quantity.YAW, (np.radians(m.Yaw),)),
        (Quantity.TILT, (np.radians(m.Roll), np.radians(m.Pitch))),
    )


def gps(m: Any) -> Facts:
    """GPS -> fix, and position and velocity where there is a fix."""
    fixed = np.asarray(m.Status) >= FIX_2D
    north, east = along(only_where(fixed, m.Spd), np.radians(m.GCrs))
    return (
        (Quantity.FIX, (m.Status,)),
        (Quantity.GLOBAL_POSITION, (only_where(fixed, m.Lat), only_where(fixed, m.Lng))),
        (Quantity.VELOCITY, (north, east)),
    )


def gps_fix(m: Any) -> Facts:
    """GPS, GPS2 of the second receiver -> fix."""
    return ((Quantity.FIX, (m.Status,)),)


def bat(m: Any) -> Facts:
    """BAT, CURR -> battery voltage; until 2016 a whole number of centivolts."""
    unit = 0.01 if np.asarray(m.Volt).dtype.kind in "iu" else 1.0
    return ((Quantity.VOLTAGE, (known(m.Volt, 0.0) * unit,)),)


def arm(m: Any) -> Facts:
    """ARM -> armed or not, at each change."""
    return ((Quantity.ARMED, (np.asarray(m.ArmState) != 0,)),)


def event(m: Any) -> Facts:
    """EV -> armed or not, where the event is about that."""
    about_arming = (np.asarray(m.Id) == EVENT_ARMED) | (np.asarray(m.Id) == EVENT_DISARMED)
    return ((Quantity.ARMED, (only_where(about_arming, np.asarray(m.Id) == EVENT_ARMED),)),)


def wind_vane(m: Any) -> Facts:
    """WIND (true direction it comes from, degrees) -> velocity of the air towards north, east."""
    return ((Quantity.WIND, along(m.SpdTru, np.radians(np.asarray(m.DrTru) + 180.0))),)


def outputs(first: int, last: int) -> Callable[[Any], Facts]:
    """RCOU, RCO2, RCO3 -> pulses of their channels: C1, or Ch1 until 2015, which has fewer."""

    def pulses(m: Any) -> Facts:
        letters = "C" if hasattr(m, f"C{first}") else "Ch"
        none = np.zeros_like(getattr(m, f"{letters}{first}"))
        numbers = range(first, last + 1)
        return servo_pulses(first, [getattr(m, f"{letters}{i}", none) for i in numbers])

    return pulses


def _rule(message: str, facts: Callable[[Any], Facts], *instance: str, **more: Any) -> Rule:
    # the clock of the log itself: logs of 2014 count milliseconds (TimeMS), their GPS has no clock
    return Rule(message, facts, Counter.BOOT_US, instance=instance, field="time_us", **more)


IMU = {Quantity.YAW_RATE: "GyrZ", Quantity.ACCELERATION: "AccX AccY"}  # bias of the gyro included
LANE = "C"  # column that numbers the lane of the autopilot's filter
RULES: tuple[Rule, ...] = (
    _rule("XKF1", kalman, LANE),
    _rule("NKF1", kalman, LANE),
    _rule("EKF1", kalman, equivalent="NKF1"),  # until 2016
    _rule("XKF4", kalman_status, LANE),
    _rule("NKF4", kalman_status, LANE),
    _rule("ATT", att),
    _rule("IMU", as_given(IMU), "I"),
    _rule("GPS", gps, "I"),
    _rule("GPS", gps_fix, "I", number=1, source="GPS/1", equivalent="GPS2_RAW"),
    _rule("GPS2", gps_fix, equivalent="GPS2_RAW"),  # until 2020
    _rule("BAT", bat, "Inst", "Instance", "I"),
    _rule("CURR", bat, "Inst", "Instance", "I"),
    _rule("ARM", arm, on_change=True),
    _rule("EV", event, on_change=True),
    _rule("ORGN", as_given({Quantity.ORIGIN: "Lat Lng"}), "Type"),
    _rule("WIND", wind_vane),
    _rule("RCOU", outputs(1, 14), channels=(1, 14)),
    _rule("RCO2", outputs(15, 18), channels=(15, 18), equivalent="RCOU"),
    _rule("RCO3", outputs(19, 32), channels=(19, 32), equivalent="RCOU"),
)
