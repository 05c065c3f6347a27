"""What happened in a log: a list in order (`shadow info --events`), and modes on the boat's clock.

The list: arming and modes (of a ULog its `vehicle_status`, of a table its column `armed`), what the
autopilot said (STATUSTEXT, MSG, the texts of a ULog), changes of the parameters that say what its
outputs are, what its filter said of itself, and, in a recording of ours, the events of the shadow.
Its times count from the first message of the log, by its receipt.

On the boat's clock, a message stands between others whose time is known: its own is interpolated
between theirs, by the order in which they were accepted. Modes are those of ArduPilot's Rover and
boat and PX4's navigation states; a number without a name is shown as it is.
Source: ROVER_MODE and PX4_CUSTOM_MAIN_MODE of the message definitions; vehicle_status of PX4.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
import orjson
from pymavlink.dialects.v20 import ardupilotmega as definitions

from gateway.ingest.log import UNREADABLE, Boat, Log, Table, log_start_ns, text
from gateway.ingest.mapping import STATUS_CONFIRMED_S, EstimatorFault
from gateway.ingest.mavlink.mapping import ARMED_BIT
from gateway.ingest.mcap.log import recording_of
from gateway.ingest.parameter_changes import parameter_changes
from gateway.ingest.sources import choose
from sim.state import Ints

STATUS = "vehicle_status"  # of PX4: its modes
LOGGED = "logged_message"  # texts of a ULog
PX4_EVENT = "event"  # of PX4's events interface: a number, whose text is in the firmware's metadata
SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")


@dataclass(frozen=True)
class LogEvent:
    """One event: seconds since the log's first message, who tells it, how bad it is, what it is."""

    time_s: float
    by: str
    severity: str
    text: str


def log_events(log: Log, boat: Boat) -> list[LogEvent]:
    """Everything that happened to a boat or was said by it, in order of time."""
    found = [
        *_heartbeats(log, boat), *_flash_states(log, boat), *_other_states(log, boat),
        *_said(log, boat), *_parameters(log, boat), *_estimator(log, boat), *_of_the_shadow(log),
    ]  # fmt: skip
    first = log_start_ns(log)
    return [
        LogEvent((at - first) * 1e-9, by, severity, text)
        for at, by, severity, text in sorted(found, key=lambda row: row[0])
    ]


def as_dicts(events: list[LogEvent]) -> list[dict[str, Any]]:
    """`events` in `shadow info --events --json`."""
    return [asdict(event) for event in events]


Row = tuple[int, str, str, str]


def _heartbeats(log: Log, boat: Boat) -> Iterator[Row]:
    """Arming and changes of mode."""
    if "HEARTBEAT" not in log.counts():
        return
    beats = log.table("HEARTBEAT")
    own = (beats.system == boat.system) & (beats.component == boat.component)
    at = beats.receive_time_ns[own]
    armed = (beats.columns["base_mode"][own].astype(np.int64) & ARMED_BIT) > 0
    yield from _arming(at, armed.tolist())
    yield from _named_modes(beats, boat)


def _flash_states(log: Log, boat: Boat) -> Iterator[Row]:
    """The same of a DataFlash log."""
    counts = log.counts()
    if "ARM" in counts:
        table = log.table("ARM")
        states = (table.columns["ArmState"].astype(np.int64) > 0).tolist()
        yield from _arming(table.receive_time_ns, states)
    if "MODE" in counts:
        yield from _named_modes(log.table("MODE"), boat)


def _other_states(log: Log, boat: Boat) -> Iterator[Row]:
    """The same of a ULog or a table: arming as it is decoded."""
    counts = log.counts()
    armed = choose(log.decode(boat).samples).get("armed")
    if armed is not None and not counts.keys() & {"HEARTBEAT", "ARM"}:
        at, values = armed.samples.receive_time_ns, armed.samples.values[:, 0] > 0.0
        yield from _arming(at, values.tolist())
    if STATUS in counts:
        yield from _named_modes(log.table(STATUS), boat)


def _named_modes(table: Table, boat: Boat) -> Iterator[Row]:
    """The first mode and every other one, by their names; one that has none by its number."""
    with suppress(*UNREADABLE, KeyError):  # a log's own definition may lack the mode
        for one in _mode_changes(table.receive_time_ns, table, boat):
            name = one.text.removeprefix("state ").removeprefix("mode ")
            yield one.time_ns, "autopilot", "info", f"mode {name}"


def _arming(at: Any, states: list[bool]) -> Iterator[Row]:
    """Whether it is armed at first, and every change."""
    for k, armed in enumerate(states):
        if k == 0 or armed != states[k - 1]:
            yield int(at[k]), "autopilot", "info", "armed" if armed else "disarmed"


def _said(log: Log, boat: Boat) -> Iterator[Row]:
    """Texts of the autopilot; the pieces of a long one together."""
    counts = log.counts()
    if "MSG" in counts:
        said = log.table("MSG")
        for at, text in zip(said.receive_time_ns.tolist(), _texts(said, "Message"), strict=True):
            yield at, "autopilot", "info", text
    if LOGGED in counts:
        said = log.table(LOGGED)
        levels = said.columns["severity"].tolist()
        rows = zip(said.receive_time_ns.tolist(), levels, _texts(said, "text"), strict=True)
        yield from ((at, "autopilot", SEVERITIES[level], text) for at, level, text in rows)
    if PX4_EVENT in counts:
        yield from _px4_events(log.table(PX4_EVENT))
    if "STATUSTEXT" not in counts:
        return
    table, open_id, whole = log.table("STATUSTEXT"), 0, list[Row]()
    own = table.system == boat.system
    ids, pieces = (table.columns.get(n, np.zeros(len(own), int)) for n in ("id", "chunk_seq"))
    texts = _texts(table, "text")
    for k in np.flatnonzero(own).tolist():
        number, piece = int(ids[k]), int(pieces[k])
        if whole and number and piece and number == open_id:
            whole[-1] = (*whole[-1][:3], whole[-1][3] + texts[k])
            continue
        level = int(table.columns["severity"][k])
        severity = SEVERITIES[level] if level < len(SEVERITIES) else str(level)
        whole.append((int(table.receive_time_ns[k]), "autopilot", severity, texts[k]))
        open_id = number
    yield from whole


def _px4_events(table: Table) -> Iterator[Row]:
    """Events without their texts: by number and level; those only for protocols left out."""
    with suppress(*UNREADABLE, KeyError):  # a log's own definition may lack a field
        levels = table.columns["log_levels"].astype(np.int64) & 15  # what users are told
        for at, number, level in zip(
            table.receive_time_ns.tolist(), table.columns["id"].tolist(), levels.tolist(),
            strict=True,
        ):  # fmt: skip
            if level < len(SEVERITIES):
                text = f"event {int(number)} of PX4 (its text is in the firmware's metadata)"
                yield at, "autopilot", SEVERITIES[level], text


def _texts(table: Table, column: str) -> list[str]:
    values = table.columns[column].tolist()
    return [v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in values]


def _parameters(log: Log, boat: Boat) -> Iterator[Row]:
    """Changes of the parameters that say what the outputs are."""
    for one in parameter_changes(log, boat):
        yield one.receive_time_ns, "autopilot", "notice", str(one)


def _estimator(log: Log, boat: Boat) -> Iterator[Row]:
    """What the autopilot's filter says of itself, for longer than one report, and its switches."""
    decoded = log.decode(boat)
    for switch in decoded.lane_switches:
        yield switch.receive_time_ns, "autopilot", "warning", str(switch)
    chosen = choose(decoded.samples).get("estimator")
    if chosen is None:
        return
    at, faults = chosen.samples.receive_time_ns, chosen.samples.values[:, 0].astype(np.int64)
    edges = np.flatnonzero(np.diff(faults > 0, prepend=False, append=False))
    for start, stop in edges.reshape(-1, 2).tolist():
        if (at[stop - 1] - at[start]) * 1e-9 < STATUS_CONFIRMED_S:
            continue
        told = EstimatorFault(int(np.bitwise_or.reduce(faults[start:stop])))
        names = ", ".join(fault.name.lower() for fault in told if fault.name)
        yield int(at[start]), "autopilot", "warning", f"the autopilot's EKF is unhealthy: {names}"
        if stop < len(at):
            yield int(at[stop]), "autopilot", "info", "the autopilot's EKF is healthy again"


def _of_the_shadow(log: Log) -> Iterator[Row]:
    """Events that a gateway recorded."""
    recording = recording_of(log)
    if recording is None:
        return
    for rows in recording.rows("event"):
        for at, payload in zip(rows.receive_time_ns.tolist(), rows.payloads, strict=True):
            event = orjson.loads(payload)
            yield at, "shadow", str(event.get("severity", "")), str(event.get("says", ""))


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
PX4_AUTO = {2: "take-off", 3: "hold", 4: "mission", 5: "return", 6: "land"}  # of the mode auto
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
    decoded = log.decode(boat)

    def times(table: Table) -> Ints:
        known = decoded.times_at(table.order)
        return np.asarray(table.receive_time_ns, np.int64) if known is None else known

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
                modes = _mode_changes(times(table), table, boat)
    return Happenings(tuple(modes), tuple(sorted(events)[:MOST_EVENTS]))


def _mode_changes(at: Ints, table: Table, boat: Boat) -> list[Happening]:
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
            main, sub = int(mode[k]) >> 16 & 0xFF, int(mode[k]) >> 24
            if main == PX4_MAIN.index("auto"):
                return PX4_AUTO.get(sub, "auto")
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
    "HEARTBEAT": _heartbeat, "MODE": _dataflash_mode, STATUS: _px4_state,
}  # fmt: skip


def _statustext(columns: _Columns) -> _Events:
    return lambda k: (text(columns["text"][k]), int(columns["severity"][k]) <= WARNING)


def _dataflash_text(columns: _Columns) -> _Events:
    return lambda k: (text(columns["Message"][k]), False)


def _ulog_text(columns: _Columns) -> _Events:
    return lambda k: (text(columns["text"][k]), int(columns["severity"][k]) <= WARNING)


def _dataflash_error(columns: _Columns) -> _Events:
    return lambda k: (f"error {columns['ECode'][k]} of subsystem {columns['Subsys'][k]}", True)


EVENTS: Mapping[str, Callable[[_Columns], _Events]] = {
    "STATUSTEXT": _statustext, "MSG": _dataflash_text, "ERR": _dataflash_error,
    LOGGED: _ulog_text,
}  # fmt: skip
