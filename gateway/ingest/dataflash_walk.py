"""Finds DataFlash messages in bytes that may be damaged: compiled.

A message is two magic bytes, its type and as many bytes as the FMT record of that type said. There
is no checksum. A message is accepted where another one or the end follows it. Where something else
follows, it is refused if it stands behind junk, or if another message begins inside it: that is
where bytes were lost.

All compiled functions stand in this one file: numba's cache does not notice changes elsewhere.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from gateway.jit import compiled, inlined
from sim.state import Ints

Bytes = NDArray[np.uint8]
U = np.uint64

MAGIC_A, MAGIC_B = 0xA3, 0x95
HEADER = 3
FMT_TYPE, FMT_LENGTH = 0x80, 89
FMT_FORMAT, FMT_COLUMNS = 9, 25  # where the format characters begin and end in an FMT record
SHORTEST = HEADER + 1


class Tally(IntEnum):
    """Columns of the counts that the walk returns."""

    UNKNOWN = 0
    JUNK_BYTES = 1
    TRUNCATED_TAIL = 2
    GARBLED = 3


@inlined
def starts(data: Bytes, at: int, lengths: Ints) -> bool:
    """Does a message of known type begin here?"""
    if at + HEADER > len(data):
        return False
    i = U(at)
    magic = data[i] == MAGIC_A and data[i + U(1)] == MAGIC_B
    return magic and lengths[U(data[i + U(2)])] > 0


@compiled
def hides_another(data: Bytes, at: int, end: int, lengths: Ints) -> bool:
    """Does a message begin inside data[at:end] that another one follows?"""
    for k in range(at + 1, end):
        if starts(data, k, lengths):
            behind = k + lengths[data[k + 2]]
            if behind == len(data) or starts(data, behind, lengths):
                return True
    return False


@compiled
def defines(data: Bytes, at: int, sizes: Ints) -> int:
    """The FMT record at `at` -> length of the messages it defines, 0 if it contradicts itself."""
    length = HEADER
    for k in range(at + FMT_FORMAT, at + FMT_COLUMNS):
        if data[k] == 0:
            break
        if sizes[data[k]] == 0:
            return 0
        length += sizes[data[k]]
    return length if length == data[at + 4] and length >= SHORTEST else 0


@compiled
def walk_messages(data: Bytes, sizes: Ints) -> tuple[Ints, Ints, Ints]:
    """Bytes -> where messages start (K,), their types (K,), counts of `Tally`."""
    # room for as many messages as these bytes can hold
    offset = np.empty(len(data) // SHORTEST + 1, np.int64)
    kind = np.empty(len(data) // SHORTEST + 1, np.int64)
    lengths, count = np.zeros(256, np.int64), 0
    lengths[FMT_TYPE] = FMT_LENGTH
    tally = np.zeros(4, np.int64)
    at, done, tail = 0, 0, -1
    while at + HEADER <= len(data):
        if not starts(data, at, lengths):
            if at == done and data[at] == MAGIC_A and data[at + 1] == MAGIC_B:
                tally[0] += 1
            at += 1
            continue
        number = np.int64(data[at + 2])
        end = at + lengths[number]
        if end > len(data):
            tail = at if tail < 0 else tail
            at += 1
            continue
        followed = end == len(data) or starts(data, end, lengths)
        # after junk, a message must be followed by another one to be believed
        if not followed and (at != done or hides_another(data, at, end, lengths)):
            tally[3] += at == done
            at += 1
            continue
        if number == FMT_TYPE and lengths[data[at + 3]] == 0:  # the first definition holds
            lengths[data[at + 3]] = defines(data, at, sizes)
        offset[count], kind[count] = at, number
        count += 1
        tally[1] += at - done
        at, done, tail = end, end, -1
    if tail < 0:
        tail = len(data)
    tally[1] += tail - done
    tally[2] = tail < len(data)
    return offset[:count].copy(), kind[:count].copy(), tally
