"""What happened in a log, in order: `shadow info --events`.

Arming and modes, what the autopilot said (STATUSTEXT, MSG), and, in a recording of ours, the events
of the shadow. Times count from the first message of the log, by its receipt.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import orjson

from gateway.ingest.log import Boat, Log, Table
from gateway.ingest.mavlink.log import MavlinkLog

ARMED = 128  # bit of a heartbeat's base_mode
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
    found = [*_heartbeats(log, boat), *_flash_states(log), *_said(log, boat), *_of_the_shadow(log)]
    starts = [log.table(name).receive_time_ns for name in log.counts()]
    first = min((int(times.min()) for times in starts if len(times)), default=0)
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
    armed = (beats.columns["base_mode"][own].astype(np.int64) & ARMED) > 0
    yield from _changes(at, armed.tolist(), {True: "armed", False: "disarmed"})
    yield from _changes(at, beats.columns["custom_mode"][own].tolist(), {})


def _flash_states(log: Log) -> Iterator[Row]:
    """The same of a DataFlash log."""
    counts = log.counts()
    if "ARM" in counts:
        table = log.table("ARM")
        states = (table.columns["ArmState"].astype(np.int64) > 0).tolist()
        yield from _changes(table.receive_time_ns, states, {True: "armed", False: "disarmed"})
    if "MODE" in counts:
        table = log.table("MODE")
        yield from _changes(table.receive_time_ns, table.columns["Mode"].tolist(), {})


def _changes(at: Any, states: list[Any], names: dict[Any, str]) -> Iterator[Row]:
    """The first state and every other one; a state without a name is the number of a mode."""
    for k, state in enumerate(states):
        if k == 0 or state != states[k - 1]:
            yield int(at[k]), "autopilot", "info", names.get(state, f"mode {state}")


def _said(log: Log, boat: Boat) -> Iterator[Row]:
    """Texts of the autopilot; the pieces of a long one together."""
    counts = log.counts()
    if "MSG" in counts:
        said = log.table("MSG")
        for at, text in zip(said.receive_time_ns.tolist(), _texts(said, "Message"), strict=True):
            yield at, "autopilot", "info", text
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


def _texts(table: Table, column: str) -> list[str]:
    values = table.columns[column].tolist()
    return [v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in values]


def _of_the_shadow(log: Log) -> Iterator[Row]:
    """Events that a gateway recorded."""
    if not isinstance(log, MavlinkLog) or log.recording is None:
        return
    for rows in log.recording.rows("event"):
        for at, payload in zip(rows.receive_time_ns.tolist(), rows.payloads, strict=True):
            event = orjson.loads(payload)
            yield at, "shadow", str(event.get("severity", "")), str(event.get("says", ""))
