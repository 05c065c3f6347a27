"""Finds DataFlash messages in bytes that may be damaged: compiled.

A message is two magic bytes, its type and as many bytes as the FMT record of that type said. There
is no checksum. A message is accepted where another one or the end follows it. Where something else
follows, it is refused if it stands behind junk, or if another message begins inside it: that is
where bytes were lost.

All compiled functions stand in this one file: numba's cache does not notice changes elsewhere.

DataFlash messages as the log's own FMT records define them.

FMT: type (1 byte), length of the whole message (1), name (4), one format character per column
(16), column names separated by commas (64). Characters as ArduPilot's LogStructure.h lists them;
a test compares them with pymavlink's.
"""

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.ingest.log import column, frozen
from sim.kernel.compiled import compiled, inlined
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


FMT_RECORD = np.dtype([("f0", "u1"), ("f1", "u1"), ("f2", "S4"), ("f3", "S16"), ("f4", "S64")])
KINDS = {
    "a": np.dtype(("<i2", (32,))),
    "b": np.dtype("i1"),
    "B": np.dtype("u1"),
    "h": np.dtype("<i2"),
    "H": np.dtype("<u2"),
    "i": np.dtype("<i4"),
    "I": np.dtype("<u4"),
    "q": np.dtype("<i8"),
    "Q": np.dtype("<u8"),
    "g": np.dtype("<f2"),
    "f": np.dtype("<f4"),
    "d": np.dtype("<f8"),
    "n": np.dtype("S4"),
    "N": np.dtype("S16"),
    "Z": np.dtype("S64"),
    "c": np.dtype("<i2"),
    "C": np.dtype("<u2"),
    "e": np.dtype("<i4"),
    "E": np.dtype("<u4"),
    "L": np.dtype("<i4"),
    "M": np.dtype("i1"),
}
# a division by these is exact where a product with 0.01 or 1e-7 is not
DIVISORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


class Format(NamedTuple):
    """One message of the log: fields of `dtype` are numbered, `names` names them."""

    type: int
    name: str
    characters: str
    names: tuple[str, ...]
    dtype: np.dtype[np.void]

    @property
    def clock(self) -> str:
        """The first column where it is the autopilot's clock, else nothing."""
        first = self.names[0] if self.names else ""
        whole = self.characters[:1] in ("Q", "I")
        # the TimeMS of ACC and GYR is that of the sensor
        own = first == "TimeUS" or (first == "TimeMS" and self.name[:3] not in ("ACC", "GYR"))
        return first if own and whole else ""


def sizes() -> NDArray[np.int64]:
    """Size of each format character by its code, 0 for what is none: (256,) [bytes]."""
    table = np.zeros(256, np.int64)
    for character, kind in KINDS.items():
        table[ord(character)] = kind.itemsize
    return table


def fmt_itself() -> Format:
    """The format of FMT records, which need not be in the log."""
    names = ("Type", "Length", "Name", "Format", "Columns")
    return Format(FMT_TYPE, "FMT", "BBnNZ", names, FMT_RECORD)


def formats(records: NDArray[np.void]) -> dict[int, Format]:
    """FMT records (K,) -> type -> format; where a type comes twice, the first.

    A second type of the same name is told apart by its number: `NAME#17`.
    """
    found, names = {FMT_TYPE: fmt_itself()}, {"FMT"}
    for record in records:
        number, length, name, characters, columns = record.item()
        made = _format(number, name, characters, columns)
        if made and number not in found and made.dtype.itemsize + HEADER == length:
            found[number] = made
            if made.name in names:
                found[number] = made._replace(name=f"{made.name}#{number}")
            names.add(made.name)
    return found


def decoded(records: NDArray[np.void], layout: Format) -> dict[str, NDArray[np.generic]]:
    """Messages (K,) of one format -> column name -> values in the unit that the log gives them."""
    return {
        name: frozen(_values(records[f"f{k}"], layout, k)) for k, name in enumerate(layout.names)
    }


def _values(raw: NDArray[Any], layout: Format, k: int) -> NDArray[np.generic]:
    character = layout.characters[k]
    if character in DIVISORS:
        return np.asarray(raw / DIVISORS[character])
    if layout.name == "FILE" and character == "Z":
        return np.ascontiguousarray(raw)  # contents of a file: bytes, not text
    return column(raw)


def _format(number: int, name: bytes, characters: bytes, columns: bytes) -> Format | None:
    codes = _word(characters)
    if not codes or not set(codes) <= set(KINDS):
        return None
    dtype = np.dtype([(f"f{k}", KINDS[code]) for k, code in enumerate(codes)])
    names = tuple(_word(columns).split(",")) if _word(columns) else ()
    return Format(number, _word(name), codes, names[: len(codes)], dtype)


def _word(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("ascii", errors="backslashreplace")
