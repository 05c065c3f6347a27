"""Bytes of a link -> accepted MAVLink frames: checksum, signature, pymavlink's decoder.

pymavlink's own splitter trusts the length behind every magic byte: one stray byte of noise swallows
up to 280 bytes of good frames. Here, as in logs (`gateway.ingest.mavlink.walk`), a frame is
accepted when its checksum holds, and anything else moves the search on by one byte. `Peers` keeps
the addresses from which each system id sends, and tells whether two boats share an id.
"""

import re
import threading
import time
from enum import Enum, auto
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.definitions import checksum_seeds
from gateway.ingest.mavlink.walk import BAD_CHECKSUM, CUT, GOOD, UNKNOWN, checksum_table, examine
from gateway.links.inbox import EventReporter, Frame, LinkCounts, LinkEventKind
from gateway.links.transmitter import Signatures, SignatureStatus
from gateway.links.transport import Arrival, Peer, peer_text

MAX_ADDRESSES = 8  # kept per system id
ADDRESS_TIMEOUT_NS = 60_000_000_000  # an address silent for so long is not sent to
# Two addresses are two boats with one id after so many changes between them, each within this time
# of the one before: a reconnection under another port changes once. Chosen, not measured.
SHARED_ID_CHANGES, CHANGE_WINDOW_NS = 4, 10_000_000_000


class SenderChange(Enum):
    """What a frame shows about the sender of its system id."""

    NONE = auto()
    FIRST = auto()  # the first frame under this system id
    SHARED = auto()  # two addresses use this system id: reported once


class Peers:
    """Addresses by the system ids that were received from them; two threads use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received_ns: dict[int, dict[Peer, int]] = {}
        self._latest: dict[int, Peer] = {}
        self._changes: dict[int, tuple[int, int]] = {}  # count, time of the last

    def note(self, system: int, peer: Peer, now_ns: int) -> SenderChange:
        """A frame of a system came from that peer."""
        with self._lock:
            known = self._received_ns.setdefault(system, {})
            known[peer] = now_ns
            before = self._latest.get(system)
            self._latest[system] = peer
            if before is None or before == peer:
                return SenderChange.FIRST if before is None else SenderChange.NONE
            if len(known) > MAX_ADDRESSES:
                del known[min(known, key=known.__getitem__)]
            count, when = self._changes.get(system, (0, now_ns))
            close = count >= SHARED_ID_CHANGES or now_ns - when < CHANGE_WINDOW_NS
            count = count + 1 if close else 1
            self._changes[system] = (count, now_ns)
            return SenderChange.SHARED if count == SHARED_ID_CHANGES else SenderChange.NONE

    def addresses(self, system: int | None, now_ns: int) -> tuple[Peer, ...]:
        """Of a system, of all for None; the latest of each even after a long silence."""
        found: dict[Peer, None] = {}
        with self._lock:
            for number, known in self._received_ns.items():
                if system is None or number == system:
                    found[self._latest[number]] = None
                    found |= {
                        p: None for p, when in known.items() if now_ns - when < ADDRESS_TIMEOUT_NS
                    }
        return tuple(found)


MAGIC = re.compile(b"[\xfd\xfe]")
SEEDS, TABLE = checksum_seeds(), checksum_table()
MAX_UNFINISHED = 64  # peers whose unfinished frames are kept


class RawFrame(NamedTuple):
    """One frame; `known` is False where its id has no definition and so no checksum."""

    raw: bytes
    known: bool


class SplitBytes(NamedTuple):
    """The frames in some bytes; `rest` may be the beginning of another."""

    frames: list[RawFrame]
    rest: bytes
    bad_checksum: int
    junk_bytes: int


def split_frames(data: bytes) -> SplitBytes:
    """All frames in `data`."""
    array, size = np.frombuffer(data, np.uint8), len(data)
    frames: list[RawFrame] = []
    at, counted, tail, bad, junk = 0, 0, -1, 0, 0  # counted: end of what was; tail: of the rest
    while (magic := MAGIC.search(data, at)) is not None:
        at = magic.start()
        verdict, length = examine(array, at, size, SEEDS, TABLE)
        end = at + int(length)
        if verdict == GOOD:
            junk += max(at - counted, 0)
            frames.append(RawFrame(data[at:end], known=True))
            at = counted = end
            tail = -1
            continue
        if at >= counted and tail < 0:
            if verdict == CUT:
                tail = at
            elif verdict in (UNKNOWN, BAD_CHECKSUM) and _ends_whole(data, end):
                junk += at - counted
                bad += verdict == BAD_CHECKSUM
                if verdict == UNKNOWN:
                    frames.append(RawFrame(data[at:end], known=False))
                counted = end
        at += 1  # also inside a refused frame: if its length is wrong, good ones begin there
    tail = size if tail < 0 else tail
    return SplitBytes(frames, data[tail:], bad, junk + max(tail - counted, 0))


def _ends_whole(data: bytes, end: int) -> bool:
    """Does a frame that cannot be checked at least end where the data do, or the next begins?"""
    return end == len(data) or data[end] in (0xFD, 0xFE)


class FrameReader:
    """Reads the frames of one link; what is not accepted is counted."""

    def __init__(
        self,
        counts: LinkCounts,
        peers: Peers,
        signatures: Signatures | None,
        reporter: EventReporter,
    ) -> None:
        self._counts, self._peers = counts, peers
        self._signatures, self._reporter = signatures, reporter
        self._decoder = dialect.MAVLink(None)
        self._unfinished: dict[Peer, bytes] = {}

    def read(self, arrival: Arrival) -> tuple[Frame, ...]:
        """The frames that one read of the link completed."""
        split = split_frames(self._unfinished.pop(arrival.peer, b"") + arrival.data)
        self._counts.bad_checksum += split.bad_checksum
        self._counts.junk_bytes += split.junk_bytes
        if split.rest:
            if len(self._unfinished) >= MAX_UNFINISHED:
                del self._unfinished[next(iter(self._unfinished))]
            self._unfinished[arrival.peer] = split.rest
        accepted = (frame for frame in split.frames if self._signed_well(frame, arrival))
        return tuple(self._decoded(frame, arrival.peer) for frame in accepted)

    def forget(self) -> None:
        """The link was lost: unfinished frames will never be completed."""
        self._unfinished.clear()

    def _signed_well(self, frame: RawFrame, arrival: Arrival) -> bool:
        """Is the signature good, where one is demanded?"""
        if self._signatures is None:
            return True
        status = self._signatures.check(frame.raw, arrival.receive_time_ns)
        if status is not SignatureStatus.VALID:
            self._refuse(status)
        if status is SignatureStatus.OLD:  # a boat behind in time learns the time from our frames
            self._peers.note(frame.raw[5], arrival.peer, time.monotonic_ns())
        return status is SignatureStatus.VALID

    def _refuse(self, status: SignatureStatus) -> None:
        c = self._counts
        c.unsigned += status is SignatureStatus.UNSIGNED
        c.wrong_signature += status is SignatureStatus.WRONG
        c.old_signature += status is SignatureStatus.OLD
        self._reporter.report_rarely(
            LinkEventKind.REFUSED,
            f"frames refused so far: {c.unsigned} unsigned, {c.wrong_signature} with a wrong "
            f"signature, {c.old_signature} with an old timestamp",
        )

    def _decoded(self, frame: RawFrame, peer: Peer) -> Frame:
        raw = frame.raw
        self._counts.frames += 1
        if not frame.known:
            self._counts.unknown += 1
            return Frame(raw, None)
        self._note_sender(raw[5] if raw[0] == 0xFD else raw[3], peer)
        return Frame(raw, self._decoder.decode(bytearray(raw)))

    def _note_sender(self, system: int, peer: Peer) -> None:
        """Remember the address of a system; report it when it is new or looks like two."""
        change = self._peers.note(system, peer, time.monotonic_ns())
        if change is SenderChange.FIRST:
            text = f"system {system} heard from {peer_text(peer)}"
            self._reporter.report(LinkEventKind.HEARD, text)
        elif change is SenderChange.SHARED:
            self._reporter.report(
                LinkEventKind.SHARED_ID,
                f"system {system} speaks from {peer_text(peer)} and from another address: "
                "two boats with one id, or one boat by two ways",
            )
