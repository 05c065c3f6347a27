"""What a link counts: shown by health and by `shadow monitor`, never hidden.

What a link puts into the inbox: datagrams with their frames, and what happened to the link.

The one queue between receivers and the loop: bounded, and never in a receiver's way.

What happens to a link goes into the inbox as events; trouble that repeats is said seldom.
"""

import time
from dataclasses import dataclass
from enum import StrEnum
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple


@dataclass
class Counts:
    """Since the link was opened. The receiver adds; others read a copy."""

    datagrams: int = 0
    bytes: int = 0
    frames: int = 0  # accepted
    unknown: int = 0  # kept, never used
    bad_checksum: int = 0
    junk_bytes: int = 0
    dropped: int = 0  # datagrams for which the inbox had no room
    unsigned: int = 0  # refused, as the next two
    wrong_signature: int = 0
    old_signature: int = 0
    faults: int = 0
    losses: int = 0  # of the connection
    sent: int = 0
    unsent: int = 0  # nobody to send to, or the line was full


class Frame(NamedTuple):
    """One MAVLink frame, byte for byte.

    message  pymavlink's object; None where the id is unknown: such a frame has no checksum that
             could be verified, so it is kept for the recording and never used
    """

    raw: bytes
    message: Any


class Datagram(NamedTuple):
    """What one read from a link brought: one or more frames with one receipt."""

    link: str
    receive_time_ns: int
    frames: tuple[Frame, ...]


class Kind(StrEnum):
    """What can happen to a link."""

    LISTENING = "listening"  # we wait for others
    CONNECTED = "connected"
    HEARD = "heard"  # the first frame of a system
    LOST = "lost"
    REFUSED = "refused"  # frames were not taken: signature missing, wrong or old
    SHARED_ID = "shared_id"  # one system id comes from two addresses
    FAULT = "fault"  # a defect of ours: the datagram is lost, the link goes on


class LinkEvent(NamedTuple):
    """One change of a link, in words."""

    link: str
    receive_time_ns: int
    kind: Kind
    says: str


Item = Datagram | LinkEvent
PER_LINK = 60_000  # a minute at 1000 datagrams a second, five times what a busy boat sends

__all__ = ["PER_LINK", "Empty", "Inbox", "Item"]


class Inbox:
    """Items in the order of their arrival; a full inbox drops the newest datagram and counts it."""

    def __init__(self, capacity: int = PER_LINK) -> None:
        self.capacity = capacity
        self._items: SimpleQueue[Item] = SimpleQueue()  # unlike `Queue`, without a Python lock

    def put(self, item: Item) -> bool:
        """Never blocks; False where there was no room. Events are few and always find room."""
        if self._items.qsize() >= self.capacity and isinstance(item, Datagram):
            return False
        self._items.put(item)
        return True

    def get(self, timeout: float | None = None) -> Item:
        """The oldest item; raises `queue.Empty` when none comes within `timeout` [s]."""
        if timeout is None or timeout > 0:
            return self._items.get(timeout=timeout)
        return self._items.get_nowait()

    def __len__(self) -> int:
        return self._items.qsize()


QUIET_NS = 10_000_000_000  # between two reports of the same trouble


class Reporter:
    """The voice of one link towards the loop."""

    def __init__(self, link: str, inbox: Inbox) -> None:
        self._link, self._inbox = link, inbox
        self._said_ns: dict[Kind, int] = {}

    def say(self, kind: Kind, says: str) -> None:
        """One event."""
        self._inbox.put(LinkEvent(self._link, time.time_ns(), kind, says))

    def seldom(self, kind: Kind, says: str) -> None:
        """One event at most in `QUIET_NS`, for what may come with every datagram."""
        now_ns = time.monotonic_ns()
        if now_ns - self._said_ns.get(kind, now_ns - QUIET_NS) >= QUIET_NS:
            self._said_ns[kind] = now_ns
            self.say(kind, says)
