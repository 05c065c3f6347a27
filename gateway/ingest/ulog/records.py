"""The messages of a ULog one after another: what each holds, and the way back in behind damage.

    header (16 bytes), then messages: uint16 size, uint8 kind, `size` bytes

A message is taken where its content is what its kind demands: data of the size that its format
has, a parameter whose value fits its type, and so on. Where one is not, the next two in a row that
are end the damage; ULogs have no checksum, and logs without sync messages are read all the same.
A message behind `appended_offsets` (what the autopilot adds after a crash) follows the last whole
one before it.

Source: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import re
import struct
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.state import Ints

MAGIC = b"ULog\x01\x12\x35"
HEADER = 16  # magic, version, start of the log [µs]
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
HEAD = struct.Struct("<HB")
KINDS = b"FIMPQALCDSROB"
DATA = ord("D")
APPENDED = 1  # bit of the incompatible flags: the only one that is known
LARGEST = 0xFFFF  # bytes of one message
DEEPEST, MOST_FIELDS = 8, 4000  # formats inside formats; fields of one topic, arrays as one
TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "<i2", "uint16_t": "<u2", "int32_t": "<i4",
    "uint32_t": "<u4", "int64_t": "<i8", "uint64_t": "<u8", "float": "<f4", "double": "<f8",
    "bool": "i1", "char": "S1",
}  # fmt: skip
FORMAT = re.compile(rb"([\w/.-]+):((?:\w+(?:\[\d+\])? \w+;)+)")
FIELD = re.compile(rb"(\w+)(?:\[(\d+)\])? (\w+);")
KEY = re.compile(rb"([A-Za-z]\w*)(?:\[(\d+)\])? ([!-~]+)")
WORDS = re.compile(rb"[^\x00-\x08\x0e-\x1f]*\x00*")
CANDIDATE = re.compile(rb"[" + KINDS + rb"]")


class Told(NamedTuple):
    """A parameter or an information; place: how many rows stand before it, −1 in the head."""

    place: int
    name: str
    value: float | str | bytes


class Said(NamedTuple):
    """A text of the autopilot: its place among the rows, µs since boot, 0 (worst) … 7."""

    place: int
    time_us: int
    level: int
    text: str


class Damage(NamedTuple):
    """Bytes that were no message, and how many rows stand before them."""

    place: int
    size: int


@dataclass
class Series:
    """Rows of one instance of a topic: where they lie in the file, and their places (K,)."""

    topic: str
    instance: int
    layout: np.dtype[np.void]
    least: int  # bytes of a row without the padding at its end …
    most: int  # … and with it
    offset: "array[int]" = field(default_factory=lambda: array("q"))
    place: "array[int]" = field(default_factory=lambda: array("q"))

    def rows(self, raw: bytes) -> NDArray[np.void]:
        """All of them, packed as they lie in the log: (K,)."""
        size = self.layout.itemsize
        shape = (max(len(raw) - size + 1, 0),)
        stretches = np.ndarray(shape, f"V{size}", raw, strides=(1,))
        return stretches[np.asarray(self.offset, np.int64)].view(self.layout)

    def places(self) -> Ints:
        """(K,)"""
        return np.asarray(self.place, np.int64)


@dataclass
class Records:
    """All that a ULog holds, in its order."""

    series: list[Series] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    parameters: list[Told] = field(default_factory=list)
    infos: dict[str, float | str | bytes] = field(default_factory=dict)
    lost_ms: list[int] = field(default_factory=list)  # dropouts, by the logger's own word
    damage: list[Damage] = field(default_factory=list)
    unknown: int = 0  # messages of kinds that this reader does not know
    truncated: bool = False


def read_records(raw: bytes) -> Records:
    """A whole file -> its content; ValueError in words where it is none that can be read."""
    if len(raw) < HEADER:
        raise ValueError("it ends inside its header")
    if not raw.startswith(MAGIC):
        raise ValueError("its header is damaged")
    reader = _Reader(raw)
    reader.read()
    return reader.found


class _Reader:
    def __init__(self, raw: bytes) -> None:
        self.raw, self.found = raw, Records()
        self.count = 0  # rows so far
        self.formats: dict[bytes, bytes] = {}
        self.layouts: dict[bytes, tuple[np.dtype[np.void], int, int] | None] = {}
        self.open: dict[int, Series] = {}  # number in the file -> the series that it adds to
        self.appended: list[int] = []
        self.take: Mapping[int, Callable[[int, int], None]] = {
            ord("F"): self._format, ord("A"): self._series, ord("B"): self._flags,
            ord("P"): self._parameter, ord("I"): self._info, ord("O"): self._dropout,
            ord("L"): self._text, ord("C"): self._tagged_text, DATA: self._row,
        }  # fmt: skip

    def read(self) -> None:
        size, kind = HEAD.unpack_from(self.raw.ljust(HEADER + HEAD.size, b"\0"), HEADER)
        if kind == ord("B") and size >= 40 and HEADER + HEAD.size + size <= len(self.raw):
            self._flags(HEADER + HEAD.size, HEADER + HEAD.size + size)
        at, end = HEADER, len(self.raw)
        for start in [one for one in sorted(self.appended) if HEADER < one < end]:
            self._read_to(at, start)
            at = start
        self.found.truncated = self._read_to(at, end) < end

    def _read_to(self, at: int, stop: int) -> int:
        """Messages from `at` on, none of which crosses `stop` -> where the last one ends."""
        raw, unpack, head = self.raw, HEAD.unpack_from, HEAD.size
        while at + head <= stop:
            size, kind = unpack(raw, at)
            start, end = at + head, at + head + size
            if end <= stop and self._valid(kind, start, end):
                if (take := self.take.get(kind)) is not None:
                    take(start, end)
            elif raw.startswith(MAGIC, at):  # another log stands behind this one
                end = at + HEADER
            elif end < stop and size and self._begins(end, stop):  # this one alone is wrong
                self._skip(kind, size + head)
            else:
                next_at = self._behind_damage(at, stop)
                if next_at is None:
                    if kind in KINDS and end > stop:
                        return at  # cut
                    self.found.damage.append(Damage(self.count, stop - at))
                    return stop
                self.found.damage.append(Damage(self.count, next_at - at))
                end = next_at
            at = end
        return at

    def _skip(self, kind: int, size: int) -> None:
        if kind in KINDS or not chr(kind).isalpha():
            self.found.damage.append(Damage(self.count, size))
        else:
            self.found.unknown += 1

    def _behind_damage(self, at: int, stop: int) -> int | None:
        """Where the next two messages in a row begin; None where none do."""
        for match in CANDIDATE.finditer(self.raw, at + HEAD.size, stop):
            place = match.start() - HEAD.size + 1
            end = self._begins(place, stop)
            if end and (end == stop or self._begins(end, stop)):
                return place
        return None

    def _begins(self, at: int, stop: int) -> int:
        """Where the message ends that begins here; 0 where none does."""
        if at + HEAD.size > stop:
            return 0
        size, kind = HEAD.unpack_from(self.raw, at)
        start, end = at + HEAD.size, at + HEAD.size + size
        return end if end <= stop and self._valid(kind, start, end) else 0

    def _valid(self, kind: int, start: int, end: int) -> bool:
        """Whether these bytes are what a message of that kind holds."""
        raw, size = self.raw, end - start
        if kind == DATA:
            series = self.open.get(raw[start] | raw[start + 1] << 8) if size > 1 else None
            return series is not None and series.least <= size - 2 <= series.most
        if kind in b"PIQM":
            return self._keyed(start + (kind in b"QM"), end) is not None
        if kind == ord("F"):
            return FORMAT.fullmatch(raw, start, end) is not None
        if kind == ord("A"):
            return size > 3 and self._layout(raw[start + 3 : end]) is not None
        if kind in b"LC":
            words = start + (9 if kind == ord("L") else 11)
            known = words <= end and raw[start] in b"01234567"
            return known and WORDS.fullmatch(raw, words, end) is not None
        if kind == ord("S"):
            return raw[start:end] == SYNC
        return size == 2 if kind in b"RO" else kind == ord("B") and size >= 40

    def _row(self, start: int, end: int) -> None:
        series = self.open[self.raw[start] | self.raw[start + 1] << 8]
        series.offset.append(start + 2)
        series.place.append(self.count)
        self.count += 1

    def _flags(self, start: int, end: int) -> None:
        flags = self.raw[start + 8 : start + 16]
        if any(flags[1:]) or flags[0] & ~APPENDED:
            raise ValueError("it has a flag that is not known: its content would be misread")
        if flags[0]:
            self.appended = list(struct.unpack_from("<3Q", self.raw, start + 16))

    def _format(self, start: int, end: int) -> None:
        name, _, fields = self.raw[start:end].partition(b":")
        self.formats[name] = fields
        self.layouts.clear()

    def _series(self, start: int, end: int) -> None:
        number = self.raw[start + 1] | self.raw[start + 2] << 8
        name = self.raw[start + 3 : end]
        layout = self._layout(name)
        assert layout is not None
        topic = name.decode("utf-8", "replace")
        self.open[number] = Series(topic, self.raw[start], *layout)
        self.found.series.append(self.open[number])

    def _layout(self, name: bytes) -> tuple[np.dtype[np.void], int, int] | None:
        """Fields of a topic, its least and its largest size; None where no format says them."""
        if name not in self.layouts:
            self.layouts[name] = self._new_layout(name)
        return self.layouts[name]

    def _new_layout(self, name: bytes) -> tuple[np.dtype[np.void], int, int] | None:
        try:
            fields = self._fields(name, b"", 0, DEEPEST)
        except (KeyError, ValueError):
            return None
        most = fields[-1][3]
        while fields and fields[-1][0].startswith(b"_padding"):  # may be left out by the logger
            fields.pop()
        kept = [one for one in fields if b"_padding" not in one[0]]
        if not kept or len({one[0] for one in kept}) < len(kept):
            return None
        layout = np.dtype(
            {
                "names": [one[0].decode() for one in kept],
                "formats": [one[1] for one in kept],
                "offsets": [one[2] for one in kept],
                "itemsize": fields[-1][3],
            }
        )
        return layout, fields[-1][3], most

    def _fields(
        self, name: bytes, prefix: bytes, at: int, deeper: int
    ) -> list[tuple[bytes, str, int, int]]:
        """Name, type, start and end of each field of a format, those of formats inside it flat."""
        found = list[tuple[bytes, str, int, int]]()
        for kind, digits, field_name in FIELD.findall(self.formats[name]):
            count = int(digits or 1)
            if not 0 < count <= LARGEST or at > LARGEST or len(found) > MOST_FIELDS or not deeper:
                raise ValueError("no message is so large")
            basic = TYPES.get(kind.decode())
            if basic is not None:
                one = np.dtype(basic).itemsize
                shape = f"S{count}" if basic == "S1" else f"({count},){basic}" if digits else basic
                found.append((prefix + field_name, shape, at, at + one * count))
                at = found[-1][3]
                continue
            for k in range(count):
                inner = prefix + field_name + (b"[%d]." % k if digits else b".")
                found += self._fields(kind, inner, at, deeper - 1)
                at = found[-1][3]
        if not found or at > LARGEST:
            raise ValueError("a format without fields")
        return found

    def _keyed(self, start: int, end: int) -> tuple[str, bytes | None, int, int] | None:
        """Name, type, start of the value and its count; None where the bytes are no such thing."""
        if start >= end or start + 1 + self.raw[start] > end:
            return None
        value_at = start + 1 + self.raw[start]
        match = KEY.fullmatch(self.raw, start + 1, value_at)
        if match is None:
            return None
        kind, digits, name = match.groups()
        basic = TYPES.get(kind.decode())
        count = int(digits or 1)
        if basic is not None and end - value_at != np.dtype(basic).itemsize * count:
            return None
        return name.decode(), kind, value_at, -1 if basic is None or digits else 1

    def _value(self, start: int, end: int) -> tuple[str, float | str | bytes]:
        found = self._keyed(start, end)
        assert found is not None
        name, kind, at, count = found
        if kind == b"char":
            return name, self.raw[at:end].decode("utf-8", "replace").rstrip("\0")
        if kind is None or count != 1:
            return name, self.raw[at:end]
        return name, np.frombuffer(self.raw, TYPES[kind.decode()], 1, at)[0].item()

    def _parameter(self, start: int, end: int) -> None:
        in_head = not self.open
        self.found.parameters.append(Told(-1 if in_head else self.count, *self._value(start, end)))

    def _info(self, start: int, end: int) -> None:
        name, value = self._value(start, end)
        self.found.infos[name] = value

    def _dropout(self, start: int, end: int) -> None:
        self.found.lost_ms.append(int.from_bytes(self.raw[start:end], "little"))

    def _text(self, start: int, end: int) -> None:
        self._say(start, start + 1, end)

    def _tagged_text(self, start: int, end: int) -> None:
        self._say(start, start + 3, end)

    def _say(self, start: int, time_at: int, end: int) -> None:
        time_us = int.from_bytes(self.raw[time_at : time_at + 8], "little")
        text = self.raw[time_at + 8 : end].decode("utf-8", "replace").strip("\0 \n")
        level = self.raw[start] - ord("0")
        self.found.said.append(Said(self.count, time_us, level, text))
        self.count += 1
