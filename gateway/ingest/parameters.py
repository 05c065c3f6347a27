"""The autopilot's own parameters, and what they say of its actuators (for `shadow init`).

What software the autopilot runs, by its own words.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np

from gateway.ingest.log import Log, Table, texts
from gateway.ingest.mapping.vehicle import CHANNELS
from gateway.ingest.mavlink.boats import Boat


class Kind(Enum):
    """What an output channel moves."""

    THROTTLE = "throttle"
    THROTTLE_LEFT = "throttle left"
    THROTTLE_RIGHT = "throttle right"
    MOTOR = "motor"
    STEERING = "steering"
    PASSTHROUGH = "passthrough"


FUNCTIONS: Mapping[int, Kind] = {  # SERVOn_FUNCTION -> kind
    70: Kind.THROTTLE,
    73: Kind.THROTTLE_LEFT,
    74: Kind.THROTTLE_RIGHT,
    26: Kind.STEERING,
    1: Kind.PASSTHROUGH,
    **dict.fromkeys(range(33, 37), Kind.MOTOR),
    **dict.fromkeys(range(51, 67), Kind.PASSTHROUGH),
}


@dataclass(frozen=True)
class Actuator:
    """One output channel that moves the boat."""

    channel: int  # 1-based
    function: int  # SERVOn_FUNCTION
    kind: Kind
    pwm: tuple[float, float, float]  # lowest, neutral, highest [µs]
    reversed: bool

    @property
    def motor(self) -> int | None:
        """Number of the motor (1 to 4) where the function says it."""
        return self.function - 32 if self.kind is Kind.MOTOR else None


def autopilot_parameters(log: Log, boat: Boat) -> dict[str, float]:
    """Name -> value, the last one where a parameter was changed."""
    if log.kind == "dataflash":
        table, name, value = log.table("PARM"), "Name", "Value"
    else:
        table, name, value = log.table("PARAM_VALUE"), "param_id", "param_value"
    if not len(table):
        return {}
    mine = (table.system == boat.system) & (table.component == boat.component)
    names = texts(table.columns[name][mine])
    values = np.asarray(table.columns[value], np.float64)[mine]
    return {key: float(number) for key, number in zip(names, values, strict=True) if key}


def actuators(parameters: Mapping[str, float]) -> list[Actuator]:
    """Parameters -> the channels that move the boat, in order; unset limits are the autopilot's."""
    found = []
    for channel in range(1, CHANNELS + 1):
        function = int(parameters.get(f"SERVO{channel}_FUNCTION", 0))
        if function in FUNCTIONS:
            limits = tuple(
                float(parameters.get(f"SERVO{channel}_{name}", default))
                for name, default in (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))
            )
            reversed_ = bool(parameters.get(f"SERVO{channel}_REVERSED", 0.0))
            pwm = (limits[0], limits[1], limits[2])
            found.append(Actuator(channel, function, FUNCTIONS[function], pwm, reversed_))
    return found


BANNER = re.compile(r"(Ardu\w+|PX4|Blimp)\b.*\d+\.\d+")  # "ArduRover V4.6.3 (3fc7011a)"


def firmware(log: Log, boat: Boat) -> str:
    """Banner of STATUSTEXT or MSG, else the version of AUTOPILOT_VERSION; empty if it is silent."""
    for name, field in (("MSG", "Message"), ("STATUSTEXT", "text")):
        for line in _said(log.table(name), field, boat):
            if BANNER.match(line):
                return line
    return _version(log.table("AUTOPILOT_VERSION"), boat)


def _said(table: Table, field: str, boat: Boat) -> list[str]:
    if not len(table) or field not in table.columns:
        return []
    return texts(table.columns[field][_mine(table, boat)])


def _version(table: Table, boat: Boat) -> str:
    """flight_sw_version: one byte each for major, minor, patch, kind of release."""
    if not len(table) or not _mine(table, boat).any():
        return ""
    packed = int(np.asarray(table.columns["flight_sw_version"])[_mine(table, boat)][-1])
    major, minor, patch = packed >> 24 & 255, packed >> 16 & 255, packed >> 8 & 255
    return f"version {major}.{minor}.{patch}" if packed else ""


def _mine(table: Table, boat: Boat) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    mine = (table.system == boat.system) & (table.component == boat.component)
    return np.asarray(mine, np.bool_)
