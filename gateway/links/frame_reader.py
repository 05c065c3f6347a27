"""Bytes of a link -> accepted MAVLink frames: checksum, signature, pymavlink's decoder.

pymavlink's own splitter trusts the length behind every magic byte: one stray byte of noise swallows
up to 280 bytes of good frames. Here, as in logs (`gateway.ingest.mavlink.frames`), a frame is
accepted when its checksum holds, and anything else moves the search on by one byte. `Peers` keeps
the addresses from which each system id sends; of two that use one id the first holds it, and the
frames of the other are left out.
"""

import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.frames import (
    BAD_CHECKSUM,
    CUT,
    GOOD,
    UNKNOWN,
    checksum_seeds,
    checksum_table,
    examine,
)
from gateway.links import Arrival, EventReporter, Frame, LinkCounts, LinkEventKind, Peer, peer_text
from gateway.links.transmitter import Signatures, SignatureStatus

MAX_ADDRESSES = 8  # kept per system id
ADDRESS_TIMEOUT_NS = 60_000_000_000  # an address silent for so long is not sent to
# Of two addresses that use one id the first holds it until it was silent for so long: a sender that
# comes back under another port waits for that. Boats speak at least once a second. Chosen.
HOLD_NS = 2_000_000_000
# Two addresses are two boats with one id once the holder has spoken again so often after the other
# one, each within this time of the turn before: a reconnection changes once. Chosen, not measured.
SHARED_ID_TURNS, TURN_WINDOW_NS = 4, 10_000_000_000
MAX_LISTED = 32  # systems that a link tells of by name


class SenderChange(Enum):
    """What a frame shows about the sender of its system id."""

    NONE = auto()
    FIRST = auto()  # the first frame under this system id
    CHANGED = auto()  # another address holds this id from now on: the one before was silent
    APART = auto()  # another address holds this id: the frame is not for use
    SHARED = auto()  # two addresses use this id: reported once, with a frame of its holder


@dataclass
class _Holder:
    """The address that speaks for a system and component."""

    peer: Peer
    spoke_ns: int
    other: bool = False  # another address has spoken since
    turns: int = 0
    turned_ns: int = 0
    reported: bool = False


class Peers:
    """Addresses by the system ids that were received from them; two threads use it.

    connected  the peers that are connected now, None where only what they send tells of them: one
               that hung up holds no id
    """

    def __init__(self, connected: Callable[[], tuple[Peer, ...] | None] = lambda: None) -> None:
        self._connected = connected
        self._lock = threading.Lock()
        self._received_ns: dict[int, dict[Peer, int]] = {}
        self._latest: dict[int, Peer] = {}
        self._holders: dict[tuple[int, int], _Holder] = {}  # by system and component

    def note(self, system: int, component: int, peer: Peer, now_ns: int) -> SenderChange:
        """A frame of a system and component came from that peer."""
        with self._lock:
            holder = self._holders.get((system, component))
            taken = holder is not None and holder.peer != peer and self._gone(holder, now_ns)
            if holder is None or taken:
                holder = self._holders[system, component] = _Holder(peer, now_ns)
            if holder.peer != peer:
                holder.other = True
                return SenderChange.APART
            before = self._latest.get(system)
            self._address(system, peer, now_ns)
            shared = self._turn(holder, now_ns)
        if shared:
            return SenderChange.SHARED
        if before is None:
            return SenderChange.FIRST
        # of a system's components that go over together the first one is told
        return SenderChange.CHANGED if taken and before != peer else SenderChange.NONE

    def note_address(self, system: int, peer: Peer, now_ns: int) -> None:
        """A system was received from that peer, in a frame that is not for use."""
        with self._lock:
            self._address(system, peer, now_ns)

    def _gone(self, holder: _Holder, now_ns: int) -> bool:
        connected = self._connected()
        hung_up = connected is not None and holder.peer not in connected
        return hung_up or now_ns - holder.spoke_ns > HOLD_NS

    def _address(self, system: int, peer: Peer, now_ns: int) -> None:
        known = self._received_ns.setdefault(system, {})
        known[peer] = now_ns
        self._latest[system] = peer
        if len(known) > MAX_ADDRESSES:
            del known[min(known, key=known.__getitem__)]

    @staticmethod
    def _turn(holder: _Holder, now_ns: int) -> bool:
        """The holder speaks again -> are there two boats, said for the first time?"""
        holder.spoke_ns = now_ns
        if not holder.other:
            return False
        close = now_ns - holder.turned_ns < TURN_WINDOW_NS
        holder.other, holder.turned_ns = False, now_ns
        holder.turns = holder.turns + 1 if close else 1
        found = holder.turns >= SHARED_ID_TURNS and not holder.reported
        holder.reported |= found
        return found

    def addresses(self, system: int | None, now_ns: int) -> tuple[Peer, ...]:
        """Addresses that a system (None: any) speaks from; its latest even after a long silence."""
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
        self._systems = 0  # that were heard
        self._changes = 0  # of the sender of an id, as told

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
        decoded = (self._decoded(frame, arrival.peer) for frame in accepted)
        return tuple(frame for frame in decoded if frame is not None)

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
            self._peers.note_address(frame.raw[5], arrival.peer, time.monotonic_ns())
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

    def _decoded(self, frame: RawFrame, peer: Peer) -> Frame | None:
        """A frame for use; None where its sender is kept apart."""
        raw = frame.raw
        system, component = raw[5:7] if raw[0] == 0xFD else raw[3:5]
        if frame.known and not self._from_holder(system, component, peer):
            self._counts.apart += 1
            return None
        self._counts.frames += 1
        if not frame.known:
            self._counts.unknown += 1
            return Frame(raw, None)
        return Frame(raw, self._decoder.decode(bytearray(raw)))

    def _from_holder(self, system: int, component: int, peer: Peer) -> bool:
        """Remember the address of a system; report it when it is new, or when there are two."""
        change = self._peers.note(system, component, peer, time.monotonic_ns())
        if change is SenderChange.FIRST:
            self._report_new(system, peer)
        elif change is SenderChange.SHARED:
            self._reporter.report(
                LinkEventKind.SHARED_ID,
                f"system {system} speaks from {peer_text(peer)} and from another address: "
                "two boats with one id, or one boat by two ways; the first holds the id, what "
                "comes from the other is left out",
            )
        elif change is SenderChange.CHANGED:
            self._report_change(system, peer)
        return change is not SenderChange.APART

    def _report_change(self, system: int, peer: Peer) -> None:
        """Say that another sender has a system's id now; of many changes only now and then."""
        self._changes += 1
        report = self._reporter.report
        if self._changes > MAX_LISTED:
            report = self._reporter.report_rarely
        report(
            LinkEventKind.SENDER_CHANGED,
            f"another sender holds system id {system} now, {peer_text(peer)}; the one before fell "
            "silent: the same boat by another way, or another boat with its id, whose motion has "
            "nothing to do with what came before",
        )

    def _report_new(self, system: int, peer: Peer) -> None:
        """Name a new system; of many, say only that there are more."""
        self._systems += 1
        text = f"system {system} heard from {peer_text(peer)}"
        if self._systems > MAX_LISTED:
            text = f"more than {MAX_LISTED} systems heard: further ones are not named"
        if self._systems <= MAX_LISTED + 1:
            self._reporter.report(LinkEventKind.HEARD, text)
