"""Bytes as they come from a link -> MAVLink frames, by the same rules as from a log.

pymavlink's own cutter trusts the length behind every magic byte: one stray byte of noise swallows
up to 280 bytes of good frames. Here, as in `gateway.ingest.frame_walk`, a frame is accepted when
its checksum holds, and nothing else can move the search on by more than a byte.
"""

import re
from typing import NamedTuple

import numpy as np

from gateway.ingest.definitions import checksum_seeds
from gateway.ingest.frame_walk import BAD_CHECKSUM, CUT, GOOD, UNKNOWN, checksum_table, examine

MAGIC = re.compile(b"[\xfd\xfe]")
SEEDS, TABLE = checksum_seeds(), checksum_table()


class Piece(NamedTuple):
    """One frame; `known` is False where its id has no definition and so no checksum."""

    raw: bytes
    known: bool


class Pieces(NamedTuple):
    """What was found in some bytes; `rest` may be the beginning of a frame."""

    found: list[Piece]
    rest: bytes
    bad_checksum: int
    junk_bytes: int


def cut(data: bytes) -> Pieces:
    """All frames in `data`."""
    array, size = np.frombuffer(data, np.uint8), len(data)
    found: list[Piece] = []
    at, done, tail, bad, junk = 0, 0, -1, 0, 0  # done: end of what was counted, tail: of the rest
    while (magic := MAGIC.search(data, at)) is not None:
        at = magic.start()
        verdict, length = examine(array, at, size, SEEDS, TABLE)
        end = at + int(length)
        if verdict == GOOD:
            junk += max(at - done, 0)
            found.append(Piece(data[at:end], known=True))
            at = done = end
            tail = -1
            continue
        if at >= done and tail < 0:
            if verdict == CUT:
                tail = at
            elif verdict in (UNKNOWN, BAD_CHECKSUM) and _closed(data, end):
                junk += at - done
                bad += verdict == BAD_CHECKSUM
                if verdict == UNKNOWN:
                    found.append(Piece(data[at:end], known=False))
                done = end
        at += 1  # also inside a refused frame: if its length is wrong, good ones begin there
    tail = size if tail < 0 else tail
    return Pieces(found, data[tail:], bad, junk + max(tail - done, 0))


def _closed(data: bytes, end: int) -> bool:
    """Does a frame that cannot be checked at least end where the data do, or the next begins?"""
    return end == len(data) or data[end] in (0xFD, 0xFE)
