"""What a recording says of the boat's modes and of events, and any message on the boat's clock.

A message stands in the log between others whose time on the boat's clock is known: its own is
interpolated between theirs, by the order in which they were accepted. Modes are those of
ArduPilot's Rover and boat and PX4's navigation states; a number without a name is shown as it is.
Source: ROVER_MODE and PX4_CUSTOM_MAIN_MODE of the message definitions; vehicle_status of PX4.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as definitions

from gateway.ingest.decoding import UNREADABLE
from gateway.ingest.log import Boat, Log, Table, text
from sim.state import Ints

PX4_MAIN = (
    "",
    "manual",
    "altitude",
    "position",
    "auto",
    "acro",
    "offboard",
    "stabilised",
    "rattitude",
)
PX4_STATES = {  # vehicle_status.nav_state
    0: "manual", 1: "altitude", 2: "position", 3: "mission", 4: "hold", 5: "return", 10: "acro",
    14: "offboard", 15: "stabilised", 17: "take-off", 18: "land",
}  # fmt: skip
WARNING = 4  # MAV_SEVERITY: at and below it something is wrong
MOST_EVENTS = 400  # of one recording; more than that nobody reads


class Happening(NamedTuple):
    """Something that began, or happened, at a time of the boat's clock [ns]."""

    time_ns: int
    text: str
    bad: bool = False


class Happenings(NamedTuple):
    """Modes, each from its beginning on, and events; in order of time."""

    modes: tuple[Happening, ...] = ()
    events: tuple[Happening, ...] = ()


def on_boat_clock(log: Log, boat: Boat) -> Callable[[Table], Ints]:
    """A function: table of the log -> times (K,) of its messages on the boat's clock [ns]."""
    known = log.decode(boat).samples
    order = np.concatenate([one.order for one in known] or [np.zeros(0, np.int64)])
    time = np.concatenate([one.vehicle_time_ns for one in known] or [np.zeros(0, np.int64)])
    order, first = np.unique(order, return_index=True)
    time = time[first]

    def times(table: Table) -> Ints:
        if not len(order):
            return np.asarray(table.receive_time_ns, np.int64)
        since = np.interp(table.order, order, (time - time[0]).astype(np.float64))
        return np.asarray(np.rint(since), np.int64) + time[0]

    return times


def happenings(log: Log, boat: Boat) -> Happenings:
    """Modes and events of one boat of a log; empty where it has none that are known."""
    times, counts = on_boat_clock(log, boat), log.counts()
    modes: list[Happening] = []
    events: list[Happening] = []
    for message in (*MODES, *EVENTS):
        table = log.table(message) if message in counts else None
        with suppress(*UNREADABLE, KeyError):  # a log's own definition may lack a field
            if table is not None and message in EVENTS:
                events += _events(times(table), table, boat)
            elif table is not None and not modes:
                modes = _changes(times(table), table, boat)
    return Happenings(tuple(modes), tuple(sorted(events)[:MOST_EVENTS]))


def _changes(at: Ints, table: Table, boat: Boat) -> list[Happening]:
    """Where the mode that a message holds becomes another."""
    names, out = MODES[table.name](table.columns), list[Happening]()
    for k in np.flatnonzero(table.sent_by(boat)):
        name = names(int(k))
        if not out or out[-1].text != name:
            out.append(Happening(int(at[k]), name))
    return out


def _events(at: Ints, table: Table, boat: Boat) -> list[Happening]:
    """What the messages of one name say, the first of them."""
    says = EVENTS[table.name](table.columns)
    rows = np.flatnonzero(table.sent_by(boat))[:MOST_EVENTS]
    return [Happening(int(at[k]), *says(int(k))) for k in rows if says(int(k))[0]]


_Names = Callable[[int], str]
_Events = Callable[[int], tuple[str, bool]]
_Columns = Mapping[str, Any]


def rover_mode(number: int) -> str:
    """ArduPilot's name of a mode of a Rover or boat."""
    entry = definitions.enums["ROVER_MODE"].get(number)
    known = entry is not None and not entry.name.endswith("ENUM_END")
    if not known:
        return f"mode {number}"
    return str(entry.name).removeprefix("ROVER_MODE_").replace("_", " ").lower()


def _heartbeat(columns: _Columns) -> _Names:
    autopilot, mode = columns["autopilot"], columns["custom_mode"]

    def name(k: int) -> str:
        if autopilot[k] == definitions.MAV_AUTOPILOT_PX4:
            main = int(mode[k]) >> 16 & 0xFF
            return PX4_MAIN[main] if 0 < main < len(PX4_MAIN) else f"mode {main}"
        return rover_mode(int(mode[k]))

    return name


def _dataflash_mode(columns: _Columns) -> _Names:
    numbers = columns["ModeNum" if "ModeNum" in columns else "Mode"]
    return lambda k: rover_mode(int(numbers[k]))


def _px4_state(columns: _Columns) -> _Names:
    states = columns["nav_state"]
    return lambda k: PX4_STATES.get(int(states[k]), f"state {int(states[k])}")


MODES: Mapping[str, Callable[[_Columns], _Names]] = {
    "HEARTBEAT": _heartbeat, "MODE": _dataflash_mode, "vehicle_status": _px4_state,
}  # fmt: skip


def _statustext(columns: _Columns) -> _Events:
    return lambda k: (text(columns["text"][k]), int(columns["severity"][k]) <= WARNING)


def _dataflash_text(columns: _Columns) -> _Events:
    return lambda k: (text(columns["Message"][k]), False)


def _dataflash_error(columns: _Columns) -> _Events:
    return lambda k: (f"error {columns['ECode'][k]} of subsystem {columns['Subsys'][k]}", True)


EVENTS: Mapping[str, Callable[[_Columns], _Events]] = {
    "STATUSTEXT": _statustext, "MSG": _dataflash_text, "ERR": _dataflash_error,
}  # fmt: skip
