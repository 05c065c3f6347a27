"""Which boats a log holds: autopilots that say so in a HEARTBEAT. A ground station is no boat."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as definitions

from gateway.errors import BadInput
from gateway.ingest.log import Log, Table, texts
from gateway.ingest.mapping.vehicle import AUTOPILOT_INVALID

GROUND_STATION = 6  # MAV_TYPE_GCS
AUTOPILOT_COMPONENT = 1
SPOKEN_BY_BOATS = ("ATTITUDE", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SERVO_OUTPUT_RAW")


@dataclass(frozen=True)
class Boat:
    """One vehicle of a log: its address and what it says it is."""

    system: int
    component: int
    autopilot: str = ""  # "ArduPilot", "PX4", …; empty where it never said
    type: str = ""  # "surface boat", "ground rover", …

    def __str__(self) -> str:
        kind = f"{self.autopilot} {self.type}".strip() or "unknown vehicle"
        return f"system {self.system} ({kind})"


BANNERS = {  # how the banner in a DataFlash log begins -> what the vehicle is
    "ArduRover": "rover or boat",
    "ArduSub": "submarine",
    "ArduCopter": "multicopter",
    "ArduPlane": "plane",
}
AUTOPILOTS = {3: "ArduPilot", 12: "PX4", 0: "generic autopilot"}


def boats(log: Log) -> tuple[Boat, ...]:
    """All boats of a log, ordered by their address."""
    if log.kind == "dataflash":
        return (Boat(0, 0, "ArduPilot", from_banner(log.table("MSG"))),)
    if log.kind == "csv":
        return (Boat(0, 0, "", "table"),)
    found = from_heartbeats(log.table("HEARTBEAT"))
    return found or from_motion(log)


def from_heartbeats(table: Table) -> tuple[Boat, ...]:
    """The autopilots among those that send HEARTBEAT."""
    if not len(table):
        return ()
    autopilot = np.asarray(table.columns["autopilot"], np.int64)
    type_ = np.asarray(table.columns["type"], np.int64)
    boat = (autopilot != AUTOPILOT_INVALID) & (type_ != GROUND_STATION)
    rows = np.stack([table.system, table.component, autopilot, type_], axis=1)[boat]
    named = {(int(s), int(c)): (int(a), int(t)) for s, c, a, t in rows}
    return tuple(
        Boat(system, component, AUTOPILOTS.get(kind, _enum("MAV_AUTOPILOT", kind)), _type(type_))
        for (system, component), (kind, type_) in sorted(named.items())
    )


def from_banner(table: Table) -> str:
    """What the firmware that wrote a DataFlash log drives; empty where it did not say."""
    if not len(table):
        return ""
    lines = texts(table.columns["Message"])
    kinds = [kind for line in lines for name, kind in BANNERS.items() if line.startswith(name)]
    return kinds[0] if kinds else ""


def from_heartbeat(message: Any) -> Boat | None:
    """A HEARTBEAT of a live link -> the boat that sent it; None from anybody else."""
    if message.autopilot == AUTOPILOT_INVALID or message.type == GROUND_STATION:
        return None
    autopilot = AUTOPILOTS.get(message.autopilot) or _enum("MAV_AUTOPILOT", message.autopilot)
    return Boat(message.get_srcSystem(), message.get_srcComponent(), autopilot, _type(message.type))


def from_motion(log: Log) -> tuple[Boat, ...]:
    """Without any HEARTBEAT: who speaks of motion as component 1."""
    tables = [log.table(name) for name in SPOKEN_BY_BOATS]
    systems = {
        int(s) for t in tables for s in np.unique(t.system[t.component == AUTOPILOT_COMPONENT])
    }
    return tuple(Boat(system, AUTOPILOT_COMPONENT) for system in sorted(systems))


def choose_boat(log: Log, system: int | None = None) -> Boat:
    """The boat asked for, or the only one; else a line that names those present."""
    present = boats(log)
    if not present:
        raise BadInput(f"{log.path}: no vehicle in it (no HEARTBEAT of an autopilot, no motion)")
    if system is None and len({boat.system for boat in present}) == 1:
        return present[0]
    chosen = [boat for boat in present if boat.system == system]
    if chosen:
        return chosen[0]
    if system is None:
        raise BadInput(f"{log.path}: several boats in it, choose one: {_listed(present)}")
    raise BadInput(f"{log.path}: no boat with system id {system}; present: {_listed(present)}")


def _listed(present: Sequence[Boat]) -> str:
    return ", ".join(str(boat) for boat in present)


def _type(value: int) -> str:
    return _enum("MAV_TYPE", value)


def _enum(name: str, value: int) -> str:
    """MAV_TYPE, 11 -> "surface boat"."""
    entry = definitions.enums[name].get(value)
    return str(entry.name).removeprefix(name + "_").lower().replace("_", " ") if entry else "?"
