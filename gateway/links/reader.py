"""Bytes of a link -> accepted frames: checksum, signature, pymavlink's decoder, in this order."""

import time

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.links.counts import Counts
from gateway.links.framing import Piece, cut
from gateway.links.items import Frame, Kind
from gateway.links.peers import News, Peers
from gateway.links.reporter import Reporter
from gateway.links.signing import Signatures, Verdict
from gateway.links.wire import Arrival, Peer, shown

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
