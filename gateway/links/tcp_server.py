"""Connections that others open to us: `tcpin:HOST:PORT`."""

import selectors
import socket
import time

from gateway.links.endpoint import Endpoint
from gateway.links.items import Kind
from gateway.links.tcp_client import prepare, send_all
from gateway.links.waker import Closing, Waker
from gateway.links.wire import READ, Arrival, Peer, Report, resolve, shown

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
