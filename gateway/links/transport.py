"""What every kind of link can do: open, wait for bytes, send, close. One file per kind beside this.

The sockets are this package's own. `mavutil.mavlink_connection` keeps module globals, reads and
sets environment variables when it is imported, prints, sleeps while it reconnects, polls instead of
waiting, and loses the boundaries of datagrams. Checking and decoding of frames stay pymavlink's.
"""

import selectors
import socket
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, Self

from gateway.links.inbox import LinkEventKind

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
        ready = [key for key, _ in self._selector.select(timeout_s)]
        if any(key.fileobj is self._waker for key in ready):
            raise Closing
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
