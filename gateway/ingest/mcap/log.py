"""MCAP recordings as logs: the gateway's own, and those of the BlueOS recorder.

Of its own the gateway reads the raw frames, or the log that they enclose. A log of any other format
than MAVLink frames (.BIN, .ulg, a table with its mapping) lies in a recording as attachments,
packed with zstandard, so that whoever has the recording has all that the log had:

    log/NAME.zst        the log
    log/mapping.toml    what its columns mean, where it is a table

The BlueOS recorder writes what mavlink-server publishes on zenoh: a channel per message, named
`mavlink/<system>/<component>/<MESSAGE>`, whose payloads are

    {"header": {"system_id": 1, "component_id": 1, "sequence": 7},
     "message": {"type": "ATTITUDE", "time_boot_ms": 1000, "yaw": 0.1, …}}

as Rust's MAVLink library writes them: an enum is {"type": "MAV_TYPE_SURFACE_BOAT"}, flags are
{"bits": 81} or "MAV_MODE_FLAG_A | MAV_MODE_FLAG_B", a field called `type` is `mavtype`, text is a
string or a list of characters, and NaN and Infinity stand as such (JSON5). Channels below a message
(one per field) and `mavlink/out` (all messages once more) are not read. Each message becomes the
frame that pymavlink packs of it: what reads frames reads these.
"""

import json
import re
import struct
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import orjson
import zstandard
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput, ShadowError, printable
from gateway.ingest import HEAD, read_bytes
from gateway.ingest.log import Log, Statistics
from gateway.ingest.mavlink.frames import definitions, ids_by_name
from gateway.ingest.mavlink.log import Frames, MavlinkLog
from gateway.ingest.mcap import MAGIC
from gateway.recording.blocks import ALWAYS_UNPACKED, MAX_EXPANSION, Block
from gateway.recording.reader import Recording
from gateway.recording.recorder import Attachment


def mcap_log(path: str | Path, mapping: str | Path | None) -> Log:
    """All frames of a recording in order of handling, or the log that it encloses.

    BadInput where it holds neither.
    """
    recording = Recording.open(Path(path))
    rows = recording.raw()
    filled = rows.end > rows.start  # a tick of a live recording is an empty frame
    if not filled.any():
        if is_blueos(recording):
            return _blueos_log(recording)
        enclosed = open_enclosed(recording, mapping)
        if enclosed is not None:
            return enclosed
        if recording.damage:
            raise ShadowError(
                f"{path}: the file is damaged: use another copy of it "
                f"({recording.damage.text()}, and no log is in what is left)"
            )
        other = "give a recording of a voyage (`shadow simulate --log` writes one)"
        if any("hil" in entries for entries in recording.metadata.values()):
            other = (
                "`shadow hil` writes the truth here, which no analysis reads: give the autopilot's "
                "own log of that run (logs/*.BIN, *.ulg), or this one to compare --with-hil"
            )
        raise BadInput(f"{path}: holds no MAVLink frames and encloses no log: {other}")
    frames = Frames.from_buffer(
        rows.data, rows.start[filled], rows.end[filled], rows.receive_time_ns[filled]
    )
    return MavlinkLog(str(path), frames, _statistics(recording, frames), "mcap", recording)


def _blueos_log(recording: Recording) -> Log:
    """A recording of the BlueOS recorder; BadInput where none of its messages can be read."""
    frames, unreadable = blueos_frames(recording)
    if not len(frames):
        raise BadInput(f"{recording.path}: none of its MAVLink messages can be read")
    found = _statistics(recording, frames)
    notes = [*found.notes, "messages were recorded as JSON (BlueOS): frames are made from them"]
    if unreadable:
        notes.append(f"{unreadable} message(s) cannot be read: they are left out")
    statistics = replace(found, notes=tuple(notes))
    return MavlinkLog(str(recording.path), frames, statistics, "mcap of BlueOS")


def _statistics(recording: Recording, frames: Frames) -> Statistics:
    """What was found in the frames, and that the file was not finished or is damaged."""
    notes, damage = frames.statistics.notes, recording.damage
    if damage:
        end = "" if recording.finished else ", and the recording was not finished"
        notes += (
            f"{damage.text()}{end}: `shadow repair` writes what can be read anew and keeps this "
            "file beside it",
        )
    elif not recording.finished:
        notes += ("the recording was not finished: `shadow repair` makes it whole",)
    return replace(
        frames.statistics,
        size_bytes=recording.path.stat().st_size,
        truncated_tail=not recording.finished,
        notes=notes,
    )


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


FOLDER, PACKED, MAPPING = "log/", ".zst", "log/mapping.toml"
MAX_BYTES = 500_000_000  # of a log that is enclosed: of a larger one recordings open slowly


def enclosure(raw: bytes, name: str, mapping: bytes | None = None) -> list[Attachment]:
    """A log of that file name, and the mapping of a table, as attachments; none where too large."""
    if len(raw) > MAX_BYTES:
        return []
    packed = zstandard.ZstdCompressor().compress(raw)
    found = [Attachment(f"{FOLDER}{name}{PACKED}", "application/zstd", packed)]
    if mapping is not None:
        found.append(Attachment(MAPPING, "application/toml", mapping))
    return found


def enclosure_of_file(path: Path, mapping: Path | None) -> list[Attachment]:
    """The same of a log on disk; what a recording encloses is passed on."""
    raw = read_bytes(path)
    if raw.startswith(b"\x89MCAP"):
        held = Recording.open(path).attachments
        return [item for name, item in held.items() if name.startswith(FOLDER)]
    return enclosure(raw, printable(path.name), None if mapping is None else mapping.read_bytes())


def open_enclosed(recording: Recording, mapping: str | Path | None) -> "Log | None":
    """The log that a recording encloses; None where there is none."""
    from gateway.ingest.open import known_formats

    held: Mapping[str, Attachment] = recording.attachments
    names = [name for name in held if name.startswith(FOLDER) and name.endswith(PACKED)]
    if not names:
        return None
    path, raw = str(recording.path), _unpacked(recording.path, held[names[0]].data)
    name = Path(names[0].removeprefix(FOLDER).removesuffix(PACKED)).name
    with tempfile.TemporaryDirectory() as folder:
        if mapping is None and MAPPING in held:
            mapping = Path(folder) / "mapping.toml"
            mapping.write_bytes(held[MAPPING].data)
        for one in known_formats():
            if ".mcap" not in one.suffixes and one.recognises(raw[:HEAD], Path(name)):
                return one.open(path, raw, mapping)
    raise BadInput(f"{path}: encloses {name}, which is no log of a known format")


def recording_of(log: Log) -> Recording | None:
    """The gateway's own recording that holds the frames of a log or encloses it; None for others.

    A log that is enclosed has the path of its recording.
    """
    if isinstance(log, MavlinkLog):
        return log.recording
    with Path(log.path).open("rb") as stream:
        held = stream.read(len(MAGIC)) == MAGIC
    return Recording.open(Path(log.path)) if held else None


def _unpacked(path: Path, packed: bytes) -> bytes:
    """Bytes of a log; BadInput where they are damaged or unpack without end."""
    room = ALWAYS_UNPACKED + MAX_EXPANSION * len(packed)
    try:
        size = zstandard.frame_content_size(packed)
        if not 0 <= size <= min(room, MAX_BYTES):
            raise BadInput(f"{path}: the enclosed log unpacks to more than a log has: not read")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError:
        raise BadInput(f"{path}: the enclosed log is damaged: use another copy of it") from None
