"""Damage to files and packets, as a strategy of hypothesis: a few changes, anywhere.

Bytes are flipped, overwritten with numbers at the edge of their type, cut, doubled, moved and
spliced with another specimen. In texts, words and numbers are exchanged for ones that hurt.
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

from hypothesis import strategies as st

EDGES = (
    *(
        value.to_bytes(size, order)
        for size in (1, 2, 4, 8)
        for value in (0, 1, (1 << 8 * size - 1) - 1, 1 << 8 * size - 1, (1 << 8 * size) - 1)
        for order in ("little", "big")
    ),
    *(b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f", b"\x00\x00\x80\xff"),  # float: NaN, ±Infinity
)
WORDS = tuple(
    word.encode()
    for word in (
        "nan", "NaN", "inf", "-inf", "1e308", "-1e308", "1e-320", "0", "-1", "9" * 5000,
        "true", "null", '""', "[]", "{}", "[" * 3000, "{" * 3000, '"' + "x" * 4000 + '"', "\x1b[2J",
        "a.b.c = 1", "../../x", "\ufeff", "1979-05-27", "=", ",,,,", "\n\n", "1_0", "0x1p3",
    )
)  # fmt: skip
NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
KINDS = ("flip", "edge", "cut", "double", "move", "splice", "truncate", "number", "word", "insert")
TEXT_KINDS = ("number", "number", "word", "cut", "double", "splice", "insert", "truncate")


class Change(NamedTuple):
    """One change: what, where and how long as shares of the whole, and a choice of values."""

    kind: str
    place: int  # of 2**32
    length: int  # of 2**16
    choice: int


def changes(kinds: Sequence[str]) -> st.SearchStrategy[list[Change]]:
    """Between one and eight changes."""
    one = st.builds(
        Change,
        st.sampled_from(list(kinds)),
        st.integers(0, (1 << 32) - 1),
        st.integers(0, (1 << 16) - 1),
        st.integers(0, (1 << 16) - 1),
    )
    return st.lists(one, min_size=1, max_size=8)


def mutants(corpus: Sequence[bytes], text: bool) -> st.SearchStrategy[bytes]:
    """A specimen with some changes."""
    return st.builds(
        lambda k, done: changed(corpus[k], done, corpus),
        st.integers(0, len(corpus) - 1),
        changes(TEXT_KINDS if text else KINDS),
    )


def changed(data: bytes, done: Sequence[Change], corpus: Sequence[bytes]) -> bytes:
    """All changes, one after the other."""
    for change in done:
        data = _one(data, change, corpus)
    return data


def _one(data: bytes, change: Change, corpus: Sequence[bytes]) -> bytes:
    at = change.place * len(data) >> 32
    end = min(at + 1 + (change.length * min(len(data), 4096) >> 16), len(data))
    match change.kind:
        case "flip":
            return (
                data[:at]
                + bytes(b ^ 1 << change.choice % 8 for b in data[at : at + 1])
                + data[at + 1 :]
            )
        case "edge":
            value = EDGES[change.choice % len(EDGES)]
            return data[:at] + value + data[at + len(value) :]
        case "cut":
            return data[:at] + data[end:]
        case "double":
            return data[:end] + data[at:end] * (1 + change.choice % 3) + data[end:]
        case "move":
            other = change.choice * len(data) >> 16
            return data[:at] + data[other : other + end - at] + data[at:]
        case "splice":
            other = corpus[change.choice % len(corpus)]
            place = change.length * len(other) >> 16
            return data[:at] + other[place : place + 4096] + data[at:]
        case "truncate":
            return data[:at]
        case "number":
            return _exchanged(NUMBER, data, at, change.choice)
        case "word":
            return _exchanged(WORD, data, at, change.choice)
    return data[:at] + WORDS[change.choice % len(WORDS)] + data[at:]


def _exchanged(pattern: re.Pattern[bytes], data: bytes, at: int, choice: int) -> bytes:
    """The next match behind a place, exchanged for something else."""
    found = pattern.search(data, at)
    if found is None:
        return data
    return data[: found.start()] + WORDS[choice % len(WORDS)] + data[found.end() :]
