"""A connection that we open: `tcp:HOST:PORT`.

Connections that others open to us: `tcpin:HOST:PORT`.
"""

import contextlib
import os
import selectors
import socket
import time

from gateway.links.endpoint import Endpoint
from gateway.links.inbox import Kind
from gateway.links.transport import READ, Arrival, Closing, Peer, Report, Waker, resolve, shown

CONNECT_S = 3.0  # a boat out of reach does not answer at all
KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # dead is known in 11 s


class TcpClientWire:
    """One connection at a time."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.fixed_peer: Peer | None = str(endpoint)
        self._socket: socket.socket | None = None
        self._selector: selectors.BaseSelector | None = None
        self._waker: Waker | None = None

    def open(self, waker: Waker, report: Report) -> None:
        family, address = resolve(self.endpoint, socket.SOCK_STREAM)
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        prepare(self._socket)
        self._waker, self._selector = waker, selectors.DefaultSelector()
        self._selector.register(waker, selectors.EVENT_READ)
        self._socket.connect_ex(address)  # its result comes when the socket can be written to
        self._selector.register(self._socket, selectors.EVENT_WRITE)
        if not self._ready(CONNECT_S):
            raise TimeoutError("no answer")
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            raise OSError(error, os.strerror(error))
        self._selector.modify(self._socket, selectors.EVENT_READ)
        report(Kind.CONNECTED, "connected")

    def receive(self) -> list[Arrival]:
        assert self._socket is not None
        self._ready(None)
        with contextlib.suppress(BlockingIOError):
            data = self._socket.recv(READ)
            now = time.time_ns()
            if not data:
                raise ConnectionError("closed by the other side")
            return [Arrival(data, str(self.endpoint), now)]
        return []

    def _ready(self, timeout: float | None) -> bool:
        """Waits for the line; raises Closing when woken."""
        assert self._selector is not None
        ready = self._selector.select(timeout)
        if any(key.fileobj is self._waker for key, _ in ready):
            raise Closing
        return bool(ready)

    def send(self, raw: bytes, peer: Peer) -> bool:
        return self._socket is not None and send_all(self._socket, raw)

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        if self._socket is not None:
            self._socket.close()
        self._selector = self._socket = None


def prepare(line: socket.socket) -> None:
    """Never wait in it, send at once, notice that the other side is dead."""
    line.setblocking(False)
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    line.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEPALIVE.items():
        if hasattr(socket, name):  # not every system has all three
            line.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def send_all(line: socket.socket, raw: bytes) -> bool:
    """Sent whole? A frame cut short by a full line fails its checksum at the other end."""
    try:
        return line.send(raw) == len(raw)
    except OSError:
        return False


MOST = 16  # connections at once: nobody may use up our files


class TcpServerWire:
    """A listening socket and whoever has connected; losing one leaves the others alone."""

    fixed_peer: Peer | None = None

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self._listener: socket.socket | None = None
        self._selector: selectors.BaseSelector | None = None
        self._waker: Waker | None = None
        self._report: Report | None = None
        self._lines: dict[Peer, socket.socket] = {}

    def open(self, waker: Waker, report: Report) -> None:
        family, address = resolve(self.endpoint, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        # connections of an earlier run may linger on this port for minutes
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.bind(address)
        self._listener.listen()
        self._waker, self._report, self._selector = waker, report, selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(waker, selectors.EVENT_READ)
        report(Kind.LISTENING, "waiting for connections")

    def receive(self) -> list[Arrival]:
        assert self._selector is not None
        arrivals = []
        for key, _ in self._selector.select():
            if key.fileobj is self._waker:
                raise Closing
            if key.fileobj is self._listener:
                self._accept()
            else:
                arrivals += self._read(key.data)
        return arrivals

    def _accept(self) -> None:
        assert self._listener is not None
        assert self._selector is not None
        assert self._report is not None
        try:
            line, peer = self._listener.accept()
        except (BlockingIOError, ConnectionError):
            return  # gone again
        if len(self._lines) >= MOST:
            line.close()
            return
        prepare(line)
        self._lines[peer] = line
        self._selector.register(line, selectors.EVENT_READ, peer)
        self._report(Kind.CONNECTED, f"{shown(peer)} connected")

    def _read(self, peer: Peer) -> list[Arrival]:
        try:
            data = self._lines[peer].recv(READ)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        now = time.time_ns()
        if not data:
            self._drop(peer)
            return []
        return [Arrival(data, peer, now)]

    def _drop(self, peer: Peer) -> None:
        assert self._selector is not None
        assert self._report is not None
        line = self._lines.pop(peer)
        self._selector.unregister(line)
        line.close()
        self._report(Kind.LOST, f"{shown(peer)} went away")

    def send(self, raw: bytes, peer: Peer) -> bool:
        line = self._lines.get(peer)
        return line is not None and send_all(line, raw)

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        for line in (*self._lines.values(), self._listener):
            if line is not None:
                line.close()
        self._lines = {}
        self._selector = self._listener = None
