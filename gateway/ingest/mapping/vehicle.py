"""SERVO_OUTPUT_RAW, ACTUATOR_OUTPUT_STATUS, RCOU, RCO2, RCO3: pulses of the output channels.

Values are always 32 wide. Which channels a source speaks of is in `SPAN`: there NaN means "no
pulse", outside it means "not said". `merged` joins the sources.

HEARTBEAT, SYSTEM_TIME, SYS_STATUS, BATTERY_STATUS, WIND, WIND_COV: the boat's condition.
"""

from typing import Any

import numpy as np

from gateway.ingest.mapping.motion import along
from gateway.ingest.mapping.rule import Column, Counter, Facts, Rule, known, only_where, optional
from gateway.samples import Quantity

CHANNELS = 32
SHORTEST, LONGEST = 400.0, 2600.0  # µs: outside these a servo gets no pulse that it understands

SPAN = {  # source -> first and last channel, 1-based
    "SERVO_OUTPUT_RAW": (1, 16),
    "SERVO_OUTPUT_RAW/1": (17, 32),
    "ACTUATOR_OUTPUT_STATUS": (1, 32),
    "RCOU": (1, 14),
    "RCO2": (15, 18),
    "RCO3": (19, 32),
}


def pulses(columns: list[Column]) -> list[Column]:
    """Pulse widths [µs] of some channels; NaN for 0, 65535 and what no servo takes."""
    width = np.stack([np.asarray(column, dtype=np.float64) for column in columns])
    return list(only_where((width >= SHORTEST) & (width <= LONGEST), width))


def merged(previous: Any, source: str, values: Any) -> Any:
    """The 32 pulses known so far and what a source says now -> the 32 pulses now [µs]."""
    first, last = SPAN.get(source, (1, CHANNELS))
    now = np.array(previous, dtype=np.float64)
    now[first - 1 : last] = np.asarray(values, dtype=np.float64)[first - 1 : last]
    return now


def spread(first: int, columns: list[Column]) -> Facts:
    """Pulses of consecutive channels -> all 32 channels, NaN where not said."""
    said = pulses(columns)
    silent = np.full(np.shape(said[0]), np.nan)
    values = [silent] * (first - 1) + said
    return ((Quantity.ACTUATORS, tuple(values + [silent] * (CHANNELS - len(values)))),)


def servo_output_raw(m: Any) -> Facts:
    """SERVO_OUTPUT_RAW of the first port -> channels 1 to 16."""
    return spread(1, [optional(m, f"servo{i}_raw", 0) for i in range(1, 17)])


def servo_output_raw_second(m: Any) -> Facts:
    """SERVO_OUTPUT_RAW of the second port -> channels 17 to 32."""
    return spread(17, [optional(m, f"servo{i}_raw", 0) for i in range(1, 17)])


def actuator_output_status(m: Any) -> Facts:
    """ACTUATOR_OUTPUT_STATUS -> channels 1 to 32, where they are pulses at all."""
    outputs = np.asarray(m.actuator, dtype=np.float64)
    return spread(1, [outputs[..., i] for i in range(CHANNELS)])


def rcou(m: Any) -> Facts:
    """DataFlash RCOU -> channels 1 to 14."""
    return spread(1, [optional(m, f"C{i}", 0) for i in range(1, 15)])


def rco2(m: Any) -> Facts:
    """DataFlash RCO2 -> channels 15 to 18."""
    return spread(15, [optional(m, f"C{i}", 0) for i in range(15, 19)])


def rco3(m: Any) -> Facts:
    """DataFlash RCO3 -> channels 19 to 32."""
    return spread(19, [optional(m, f"C{i}", 0) for i in range(19, 33)])


ACTUATOR_RULES = (
    Rule("SERVO_OUTPUT_RAW", servo_output_raw, Counter.BOOT_US32, instance=("port",)),
    Rule(
        "SERVO_OUTPUT_RAW",
        servo_output_raw_second,
        Counter.BOOT_US32,
        source="SERVO_OUTPUT_RAW/1",
        instance=("port",),
        number=1,
    ),
    Rule("ACTUATOR_OUTPUT_STATUS", actuator_output_status, Counter.BOOT_US),
)
DATAFLASH_ACTUATOR_RULES = (
    Rule("RCOU", rcou, Counter.BOOT_US, field="TimeUS"),
    Rule("RCO2", rco2, Counter.BOOT_US, field="TimeUS"),
    Rule("RCO3", rco3, Counter.BOOT_US, field="TimeUS"),
)


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
