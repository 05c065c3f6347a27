"""Bytes as they come from a link -> MAVLink frames, by the same rules as from a log.

pymavlink's own cutter trusts the length behind every magic byte: one stray byte of noise swallows
up to 280 bytes of good frames. Here, as in `gateway.ingest.mavlink.walk`, a frame is accepted when
its checksum holds, and nothing else can move the search on by more than a byte.

Bytes of a link -> accepted frames: checksum, signature, pymavlink's decoder, in this order.
"""

import re
import time
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.definitions import checksum_seeds
from gateway.ingest.mavlink.walk import BAD_CHECKSUM, CUT, GOOD, UNKNOWN, checksum_table, examine
from gateway.links.inbox import Counts, Frame, Kind, Reporter
from gateway.links.peers import News, Peers
from gateway.links.signing import Signatures, Verdict
from gateway.links.transport import Arrival, Peer, shown

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


RESTS = 64  # peers whose unfinished frames are kept


class Reader:
    """Reads for one link; everything that is not taken is counted."""

    def __init__(
        self, counts: Counts, peers: Peers, signatures: Signatures | None, reporter: Reporter
    ) -> None:
        self._counts, self._peers = counts, peers
        self._signatures, self._reporter = signatures, reporter
        self._decoder = dialect.MAVLink(None)
        self._rests: dict[Peer, bytes] = {}

    def read(self, arrival: Arrival) -> tuple[Frame, ...]:
        """The frames that one read of the line completed."""
        pieces = cut(self._rests.pop(arrival.peer, b"") + arrival.data)
        self._counts.bad_checksum += pieces.bad_checksum
        self._counts.junk_bytes += pieces.junk_bytes
        if pieces.rest:
            self._keep(arrival.peer, pieces.rest)
        return tuple(self._frame(p, arrival) for p in pieces.found if self._taken(p, arrival))

    def forget(self) -> None:
        """The line was lost: what it had begun will never be finished."""
        self._rests.clear()

    def _keep(self, peer: Peer, rest: bytes) -> None:
        if len(self._rests) >= RESTS:
            del self._rests[next(iter(self._rests))]
        self._rests[peer] = rest

    def _taken(self, piece: Piece, arrival: Arrival) -> bool:
        """Is the signature good, where one is demanded?"""
        if self._signatures is None:
            return True
        verdict = self._signatures.judge(piece.raw, arrival.receive_time_ns)
        if verdict is not Verdict.VALID:
            self._refuse(verdict)
        if verdict is Verdict.OLD:  # a boat behind in time learns the time from what we send
            self._peers.hear(piece.raw[5], arrival.peer, time.monotonic_ns())
        return verdict is Verdict.VALID

    def _refuse(self, verdict: Verdict) -> None:
        c = self._counts
        c.unsigned += verdict is Verdict.UNSIGNED
        c.wrong_signature += verdict is Verdict.WRONG
        c.old_signature += verdict is Verdict.OLD
        self._reporter.seldom(
            Kind.REFUSED,
            f"frames refused so far: {c.unsigned} unsigned, {c.wrong_signature} with a wrong "
            f"signature, {c.old_signature} with an old timestamp",
        )

    def _frame(self, piece: Piece, arrival: Arrival) -> Frame:
        raw = piece.raw
        self._counts.frames += 1
        if not piece.known:
            self._counts.unknown += 1
            return Frame(raw, None)
        self._hear(raw[5] if raw[0] == 0xFD else raw[3], arrival.peer)
        return Frame(raw, self._decoder.decode(bytearray(raw)))

    def _hear(self, system: int, peer: Peer) -> None:
        """Where a system speaks from; said when it is new or looks like two."""
        news = self._peers.hear(system, peer, time.monotonic_ns())
        if news is News.FIRST:
            self._reporter.say(Kind.HEARD, f"system {system} heard from {shown(peer)}")
        elif news is News.SHARED:
            self._reporter.say(
                Kind.SHARED_ID,
                f"system {system} speaks from {shown(peer)} and from another address: "
                "two boats with one id, or one boat by two ways",
            )
