"""Boats that MAVLink messages come from: the autopilots among the senders of HEARTBEAT.

A ground station or a companion computer is no boat.
"""

from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as definitions

from gateway.ingest.log import Boat, Log, Table
from gateway.ingest.mavlink.mapping import AUTOPILOT_INVALID

GROUND_STATION = 6  # MAV_TYPE_GCS
AUTOPILOT_COMPONENT = 1
SENT_BY_BOATS = ("ATTITUDE", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW")
AUTOPILOTS = {3: "ArduPilot", 12: "PX4", 0: "generic autopilot"}


def from_heartbeats(table: Table) -> tuple[Boat, ...]:
    """The autopilots among those that send HEARTBEAT, ordered by their address."""
    if not len(table):
        return ()
    autopilot = np.asarray(table.columns["autopilot"], np.int64)
    type_ = np.asarray(table.columns["type"], np.int64)
    boat = (autopilot != AUTOPILOT_INVALID) & (type_ != GROUND_STATION)
    rows = np.stack([table.system, table.component, autopilot, type_], axis=1)[boat]
    named = {(int(s), int(c)): (int(a), int(t)) for s, c, a, t in rows}
    return tuple(_boat(*address, *kind) for address, kind in sorted(named.items()))


def from_heartbeat(message: Any) -> Boat | None:
    """A HEARTBEAT of a live link -> the boat that sent it; None from anything else."""
    if message.autopilot == AUTOPILOT_INVALID or message.type == GROUND_STATION:
        return None
    address = message.get_srcSystem(), message.get_srcComponent()
    return _boat(*address, message.autopilot, message.type)


def from_motion(log: Log) -> tuple[Boat, ...]:
    """Without any HEARTBEAT: the systems whose component 1 reports motion."""
    tables = [log.table(name) for name in SENT_BY_BOATS]
    systems = {
        int(s) for t in tables for s in np.unique(t.system[t.component == AUTOPILOT_COMPONENT])
    }
    return tuple(Boat(system, AUTOPILOT_COMPONENT) for system in sorted(systems))


def vehicle_type(number: int) -> str:
    """MAV_TYPE: 11 -> "surface boat"."""
    return _enum("MAV_TYPE", number)


def _boat(system: int, component: int, autopilot: int, type_: int) -> Boat:
    name = AUTOPILOTS.get(autopilot) or _enum("MAV_AUTOPILOT", autopilot)
    return Boat(system, component, name, vehicle_type(type_))


def _enum(name: str, value: int) -> str:
    """MAV_TYPE, 11 -> "surface boat"."""
    entry = definitions.enums[name].get(value)
    return str(entry.name).removeprefix(name + "_").lower().replace("_", " ") if entry else "?"
