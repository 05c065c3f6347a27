"""Columns of numbers to rows of JSON text, many times faster than one call a row.

orjson writes all numbers of a block in one call; a compiled loop then weaves the keys between
them. The text of each number is orjson's own: the shortest that reads back to the same value.

Rows of a topic to JSON text: one message for a live link, columns of them for a recording.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.jit import compiled
from gateway.topics import TIMES, TOPICS, Field, FieldType, Topic

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

OPEN, CLOSE, COMMA = ord("["), ord("]"), ord(",")


@compiled
def _copy_token(text: Bytes, at: int, out: Bytes, end: int) -> tuple[int, int]:
    """Append the next number of a JSON array to `out` -> position in text, end of `out`."""
    while text[at] == OPEN or text[at] == CLOSE or text[at] == COMMA:
        at += 1
    while text[at] != CLOSE and text[at] != COMMA:
        out[end] = text[at]
        at += 1
        end += 1
    return at, end


@compiled
def _copy_piece(pieces: Bytes, edges: Integers, which: int, out: Bytes, end: int) -> int:
    """Append piece number `which` of a joined text to `out` -> end of `out`."""
    for i in range(edges[which], edges[which + 1]):
        out[end] = pieces[i]
        end += 1
    return end


@compiled
def _weave(
    integers: Bytes,
    numbers: Bytes,
    keys: Bytes,
    key_edges: Integers,
    tails: Bytes,
    tail_edges: Integers,
    tail_of_row: Integers,
    whole: int,
    out: Bytes,
) -> Integers:
    """Write every row into `out` -> (K + 1,) where each row starts and ends.

    The first `whole` keys of a row take their value from `integers`, the others from `numbers`.
    """
    rows = len(tail_of_row)
    edges = np.zeros(rows + 1, np.int64)
    in_integers, in_numbers, end = 0, 0, 0
    for row in range(rows):
        for key in range(len(key_edges) - 1):
            end = _copy_piece(keys, key_edges, key, out, end)
            if key < whole:
                in_integers, end = _copy_token(integers, in_integers, out, end)
            else:
                in_numbers, end = _copy_token(numbers, in_numbers, out, end)
        end = _copy_piece(tails, tail_edges, tail_of_row[row], out, end)
        edges[row + 1] = end
    return edges


def _joined(pieces: Sequence[bytes]) -> tuple[Bytes, Integers]:
    """Pieces of text -> one text, and where each starts and ends."""
    edges = np.cumsum([0, *(len(piece) for piece in pieces)])
    return np.frombuffer(b"".join(pieces), np.uint8), edges.astype(np.int64)


def _text(array: NDArray[Any]) -> Bytes:
    """A two-dimensional array -> its JSON text."""
    packed = np.ascontiguousarray(array)
    return np.frombuffer(orjson.dumps(packed, option=orjson.OPT_SERIALIZE_NUMPY), np.uint8)


def json_rows(
    names: Sequence[str],
    integers: Integers,
    numbers: NDArray[np.float64],
    tails: Sequence[bytes],
    tail_of_row: Integers,
) -> list[bytes]:
    """Integers (K, I) and finite numbers (K, F) -> K JSON objects with the keys `names` (I + F).

    `tails[tail_of_row[k]]` closes row k: `}`, or further members as `,"key":"value"}`.
    """
    if len(numbers) == 0:
        return []
    quoted = [orjson.dumps(name) + b":" for name in names]
    keys = [b"{" + quoted[0], *(b"," + name for name in quoted[1:])]
    key_text, key_edges = _joined(keys)
    tail_text, tail_edges = _joined(tails)
    integer_text, number_text = _text(integers), _text(numbers)
    longest_tail = max(len(tail) for tail in tails)
    room = len(integer_text) + len(number_text) + len(numbers) * (len(key_text) + longest_tail)
    out = np.empty(room, np.uint8)
    edges = _weave(
        integer_text,
        number_text,
        key_text,
        key_edges,
        tail_text,
        tail_edges,
        tail_of_row,
        integers.shape[1],
        out,
    )
    text = out[: edges[-1]].tobytes()
    return [text[start:end] for start, end in pairwise(edges.tolist())]


Value = float | int | str
Text = str | Sequence[str]
FEW = 8  # rows up to which a call per row beats columns: a live link gives one at a time


class Rows(NamedTuple):
    """Encoded messages of one topic with their two times (K,) [ns]."""

    topic: str
    vehicle_time_ns: NDArray[np.int64]
    receive_time_ns: NDArray[np.int64]
    payloads: list[bytes]


class _Plan(NamedTuple):
    """What `encode` needs of a topic, looked up once."""

    names: tuple[str, ...]
    known: frozenset[str]
    numbers: tuple[str, ...]
    integers: tuple[str, ...]
    strings: tuple[Field, ...]


@cache
def _plan(topic: str) -> _Plan:
    fields = TOPICS[topic].all_fields
    names = tuple(field.name for field in fields)
    return _Plan(
        names,
        frozenset(names),
        tuple(field.name for field in fields if field.type is FieldType.NUMBER),
        tuple(field.name for field in fields if field.type is FieldType.INTEGER),
        tuple(field for field in fields if field.type is FieldType.STRING),
    )


def _refuse_text(topic: str, field: Field, value: Value) -> None:
    """Raise where a string is none, or none of those allowed."""
    if not isinstance(value, str) or (field.choices and value not in field.choices):
        allowed = f"one of {', '.join(field.choices)}" if field.choices else "a string"
        raise ValueError(f"topic {topic}: {field.name} is {value!r}, expected {allowed}")


def encode(topic: str, row: Mapping[str, Value]) -> bytes | None:
    """One message as JSON, or None where a number is not finite: the message is withheld.

    A field that is missing, unknown or of another type raises ValueError: the caller's mistake.
    """
    plan = _plan(topic)
    if row.keys() != plan.known:
        odd = ", ".join(sorted(row.keys() ^ plan.known))
        raise ValueError(f"topic {topic}: missing or unknown fields: {odd}")
    for name in plan.integers:
        if not isinstance(row[name], int | np.integer):
            raise ValueError(f"topic {topic}: {name} is {row[name]!r}, expected an integer")
    for field in plan.strings:
        _refuse_text(topic, field, row[field.name])
    if not all([math.isfinite(row[name]) for name in plan.numbers]):  # type: ignore[arg-type]  # noqa: C419
        return None
    message = {name: row[name] for name in plan.names}
    return orjson.dumps(message, option=orjson.OPT_SERIALIZE_NUMPY)


@lru_cache(maxsize=256)
def _tail(topic: str, values: tuple[str, ...]) -> bytes:
    """The string members that close a row: `,"source":"measured"}`."""
    fields = _plan(topic).strings
    for field, value in zip(fields, values, strict=True):
        _refuse_text(topic, field, value)
    members = [
        b"," + orjson.dumps(field.name) + b":" + orjson.dumps(value)
        for field, value in zip(fields, values, strict=True)
    ]
    return b"".join(members) + b"}"


def _tails(
    topic: Topic, strings: Mapping[str, Text], rows: int
) -> tuple[list[bytes], NDArray[np.int64]]:
    """The closing texts that occur, and which of them each row has: (rows,)."""
    names = [field.name for field in _plan(topic.name).strings]
    if strings.keys() != set(names):
        raise ValueError(f"topic {topic.name}: strings {sorted(strings)}, expected {names}")
    if all([isinstance(text, str) for text in strings.values()]):  # noqa: C419
        only = _tail(topic.name, tuple([str(strings[name]) for name in names]))
        return [only], np.zeros(rows, np.int64)
    columns = [[text] * rows if isinstance(text := strings[name], str) else text for name in names]
    combinations = list(zip(*columns, strict=True))
    if len(combinations) != rows:
        raise ValueError(f"topic {topic.name}: {len(combinations)} strings for {rows} rows")
    distinct = {combination: i for i, combination in enumerate(dict.fromkeys(combinations))}
    tails = [_tail(topic.name, combination) for combination in distinct]
    return tails, np.array([distinct[combination] for combination in combinations], np.int64)


def _line(
    names: Sequence[str], times: Sequence[int], values: Sequence[float], tail: bytes
) -> bytes:
    """One message: the same bytes as `json_rows` gives."""
    return orjson.dumps(dict(zip(names, [*times, *values], strict=True)))[:-1] + tail


def encode_rows(
    topic: str,
    vehicle_time_ns: NDArray[np.int64],
    receive_time_ns: NDArray[np.int64],
    values: NDArray[np.float64],
    strings: Mapping[str, Text] | None = None,
) -> Rows:
    """Many messages of a topic without integer fields: times (K,), numbers (K, F) -> the encoded.

    Columns of `values` are the topic's numbers in their order; a string field is one value for
    all rows or K of them. Rows with a number that is not finite are withheld: left out.
    """
    plan = _plan(topic)
    if len(plan.integers) > len(TIMES) or values.shape[1:] != (len(plan.numbers),):
        raise ValueError(f"topic {topic}: values {values.shape}, expected (K, {len(plan.numbers)})")
    tails, tail_of_row = _tails(TOPICS[topic], strings or {}, len(values))
    complete = np.isfinite(values)
    if not complete.all():
        whole = complete.all(axis=1)
        vehicle_time_ns, receive_time_ns = vehicle_time_ns[whole], receive_time_ns[whole]
        values, tail_of_row = values[whole], tail_of_row[whole]
    names = plan.names[: len(TIMES) + len(plan.numbers)]
    if len(values) > FEW:
        times = np.column_stack([vehicle_time_ns, receive_time_ns])
        payloads = json_rows(names, times, values, tails, tail_of_row)
    else:
        both = zip(vehicle_time_ns.tolist(), receive_time_ns.tolist(), strict=True)
        rows = zip(both, values.tolist(), tail_of_row, strict=True)
        payloads = [_line(names, time, row, tails[tail]) for time, row, tail in rows]
    return Rows(topic, vehicle_time_ns, receive_time_ns, payloads)
