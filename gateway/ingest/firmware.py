"""What software the autopilot runs, by its own words."""

import re

import numpy as np

from gateway.ingest.boats import Boat
from gateway.ingest.log import Log, Table
from gateway.ingest.text import texts

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
