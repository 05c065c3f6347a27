"""HEARTBEAT, SYSTEM_TIME, SYS_STATUS, BATTERY_STATUS, WIND, WIND_COV: the boat's condition."""

from typing import Any

import numpy as np

from gateway.ingest.mapping.motion import along
from gateway.ingest.mapping.rule import Column, Counter, Facts, Rule, known, only_where, optional
from gateway.samples import Quantity

ARMED_BIT = 128  # MAV_MODE_FLAG_SAFETY_ARMED
AUTOPILOT_INVALID = 8  # MAV_AUTOPILOT_INVALID: ground stations, cameras, companions
UNIX_FROM_US = 1_000_000_000_000_000  # a Unix time below this (2001) was never set
UINT16_UNKNOWN = 65535


def heartbeat(m: Any) -> Facts:
    """HEARTBEAT of an autopilot -> armed or not."""
    armed = (np.asarray(m.base_mode) & ARMED_BIT) != 0
    boat = np.asarray(m.autopilot) != AUTOPILOT_INVALID
    return ((Quantity.ARMED, (only_where(boat, armed),)),)


def system_time(m: Any) -> Facts:
    """SYSTEM_TIME -> the boat's idea of Unix time [s]."""
    unix = np.asarray(m.time_unix_usec, dtype=np.float64)
    return ((Quantity.UNIX_TIME, (only_where(unix >= UNIX_FROM_US, unix) * 1e-6,)),)


def sys_status(m: Any) -> Facts:
    """SYS_STATUS -> battery voltage [V]."""
    return ((Quantity.VOLTAGE, (volts(m.voltage_battery),)),)


def volts(millivolts: Column) -> Column:
    """mV -> V; 0 and 65535 mean that nobody measures."""
    return known(known(millivolts, UINT16_UNKNOWN), 0) * 1e-3


def battery_status(m: Any) -> Facts:
    """BATTERY_STATUS of the first battery -> the sum of its cells [V]."""
    cells = volts(m.voltages)
    extra = volts(optional(m, "voltages_ext", 0))
    known_cells = np.isfinite(cells).any(axis=-1)
    total = np.nansum(cells, axis=-1) + np.nansum(np.atleast_1d(extra), axis=-1)
    return ((Quantity.VOLTAGE, (only_where(known_cells, total),)),)


def wind(m: Any) -> Facts:
    """WIND (direction it comes from, degrees) -> velocity of the air towards north, east."""
    return ((Quantity.WIND, along(m.speed, np.radians(np.asarray(m.direction) + 180.0))),)


def wind_cov(m: Any) -> Facts:
    """WIND_COV -> velocity of the air towards north, east."""
    return ((Quantity.WIND, (m.wind_x, m.wind_y)),)


CONDITION_RULES = (
    Rule("HEARTBEAT", heartbeat, Counter.RECEIPT),
    Rule("SYSTEM_TIME", system_time, Counter.BOOT_MS),
    Rule("SYS_STATUS", sys_status, Counter.RECEIPT),
    Rule("BATTERY_STATUS", battery_status, Counter.RECEIPT, instance=("id",)),
    Rule("WIND", wind, Counter.RECEIPT),
    Rule("WIND_COV", wind_cov, Counter.RECEIPT),
)
