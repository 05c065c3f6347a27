"""Links to boats: the only sockets and serial ports of the project, one table of their kinds.

Here: what every kind of link can do, which is open, wait for bytes, send, close, and the queue
between the links' receivers and the loop: datagrams, link events, and their counts. The queue is
bounded and never holds a receiver up. Repeated trouble of a link is reported rarely.

The sockets are this package's own. `mavutil.mavlink_connection` keeps module globals, reads and
sets environment variables when it is imported, prints, sleeps while it reconnects, polls instead of
waiting, and loses the boundaries of datagrams. Checking and decoding of frames stay pymavlink's.
"""

import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol, Self

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
    SENDER_CHANGED = "sender_changed"  # one system id comes from another address than before
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


Peer = tuple[Any, ...] | str  # the other end: its address, or the name of the link
EventSink = Callable[[LinkEventKind, str], None]
READ_BYTES = 65536  # at most per read: the largest datagram
CONNECT_TIMEOUT_S = 3.0  # a boat out of reach does not answer at all


class Endpoint(NamedTuple):
    """A connection string in parts: `text` is `kind:address`."""

    text: str
    kind: str
    address: str

    def host_port(self) -> tuple[str, int]:
        """The address as HOST:PORT; ValueError says what is wrong with it."""
        host, _, port = self.address.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")  # an IPv6 address
        if not host:
            raise ValueError("host or port is missing")
        number = positive_number(port, "port")
        if number > 65535:
            raise ValueError(f"there is no port {number}")
        return host, number


def positive_number(digits: str, name: str) -> int:
    """Digits -> their number; ValueError where they are none."""
    if not (digits.isascii() and digits.isdigit() and int(digits) > 0):
        raise ValueError(f'the {name} "{digits}" is no positive number')
    return int(digits)


class Arrival(NamedTuple):
    """Bytes of one read, their sender, and when they were read [Unix ns]."""

    data: bytes
    peer: Peer
    receive_time_ns: int


class Transport(Protocol):
    """A link to one or more peers, open or closed; `open` again after it was lost.

    listens       it waits for others: what keeps it from opening will not go away by itself
    speaks_first  the other side learns of this one only by what is sent to it
    fixed_peer    the only peer there is; None where others come
    """

    listens: bool
    speaks_first: bool
    fixed_peer: Peer | None

    def open(self, waker: "Waker", report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        """Wait for an answer at most `timeout_s`; OSError where it fails, Closing when woken."""
        ...

    def connected(self) -> tuple[Peer, ...] | None:
        """The peers that are connected now; None where only what they send tells of them."""
        ...

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        """Wait until something arrives, at most `timeout_s`; OSError when the link is lost,
        Closing when woken."""
        ...

    def send(self, raw: bytes, peer: Peer) -> bool:
        """Send without waiting; False where nothing could be sent."""
        ...

    def close(self) -> None:
        """Close; allowed in any state."""
        ...


class Closing(Exception):
    """The link is being closed: not an error."""


class Waker:
    """A pair of sockets that ends a wait from another thread, without polling."""

    def __init__(self) -> None:
        self._near, self._far = socket.socketpair()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._near.close()
        self._far.close()

    def fileno(self) -> int:
        """The file descriptor that a selector waits for."""
        return self._near.fileno()

    def wake(self) -> None:
        """End every wait, now and later."""
        self._far.send(b"!")

    def sleep(self, seconds: float) -> None:
        """Wait that long; raises Closing when woken."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._near, selectors.EVENT_READ)
            if selector.select(seconds):
                raise Closing


class LineSelector:
    """Waits for any of several sockets or devices, and for the waker."""

    def __init__(self, waker: Waker) -> None:
        self._waker, self._selector = waker, selectors.DefaultSelector()
        self._selector.register(waker, selectors.EVENT_READ)

    def add(self, line: Any, peer: Peer | None = None, events: int = selectors.EVENT_READ) -> None:
        """Wait for that socket or device too."""
        self._selector.register(line, events, peer)

    def remove(self, line: Any) -> None:
        """Wait for it no longer."""
        self._selector.unregister(line)

    def wait(self, timeout_s: float | None = None) -> list[selectors.SelectorKey]:
        """Sockets and devices that are ready, none after `timeout_s`; raises Closing when woken."""
        ready = list[selectors.SelectorKey]()
        for key, _ in self._selector.select(timeout_s):
            if key.fileobj is self._waker:
                raise Closing
            ready.append(key)
        return ready

    def close(self) -> None:
        """Wait for nothing any more."""
        self._selector.close()


def resolve(address: tuple[str, int], kind: socket.SocketKind) -> tuple[int, tuple[Any, ...]]:
    """Host and port -> address family and address."""
    host, port = address
    try:
        found = socket.getaddrinfo(host, port, type=kind)
    except UnicodeError:
        raise OSError(f"{host} is no host name") from None
    family, _, _, _, resolved = found[0]
    return family, resolved


def peer_text(peer: Peer) -> str:
    """A peer as people write it: HOST:PORT."""
    return f"{peer[0]}:{peer[1]}" if isinstance(peer, tuple) else str(peer)
