"""Ends a wait from another thread, so that nobody has to look again and again.

What every kind of line can do: open, wait for bytes, send, close. One file per kind beside this.

Why not `mavutil.mavlink_connection`: it keeps module globals, reads and sets environment variables
when imported, prints, sleeps while it reconnects, polls instead of waiting, and forgets where one
datagram ends. The sockets are ours; checking and decoding stay pymavlink's.
"""

import selectors
import socket
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, Self

from gateway.links.endpoint import Endpoint
from gateway.links.inbox import Kind


class Closing(Exception):
    """The link is being closed: not an error."""


class Waker:
    """A pair of sockets: the receiver waits for one end together with its line."""

    def __init__(self) -> None:
        self._near, self._far = socket.socketpair()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._near.close()
        self._far.close()

    def fileno(self) -> int:
        """For selectors."""
        return self._near.fileno()

    def wake(self) -> None:
        """End every wait, now and later."""
        self._far.send(b"!")

    def sleep(self, seconds: float) -> None:
        """Wait; raises Closing when woken."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._near, selectors.EVENT_READ)
            if selector.select(seconds):
                raise Closing


Peer = tuple[Any, ...] | str  # who is at the other end: an address, or the name of the line
Report = Callable[[Kind, str], None]
READ = 65536  # bytes at most per read: the largest datagram


class Arrival(NamedTuple):
    """Bytes of one read, who sent them, and when they were read [Unix ns]."""

    data: bytes
    peer: Peer
    receive_time_ns: int


class Wire(Protocol):
    """An open or closed line; `open` again after it was lost."""

    @property
    def fixed_peer(self) -> Peer | None:
        """The only one there is at the other end; None where others come to us."""
        ...

    def open(self, waker: Waker, report: Report) -> None:
        """Raises OSError where that fails, Closing when woken."""
        ...

    def receive(self) -> list[Arrival]:
        """Waits until something came; raises OSError when the line is lost, Closing when woken."""
        ...

    def send(self, raw: bytes, peer: Peer) -> bool:
        """Without waiting; False where it could not go out."""
        ...

    def close(self) -> None:
        """May be called in any state."""
        ...


def resolve(endpoint: Endpoint, kind: socket.SocketKind) -> tuple[int, tuple[Any, ...]]:
    """Address family and address of host and port."""
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=kind)
    except UnicodeError:
        raise OSError(f"{endpoint.host} is no host name") from None
    family, _, _, _, address = found[0]
    return family, address


def shown(peer: Peer) -> str:
    """An address as people write it."""
    return f"{peer[0]}:{peer[1]}" if isinstance(peer, tuple) else str(peer)
