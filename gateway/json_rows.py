"""Rows of a topic to JSON text: single messages, and columns of many.

msgspec takes 1.2 µs for a row of 18 numbers, whether one comes at a time or a chunk of hundreds.
orjson takes 1.9 µs; a compiled loop that wove keys into orjson's text of whole columns took 1.3 µs
in large chunks and 15 µs for a single row (numpy columns included, one core of a laptop).

Both libraries write the shortest text that reads back as the same number. They differ from 1e16 on,
which msgspec writes as 1e16 and orjson as 1e+16: such rows go through orjson, so that every message
of a recording is written in one way.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from itertools import starmap
from typing import Any, NamedTuple, Self

import msgspec
import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.topics import TIMES, Field, FieldType, topic_of

Value = float | int | str
Text = str | Sequence[str]
EXPONENT_FROM = 1e16  # numbers from here on are written with an exponent

_encode = msgspec.json.Encoder().encode


class Columns(NamedTuple):
    """The members of a topic's messages beside their times, in the topic's order."""

    values: NDArray[np.float64]  # (K, F) numbers, all finite
    strings: list[Sequence[str]]  # one (K,) for each string member


class TopicRows:
    """Messages of one topic with their two times (K,) [ns].

    They are given as payloads, or as columns that are encoded when their payloads are first read:
    what nobody listens to and nothing records is not encoded.
    """

    __slots__ = ("_columns", "_payloads", "receive_time_ns", "topic", "vehicle_time_ns")

    def __init__(
        self,
        topic: str,
        vehicle_time_ns: NDArray[np.int64],
        receive_time_ns: NDArray[np.int64],
        messages: list[bytes] | Columns,
    ) -> None:
        self.topic = topic
        self.vehicle_time_ns, self.receive_time_ns = vehicle_time_ns, receive_time_ns
        self._columns = messages if isinstance(messages, Columns) else None
        self._payloads = None if isinstance(messages, Columns) else messages

    def __len__(self) -> int:
        return len(self.receive_time_ns)

    @property
    def payloads(self) -> list[bytes]:
        """The messages as JSON (K)."""
        if self._payloads is None:
            assert self._columns is not None
            self._payloads = _encoded(self, self._columns)
        return self._payloads

    def last(self) -> bytes:
        """The last message; the others are not encoded for it."""
        newest = self if self._payloads is not None else self.chosen([len(self) - 1])
        return newest.payloads[-1]

    def messages(self) -> list[dict[str, Any]]:
        """The messages as objects (K): the names of their members -> what they hold."""
        if self._columns is None:
            return [orjson.loads(payload) for payload in self.payloads]
        names = _layout(self.topic).names
        return [dict(zip(names, row, strict=True)) for row in _members(self, self._columns)]

    @classmethod
    def joined(cls, parts: Sequence["TopicRows"]) -> Self:
        """Messages of one topic, one part after another; encoded where all of them are."""
        times = (
            np.concatenate([part.vehicle_time_ns for part in parts]),
            np.concatenate([part.receive_time_ns for part in parts]),
        )
        columns = [part._columns for part in parts if part._columns is not None]
        encoded = all(part._payloads is not None for part in parts)
        payloads = [payload for part in parts for payload in part.payloads] if encoded else None
        if len(columns) < len(parts):
            every = payloads or [payload for part in parts for payload in part.payloads]
            return cls(parts[0].topic, *times, every)
        strings: list[Sequence[str]] = []
        for column in zip(*(one.strings for one in columns), strict=True):
            strings.append([text for part in column for text in part])
        values = np.concatenate([one.values for one in columns])
        found = cls(parts[0].topic, *times, Columns(values, strings))
        found._payloads = payloads
        return found

    def chosen(self, rows: Sequence[int]) -> Self:
        """Some of the messages."""
        times = self.vehicle_time_ns[rows], self.receive_time_ns[rows]
        if self._columns is None:
            return type(self)(self.topic, *times, [self.payloads[k] for k in rows])
        values, strings = self._columns
        picked: list[Sequence[str]] = [[column[k] for k in rows] for column in strings]
        return type(self)(self.topic, *times, Columns(values[rows], picked))

    def rounded(self) -> Self:
        """The same with numbers as fine as their units deserve (`DECIMALS`), not encoded yet.

        For topics without integers beside the times.
        """
        layout, columns = _layout(self.topic), self._columns
        if columns is None:
            found = self.messages()
            rows = [[one[name] for name in layout.numbers] for one in found]
            values = np.array(rows, float).reshape(len(found), len(layout.numbers))
            strings: list[Sequence[str]] = []
            for field in layout.strings:
                strings.append([one[field.name] for one in found])
            columns = Columns(values, strings)
        scale = _scales(self.topic)
        values = np.rint(columns.values * scale) / scale + 0.0  # + 0.0: no −0
        times = self.vehicle_time_ns, self.receive_time_ns
        return type(self)(self.topic, *times, columns._replace(values=values))


# Decimals that a rounded message keeps, by unit: a tenth to a hundredth of what the best
# instruments of a boat resolve (a millimetre of position, a hundredth of a newton).
DECIMALS = {"m": 3, "m/s": 4, "m/s²": 4, "rad": 5, "rad/s": 5, "rad/s²": 5, "N": 2, "N m": 2,
            "°": 8}  # fmt: skip


@cache
def _scales(topic: str) -> NDArray[np.float64]:
    """10 to the decimals of each number of a topic (F,)."""
    fields = [f for f in topic_of(topic).fields if f.type is FieldType.NUMBER]
    return np.array([10.0 ** DECIMALS[field.unit] for field in fields])


class _Layout(NamedTuple):
    """The members of a topic's messages; `message` makes an object of them that msgspec encodes."""

    names: tuple[str, ...]
    numbers: tuple[str, ...]
    integers: tuple[str, ...]
    strings: tuple[Field, ...]
    string_names: frozenset[str]
    message: type[msgspec.Struct]
    row_shape: tuple[int] | None  # of the numbers; None: integers stand beside the times


@cache
def _layout(topic: str) -> _Layout:
    fields = topic_of(topic).all_fields
    names = tuple(field.name for field in fields)
    numbers = tuple(field.name for field in fields if field.type is FieldType.NUMBER)
    integers = tuple(field.name for field in fields if field.type is FieldType.INTEGER)
    return _Layout(
        names,
        numbers,
        integers,
        tuple(field for field in fields if field.type is FieldType.STRING),
        frozenset(field.name for field in fields if field.type is FieldType.STRING),
        msgspec.defstruct(topic.replace("/", "_"), names, gc=False),
        (len(numbers),) if len(integers) <= len(TIMES) else None,
    )


def _check_text(topic: str, field: Field, value: Value) -> None:
    """Raise ValueError where a string is none, or none of those allowed."""
    if not isinstance(value, str) or (field.choices and value not in field.choices):
        allowed = f"one of {', '.join(field.choices)}" if field.choices else "a string"
        raise ValueError(f"topic {topic}: {field.name} is {value!r}, expected {allowed}")


def encode(topic: str, row: Mapping[str, Value]) -> bytes | None:
    """One message as JSON, or None where a number is not finite: the message is withheld.

    A field that is missing, unknown or of another type raises ValueError: the caller's mistake.
    """
    layout = _layout(topic)
    if row.keys() != set(layout.names):
        odd = ", ".join(sorted(row.keys() ^ set(layout.names)))
        raise ValueError(f"topic {topic}: missing or unknown fields: {odd}")
    for name in layout.integers:
        if not isinstance(row[name], int | np.integer):
            raise ValueError(f"topic {topic}: {name} is {row[name]!r}, expected an integer")
    for field in layout.strings:
        _check_text(topic, field, row[field.name])
    if not all(math.isfinite(row[name]) for name in layout.numbers):  # type: ignore[arg-type]
        return None
    message = {name: row[name] for name in layout.names}
    return orjson.dumps(message, option=orjson.OPT_SERIALIZE_NUMPY)


@lru_cache(maxsize=256)
def _one_string(topic: str, name: str, text: str) -> tuple[str]:
    """The string of a topic that has one, of a single row: live the same few come again."""
    (column,) = _checked_columns(topic, {name: text}, 1)
    return (column[0],)


def _string_columns(topic: str, strings: Mapping[str, Text], rows: int) -> list[Sequence[str]]:
    """The string members of all rows, each (rows,), in the topic's order."""
    if not strings and not _layout(topic).strings:
        return []
    if rows == 1 and len(strings) == 1:
        ((name, text),) = strings.items()
        if isinstance(text, str):
            return [_one_string(topic, name, text)]
    return _checked_columns(topic, strings, rows)


def _checked_columns(topic: str, strings: Mapping[str, Text], rows: int) -> list[Sequence[str]]:
    layout = _layout(topic)
    if strings.keys() != layout.string_names:
        expected = sorted(layout.string_names)
        raise ValueError(f"topic {topic}: strings {sorted(strings)}, expected {expected}")
    columns: list[Sequence[str]] = []
    for field in layout.strings:
        column = strings[field.name]
        if isinstance(column, str):
            _check_text(topic, field, column)
            columns.append([column] * rows)
            continue
        if len(column) != rows:
            raise ValueError(f"topic {topic}: {len(column)} strings for {rows} rows")
        for value in set(column):
            _check_text(topic, field, value)
        columns.append(column)
    return columns


def encode_rows(
    topic: str,
    vehicle_time_ns: NDArray[np.int64],
    receive_time_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    strings: Mapping[str, Text] | None = None,
) -> TopicRows:
    """Many messages of a topic without integer fields: times (K,), numbers (K, F) -> the encoded.

    Columns of `values` are the topic's numbers in their order; a string field is one value for
    all rows or K of them. Rows with a number that is not finite are withheld: left out.
    """
    if values.shape[1:] != _layout(topic).row_shape:
        shape = f"(K, {len(_layout(topic).numbers)}), and no integers"
        raise ValueError(f"topic {topic}: values {values.shape}, expected {shape}")
    columns = _string_columns(topic, strings or {}, len(values))
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < finite.size:  # `all` takes five times as long for one row
        complete = np.flatnonzero(finite.all(axis=1))
        vehicle_time_ns, receive_time_ns = vehicle_time_ns[complete], receive_time_ns[complete]
        values = values[complete]
        columns = [[column[k] for k in complete.tolist()] for column in columns]
    return TopicRows(topic, vehicle_time_ns, receive_time_ns, Columns(values, columns))


def _members(rows: TopicRows, columns: Columns) -> Any:
    """The members of each message in the topic's order."""
    values, strings = columns
    return zip(
        rows.vehicle_time_ns.tolist(), rows.receive_time_ns.tolist(), *values.T.tolist(), *strings,
        strict=True,
    )  # fmt: skip


def _encoded(rows: TopicRows, columns: Columns) -> list[bytes]:
    """The messages as JSON."""
    layout, members = _layout(rows.topic), _members(rows, columns)
    if columns.values.size and np.abs(columns.values).max() >= EXPONENT_FROM:
        return [orjson.dumps(dict(zip(layout.names, row, strict=True))) for row in members]
    return list(map(_encode, starmap(layout.message, members)))
