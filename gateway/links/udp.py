"""Datagrams: `udpin` waits for whoever sends, `udpout` talks to one fixed address."""

import contextlib
import selectors
import socket
import time

from gateway.links.endpoint import Endpoint, Kind
from gateway.links.inbox import Kind as Event
from gateway.links.transport import READ, Arrival, Closing, Peer, Report, Waker, resolve

BUFFER = 4 * 1024 * 1024  # asked of the kernel: bursts wait there while the interpreter is busy


class UdpWire:
    """One socket for all peers; nothing that a peer does closes it."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.fixed_peer: Peer | None = None if endpoint.kind is Kind.UDP_IN else str(endpoint)
        self._socket: socket.socket | None = None
        self._selector: selectors.BaseSelector | None = None
        self._waker: Waker | None = None

    def open(self, waker: Waker, report: Report) -> None:
        family, address = resolve(self.endpoint, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):  # some systems refuse what is more than they give
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        if self.fixed_peer is None:
            self._socket.bind(address)
            report(Event.LISTENING, "waiting for datagrams")
        else:
            self._socket.connect(address)  # datagrams from anywhere else do not reach us
        self._waker, self._selector = waker, selectors.DefaultSelector()
        self._selector.register(self._socket, selectors.EVENT_READ)
        self._selector.register(waker, selectors.EVENT_READ)

    def receive(self) -> list[Arrival]:
        assert self._selector is not None
        assert self._socket is not None
        for key, _ in self._selector.select():
            if key.fileobj is self._waker:
                raise Closing
        # whoever we sent to may not be there yet: an error of the past, not of this line
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            data, peer = self._socket.recvfrom(READ)
            now = time.time_ns()
            return [Arrival(data, self.fixed_peer or peer, now)]
        return []

    def send(self, raw: bytes, peer: Peer) -> bool:
        line = self._socket
        if line is None:
            return False
        try:
            if self.fixed_peer is None:
                line.sendto(raw, peer)
            else:
                line.send(raw)
        except OSError:
            return False
        return True

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        if self._socket is not None:
            self._socket.close()
        self._selector = self._socket = None
