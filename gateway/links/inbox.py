"""The queue between the links' receivers and the loop: datagrams, link events, and their counts.

It is bounded and never holds a receiver up. Repeated trouble of a link is reported rarely.
"""

import time
from dataclasses import dataclass
from enum import StrEnum
from queue import SimpleQueue
from typing import Any, NamedTuple

PER_LINK = 60_000  # a minute at 1000 datagrams a second, five times what a busy boat sends
REPORT_INTERVAL_NS = 10_000_000_000  # between two reports of the same trouble


@dataclass
class LinkCounts:
    """What passed since a link was opened. The receiver adds; others read a copy."""

    datagrams: int = 0
    bytes: int = 0
    frames: int = 0  # accepted
    unknown: int = 0  # ids without a definition: recorded, not used
    bad_checksum: int = 0
    junk_bytes: int = 0
    dropped: int = 0  # datagrams for which the inbox had no room
    unsigned: int = 0  # refused, as the next two
    wrong_signature: int = 0
    old_signature: int = 0
    apart: int = 0  # of a second sender under an id that the first one holds
    faults: int = 0
    losses: int = 0  # of the connection
    sent: int = 0
    unsent: int = 0  # no peer to send to, or the line was full


class Frame(NamedTuple):
    """One MAVLink frame, byte for byte.

    message  pymavlink's object; None where the id is unknown: such a frame has no checksum that
             could be verified, so it is recorded and never used
    """

    raw: bytes
    message: Any


class Datagram(NamedTuple):
    """One read from a link: one or more frames with one time of receipt."""

    link: str
    receive_time_ns: int
    frames: tuple[Frame, ...]


class LinkEventKind(StrEnum):
    """What can happen to a link."""

    LISTENING = "listening"  # waits for others
    CONNECTED = "connected"
    HEARD = "heard"  # the first frame of a system
    LOST = "lost"
    REFUSED = "refused"  # frames were not taken: signature missing, wrong or old
    SHARED_ID = "shared_id"  # one system id comes from two addresses
    FAULT = "fault"  # a defect of this program: the datagram is lost, the link goes on


class LinkEvent(NamedTuple):
    """One change of a link; `text` is for people."""

    link: str
    receive_time_ns: int
    kind: LinkEventKind
    text: str


Item = Datagram | LinkEvent


class Inbox:
    """Items in the order of their arrival; a full inbox drops the newest datagram."""

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


class EventReporter:
    """Puts the events of one link into the inbox."""

    def __init__(self, link: str, inbox: Inbox) -> None:
        self._link, self._inbox = link, inbox
        self._reported_ns: dict[LinkEventKind, int] = {}

    def report(self, kind: LinkEventKind, text: str) -> None:
        """One event."""
        self._inbox.put(LinkEvent(self._link, time.time_ns(), kind, text))

    def report_rarely(self, kind: LinkEventKind, text: str) -> None:
        """At most one event per `REPORT_INTERVAL_NS`, for what may come with every datagram."""
        now_ns = time.monotonic_ns()
        if now_ns - self._reported_ns.get(kind, now_ns - REPORT_INTERVAL_NS) >= REPORT_INTERVAL_NS:
            self._reported_ns[kind] = now_ns
            self.report(kind, text)
