"""Recordings of the BlueOS recorder: MAVLink as JSON, made into frames again.

The recorder writes what mavlink-server publishes on zenoh: a channel per message, named
`mavlink/<system>/<component>/<MESSAGE>`, whose payloads are

    {"header": {"system_id": 1, "component_id": 1, "sequence": 7},
     "message": {"type": "ATTITUDE", "time_boot_ms": 1000, "yaw": 0.1, …}}

as Rust's MAVLink library writes them: an enum is {"type": "MAV_TYPE_SURFACE_BOAT"}, flags are
{"bits": 81} or "MAV_MODE_FLAG_A | MAV_MODE_FLAG_B", a field called `type` is `mavtype`, text is a
string or a list of characters, and NaN and Infinity stand as such (JSON5). Channels below a message
(one per field) and `mavlink/out` (all messages once more) are not read.

Each message becomes the frame that pymavlink packs of it: what reads frames reads these.
"""

import json
import re
import struct
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import orjson
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.definitions import definitions, ids_by_name
from gateway.ingest.mavlink.log import Frames
from gateway.recording.blocks import Block
from gateway.recording.reader import Recording

CHANNEL = re.compile(r"mavlink/(\d{1,3})/(\d{1,3})/([A-Z0-9_]+)")
RENAMED = {"type": "mavtype"}  # a word of Rust's own
# what a payload raises that is no such message
UNREADABLE = (KeyError, TypeError, ValueError, OverflowError, struct.error, RecursionError)


class BlueosFrames(NamedTuple):
    """Frames made of a recording, and how many of its messages could not be read."""

    frames: Frames
    unreadable: int


def is_blueos(recording: Recording) -> bool:
    """Does a recording hold channels of MAVLink messages as JSON?"""
    return any(CHANNEL.fullmatch(topic) for topic in recording.counts())


def blueos_frames(recording: Recording) -> BlueosFrames:
    """The messages of a BlueOS recording as frames, in order of receipt."""
    made: list[bytes] = []
    times: list[int] = []
    unreadable = 0
    for name, system, component, payload, time_ns in _messages(recording):
        try:
            made.append(_frame(name, system, component, payload))
            times.append(time_ns)
        except UNREADABLE:
            unreadable += 1
    order = np.argsort(np.array(times, np.int64), kind="stable")
    made = [made[k] for k in order.tolist()]
    edges = np.concatenate([[0], np.cumsum([len(frame) for frame in made])]).astype(np.int64)
    received = np.array(times, np.int64)[order]
    return BlueosFrames(
        Frames.from_buffer(b"".join(made), edges[:-1], edges[1:], received), unreadable
    )


def _messages(recording: Recording) -> Iterator[tuple[str, int, int, bytes, int]]:
    """Name, system, component, payload and receipt [ns] of each message, in file order."""
    for block in recording.blocks():
        senders = _senders(block)
        columns = (block.channel, block.start, block.end, block.log_time_ns)
        for number, start, end, time_ns in zip(*(c.tolist() for c in columns), strict=True):
            if number in senders:
                yield (*senders[number], block.data[start:end], time_ns)


def _senders(block: Block) -> Mapping[int, tuple[str, int, int]]:
    """Channel -> message, system, component; of a message that pymavlink knows."""
    found = {n: CHANNEL.fullmatch(channel.topic) for n, channel in block.channels.items()}
    return {
        number: (match[3], int(match[1]), int(match[2]))
        for number, match in found.items()
        if match and match[3] in ids_by_name() and max(int(match[1]), int(match[2])) < 256
    }


def _frame(name: str, system: int, component: int, payload: bytes) -> bytes:
    """One message as JSON -> its frame; raises one of `UNREADABLE`."""
    content = _parsed(payload)
    fields, kind = content["message"], definitions()[ids_by_name()[name]]
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    values = [
        _value(fields.get(RENAMED.get(field, field), 0), type_name, lengths[field], field, kind)
        for field, type_name in zip(kind.fieldnames, kind.fieldtypes, strict=True)
    ]
    sender = dialect.MAVLink(None, system, component)
    sender.seq = int(content["header"].get("sequence", 0)) & 0xFF
    frame: bytes = bytes(kind(*values).pack(sender))
    return frame


def _parsed(payload: bytes) -> Any:
    """JSON, with NaN and Infinity where there are such numbers."""
    try:
        return orjson.loads(payload)
    except orjson.JSONDecodeError:
        return json.loads(payload)


def _value(given: Any, type_name: str, length: int, field: str, kind: Any) -> Any:
    """One field of JSON as pymavlink takes it."""
    if type_name == "char":
        return _text(given, length)
    if length:
        given = list(given) if isinstance(given, list) else []
        numbers = [_number(item, type_name, field, kind) for item in given[:length]]
        return numbers + [0] * (length - len(numbers))
    return _number(given, type_name, field, kind)


def _text(given: Any, length: int) -> bytes:
    text = "".join(map(str, given)) if isinstance(given, list) else str(given or "")
    return text.encode("utf-8", errors="replace")[: max(length, 1)]


def _number(given: Any, type_name: str, field: str, kind: Any) -> float | int:
    if type_name in ("float", "double"):
        return float("nan") if given is None else float(given)
    if isinstance(given, dict):
        given = given["bits"] if "bits" in given else given["type"]
    if isinstance(given, str):
        return _flags(given, kind.fieldenums_by_name.get(field, ""))
    return int(given or 0)


def _flags(text: str, enum: str) -> int:
    """Names of one enum, joined by |, or numbers for flags without a name -> their sum."""
    total = 0
    for word in filter(None, (part.strip() for part in text.split("|"))):
        total |= int(word, 0) if word[:1].isdigit() else _names(enum)[word]
    return total


@cache
def _names(enum: str) -> Mapping[str, int]:
    """Name -> value of an enum; of all enums where it is not known."""
    tables = [dialect.enums[enum]] if enum in dialect.enums else list(dialect.enums.values())
    return {entry.name: value for table in tables for value, entry in table.items()}
