"""Datagrams: `udpin` waits for whoever sends, `udpout` talks to one fixed address."""

import socket
import time
from contextlib import suppress

from gateway.links.inbox import LinkEventKind
from gateway.links.transport import (
    CONNECT_TIMEOUT_S,
    READ_BYTES,
    Arrival,
    Endpoint,
    EventSink,
    LineSelector,
    Peer,
    Waker,
    resolve,
)

BUFFER = 4 * 1024 * 1024  # bytes asked of the kernel: bursts wait there while the program is busy


class UdpTransport:
    """One socket for all peers; nothing that a peer does closes it."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.listens = endpoint.kind == "udpin"
        self.speaks_first = not self.listens
        self.fixed_peer: Peer | None = None if self.listens else endpoint.text
        self.address = endpoint.host_port()
        self._socket: socket.socket | None = None
        self._selector: LineSelector | None = None

    def open(self, waker: Waker, report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        family, address = resolve(self.address, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with suppress(OSError):  # some systems refuse what is more than they give
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        if self.listens:
            self._socket.bind(address)
            report(LinkEventKind.LISTENING, "waiting for datagrams")
        else:
            self._socket.connect(address)  # datagrams from elsewhere are refused by the kernel
        self._selector = LineSelector(waker)
        self._selector.add(self._socket)

    def connected(self) -> tuple[Peer, ...] | None:
        return None if self.fixed_peer is None else (self.fixed_peer,)

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        assert self._selector is not None
        assert self._socket is not None
        self._selector.wait(timeout_s)
        # the peer of an earlier datagram may not be there yet: an error of the past, not a loss
        with suppress(BlockingIOError, ConnectionRefusedError):
            data, peer = self._socket.recvfrom(READ_BYTES)
            return [Arrival(data, self.fixed_peer or peer, time.time_ns())]
        return []

    def send(self, raw: bytes, peer: Peer) -> bool:
        if self._socket is None:
            return False
        try:
            if self.listens:
                self._socket.sendto(raw, peer)
            else:
                self._socket.send(raw)
        except OSError:
            return False
        return True

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        if self._socket is not None:
            self._socket.close()
        self._selector = self._socket = None


def free_udp_port() -> int:
    """A port of this machine that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
