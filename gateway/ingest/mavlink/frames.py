"""Finds MAVLink frames in bytes that may be damaged and reads their headers and payloads: compiled.

A record of a .tlog is a time stamp (8 bytes, big-endian Unix µs) and one MAVLink frame. A frame is
accepted when its checksum (CRC-16/MCRF4XX over all but magic, closed by the message's seed) holds.
An unknown message or a wrong checksum is counted as such where another record or the end follows;
otherwise its bytes are junk. Its length is never relied on: the search goes on at its next byte.

Name, layout and checksum seed of each message are pymavlink's own definitions: a newer pymavlink
brings newer messages.

All compiled functions stand in this one file: numba's cache does not notice changes elsewhere. They
are inlined by numba, which saves a third of the time over calls.
"""

import re
from collections.abc import Mapping
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega

from sim.kernel.compiled import compiled, inlined
from sim.state import Ints

# The dialect itself, not `mavutil`: that one reads and sets environment variables when imported.

NO_SEED = -1
ITEM = re.compile(r"(\d*)([a-zA-Z])")  # one field of a struct format: how many, of what


class Layout(NamedTuple):
    """How the payload of one message lies in memory, little-endian and packed."""

    name: str
    dtype: np.dtype[np.void]
    fields: tuple[str, ...]  # in the order of the definition, not of the wire


@cache
def definitions() -> Mapping[int, Any]:
    """Message id -> pymavlink's class of the message: msgname, crc_extra, fieldnames, …"""
    found: Mapping[int, Any] = ardupilotmega.mavlink_map
    return found


@cache
def ids_by_name() -> Mapping[str, int]:
    """Message name -> message id."""
    return {definition.msgname: number for number, definition in definitions().items()}


@cache
def checksum_seeds() -> NDArray[np.int16]:
    """Byte that closes the checksum of each message id, `NO_SEED` where no message has that id."""
    seeds = np.full(max(definitions()) + 1, NO_SEED, np.int16)
    for number, definition in definitions().items():
        seeds[number] = definition.crc_extra
    seeds.setflags(write=False)
    return seeds


@cache
def layout(number: int) -> Layout:
    """The layout of a known message id."""
    definition = definitions()[number]
    # `native_format` leaves out the lengths of arrays; the unpacker has them
    packed = definition.unpacker.format
    kinds = [_item(count, code) for count, code in ITEM.findall(packed)]
    dtype = np.dtype(list(zip(definition.ordered_fieldnames, kinds, strict=True)))
    return Layout(definition.msgname, dtype, tuple(definition.fieldnames))


def _item(count: str, code: str) -> np.dtype[np.generic]:
    """numpy type of one field: `4` and `f` -> four floats, `16` and `s` -> text of 16 bytes."""
    if code == "s":
        return np.dtype(f"S{count or 1}")
    one = np.dtype(f"<{code}")
    return np.dtype((one, (int(count),))) if count else one


Bytes = NDArray[np.uint8]
Index = int | np.integer[Any]  # what compiled code counts with
U = np.uint64

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
HEADER_1, HEADER_2 = 6, 10
CHECKSUM, SIGNATURE = 2, 13
SIGNED = 0x01  # the only incompatibility flag that MAVLink defines
STAMP = 8
SHORTEST_RECORD = STAMP + HEADER_1 + CHECKSUM
HEAD = STAMP + 3  # stamp, magic, length and one byte more: a shorter rest is a tail cut off

NO_FRAME, GOOD, BAD_CHECKSUM, UNKNOWN, CUT = 0, 1, 2, 3, 4


class Tally(IntEnum):
    """Columns of the counts that a walk returns."""

    BAD_CHECKSUM = 0
    UNKNOWN = 1
    JUNK_BYTES = 2
    TRUNCATED_TAIL = 3


def checksum_table() -> NDArray[np.uint16]:
    """CRC-16/MCRF4XX of each byte with 0 … 7 zero bytes behind it: (8, 256)."""
    crc = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        crc = np.where(crc & 1, (crc >> 1) ^ 0x8408, crc >> 1).astype(np.uint16)
    table = np.empty((8, 256), np.uint16)
    table[0] = crc
    for k in range(1, 8):
        table[k] = (table[k - 1] >> 8) ^ crc[table[k - 1] & 0xFF]
    return table


@inlined
def checksum(data: Bytes, start: Index, end: Index, seed: Index, table: NDArray[np.uint16]) -> U:
    """Checksum of data[start:end] closed by the message's seed; eight bytes at a time."""
    # unsigned throughout: numba then leaves out the branch for negative indices
    i, stop, eight = U(start), U(end), U(8)
    crc = U(0xFFFF)
    while i + eight <= stop:
        low = (crc ^ U(data[i])) & U(0xFF)
        high = (crc >> eight) ^ U(data[i + U(1)])
        crc = U(table[U(7), low]) ^ U(table[U(6), high])
        for k in range(2, 8):
            crc ^= U(table[U(7 - k), U(data[i + U(k)])])
        i += eight
    while i < stop:
        crc = (crc >> eight) ^ U(table[U(0), (crc ^ U(data[i])) & U(0xFF)])
        i += U(1)
    return (crc >> eight) ^ U(table[U(0), (crc ^ U(seed)) & U(0xFF)])


@inlined
def examine(
    data: Bytes, at: Index, end: Index, seeds: NDArray[np.int16], table: NDArray[np.uint16]
) -> tuple[int, np.int64]:
    """Is there a frame in data[at:end], and how long is it? -> verdict, length [bytes]."""
    first = np.int64(data[at]) if at < end else 0
    if first != MAGIC_1 and first != MAGIC_2:
        return NO_FRAME, np.int64(0)
    header = HEADER_1 if first == MAGIC_1 else HEADER_2
    if at + header + CHECKSUM > end:
        return CUT, np.int64(0)
    flags = np.int64(data[at + 2]) if first == MAGIC_2 else 0
    body = at + header + np.int64(data[at + 1])
    length = body - at + CHECKSUM + (SIGNATURE if flags & SIGNED else 0)
    if at + length > end:
        return CUT, length
    number = np.int64(data[at + 5])
    if first == MAGIC_2:
        number = np.int64(data[at + 7]) + (np.int64(data[at + 8]) << 8)
        number += np.int64(data[at + 9]) << 16
    if number >= len(seeds) or seeds[number] < 0 or flags & ~SIGNED:
        return UNKNOWN, length
    expected = np.int64(data[body]) + (np.int64(data[body + 1]) << 8)
    if checksum(data, at + 1, body, seeds[number], table) != expected:
        return BAD_CHECKSUM, length
    return GOOD, length


@inlined
def record_starts(data: Bytes, at: Index) -> bool:
    """Do a credible time stamp (before the year 2112) and a magic byte stand here?"""
    if at + STAMP >= len(data) or data[at] != 0 or data[at + 1] > 0x0F:
        return False
    return data[at + STAMP] == MAGIC_1 or data[at + STAMP] == MAGIC_2


@compiled
def walk_records(
    data: Bytes, seeds: NDArray[np.int16], table: NDArray[np.uint16]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Bytes of a .tlog -> where accepted frames start (K,), and those of messages without a
    definition (L,), counts of `Tally`.
    """
    # room for as many records as these bytes can hold: growing inside the loop costs half the speed
    room = len(data) // SHORTEST_RECORD + 1
    offset, count = np.empty(room, np.int64), 0
    unread, unknown = np.empty(room, np.int64), 0
    tally = np.zeros(4, np.int64)
    at = done = np.int64(0)  # done: end of the last record that was counted
    tail = np.int64(-1)  # where a record begins that the end cuts
    while at + HEAD <= len(data):
        verdict, length = NO_FRAME, np.int64(0)
        if record_starts(data, at):
            verdict, length = examine(data, at + STAMP, len(data), seeds, table)
        end = at + STAMP + length
        if verdict == GOOD:
            offset[count] = at + STAMP
            count += 1
            tally[2] += max(at - done, 0)
            at = done = end
            tail = np.int64(-1)
            continue
        refused = verdict in (BAD_CHECKSUM, UNKNOWN)
        if refused and at >= done and (end == len(data) or record_starts(data, end)):
            if verdict == UNKNOWN:
                unread[unknown] = at + STAMP
                unknown += 1
            tally[0 if verdict == BAD_CHECKSUM else 1] += 1
            tally[2] += at - done
            done = end
            tail = np.int64(-1)
        elif verdict == CUT and at >= done and tail < 0:
            tail = at
        at += 1  # also inside a refused frame: if its length is wrong, good ones begin there
    if tail < 0:
        tail = max(at, done)
    tally[2] += tail - done
    tally[3] = tail < len(data)
    return offset[:count].copy(), unread[:unknown].copy(), tally


@compiled
def check_frames(
    data: Bytes,
    start: NDArray[np.int64],
    end: NDArray[np.int64],
    seeds: NDArray[np.int16],
    table: NDArray[np.uint16],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Stretches data[start:end] of one frame each -> which are accepted (K,), which are of messages
    without a definition (L,), counts of `Tally`.
    """
    accepted, count = np.empty(len(start), np.int64), 0
    unread, unknown = np.empty(len(start), np.int64), 0
    tally = np.zeros(4, np.int64)
    for i in range(len(start)):
        verdict, length = examine(data, start[i], end[i], seeds, table)
        if verdict == GOOD and start[i] + length == end[i]:
            accepted[count] = i
            count += 1
        elif verdict == BAD_CHECKSUM:
            tally[0] += 1
        elif verdict == UNKNOWN:
            if start[i] + length == end[i]:
                unread[unknown] = i
                unknown += 1
            tally[1] += 1
        else:
            tally[2] += end[i] - start[i]
    return accepted[:count].copy(), unread[:unknown].copy(), tally


class Headers(NamedTuple):
    """Headers of accepted frames, all (K,)."""

    offset: Ints  # of the frame in the data [bytes]
    length: NDArray[np.int32]  # of the frame [bytes]
    payload_offset: Ints
    payload_length: NDArray[np.uint8]
    message_id: NDArray[np.int32]
    sequence: NDArray[np.uint8]
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    signed: NDArray[np.bool_]
    version: NDArray[np.uint8]  # of MAVLink: 1 or 2


HEADER_TYPES = (
    "i4",
    "i8",
    "u1",
    "i4",
    "u1",
    "u1",
    "u1",
    "?",
    "u1",
)  # of `Headers`, offset excepted


def read_headers(data: Bytes, offset: Ints) -> Headers:
    """Headers of the frames at `offset` (K,)."""
    headers = Headers(offset, *(np.empty(len(offset), kind) for kind in HEADER_TYPES))
    fill_headers(data, headers)
    return headers


@compiled
def fill_headers(data: Bytes, headers: Headers) -> None:
    """Writes what stands in the data at `headers.offset` into the other arrays."""
    for i in range(len(headers.offset)):
        at = headers.offset[i]
        second = data[at] == MAGIC_2
        begin = at + (4 if second else 2)  # magic, length and in version 2 two bytes of flags
        number = np.int64(data[begin + 3])
        if second:
            number += (np.int64(data[at + 8]) << 8) + (np.int64(data[at + 9]) << 16)
        signed = second and (data[at + 2] & SIGNED) != 0
        payload = begin + (6 if second else 4)
        headers.payload_offset[i] = payload
        headers.payload_length[i] = data[at + 1]
        headers.length[i] = payload - at + np.int64(data[at + 1]) + 2 + (13 if signed else 0)
        headers.message_id[i] = number
        headers.sequence[i] = data[begin]
        headers.system[i] = data[begin + 1]
        headers.component[i] = data[begin + 2]
        headers.signed[i] = signed
        headers.version[i] = 2 if second else 1


@compiled
def read_stamps(data: Bytes, offset: Ints) -> Ints:
    """The time stamp in front of each frame: (K,) [Unix ns]."""
    stamps = np.empty(len(offset), np.int64)
    for i in range(len(offset)):
        stamp, start = U(0), U(offset[i] - 8)
        for k in range(8):
            stamp = (stamp << U(8)) | U(data[start + U(k)])
        stamps[i] = np.int64(stamp * U(1000))
    return stamps


@compiled
def group(key: NDArray[np.int32] | Ints, largest: int) -> tuple[Ints, Ints]:
    """Keys (K,) -> their stable sorting order (K,), where each key starts in it (largest + 2,)."""
    starts = np.zeros(largest + 2, np.int64)
    for number in key:
        starts[number + 1] += 1
    starts = np.cumsum(starts)
    place = starts.copy()
    order = np.empty(len(key), np.int64)
    for i in range(len(key)):
        order[place[key[i]]] = i
        place[key[i]] += 1
    return order, starts


@compiled
def gather(data: Bytes, start: Ints, length: NDArray[np.uint8], rows: Ints, size: int) -> Bytes:
    """The stretch of each of `rows` (K,), cut or filled with zeros to `size`: (K × size,)."""
    payloads = np.empty(len(rows) * size, np.uint8)
    for i in range(len(rows)):
        row = rows[i]
        source, target = start[row], i * size
        given = min(int(length[row]), size)
        # unsigned indices: numba then leaves out the branch for negative ones
        for k in range(given):
            payloads[U(target + k)] = data[U(source + k)]
        for k in range(given, size):
            payloads[U(target + k)] = 0
    return payloads
