"""Where a played boat is plugged in: UDP or TCP, either end.

    udpout:HOST:PORT   sends there (the gateway listens: udpin)
    udpin:HOST:PORT    waits for whoever speaks first (the gateway: udpout)
    tcpin:HOST:PORT    serves (the gateway: tcp)
    tcp:HOST:PORT      calls (the gateway: tcpin), again and again until somebody is there

Nothing here waits, but for a call a moment.
"""

import socket
import time
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Protocol

from gateway.errors import BadInput, ShadowError

Address = tuple[str, int]
Heard = tuple[Hashable, bytes]  # who spoke, what
BUFFER = 1 << 18  # bytes that wait for a slow listener before it is hung up on
PEERS = 16  # listeners of one port at most
PATIENCE_S, REDIAL_S = 0.25, 1.0


class Port(Protocol):
    """One end of a link."""

    @property
    def alone(self) -> str | None:
        """Why nobody hears what is sent; None where somebody may."""

    def send(self, data: bytes) -> None:
        """One frame to everybody who listens; lost where nobody does."""

    def heard(self) -> list[Heard]:
        """What has come in since."""

    def close(self) -> None:
        """Hang up."""


@contextmanager
def open_port(endpoint: str) -> Iterator[Port]:
    """The port that an endpoint names, open while inside."""
    kind, address = parse_endpoint(endpoint)
    try:
        port = KINDS[kind](address)
    except OSError as error:
        raise ShadowError(f"{endpoint}: cannot open it: {error.strerror or error}") from None
    try:
        yield port
    finally:
        port.close()


def parse_endpoint(endpoint: str) -> tuple[str, Address]:
    """ "udpout:127.0.0.1:14550" -> kind, address."""
    kind, _, rest = endpoint.partition(":")
    host, _, number = rest.rpartition(":")
    if kind not in KINDS or not host or not number.isdigit() or not 0 <= int(number) <= 65535:
        raise BadInput(
            f"{endpoint}: expected {', '.join(KINDS)} with host and port, "
            "as in udpout:127.0.0.1:14550"
        )
    return kind, (host, int(number))


class UdpPort:
    """Datagrams to fixed or to learnt peers."""

    def __init__(self, peers: tuple[Address, ...], bind: Address | None = None) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._learns = bind is not None
        self._peers: dict[Address, None] = dict.fromkeys(peers)
        try:
            self._socket.setblocking(False)
            if bind is not None:
                self._socket.bind(bind)
        except OSError:
            self._socket.close()
            raise

    @property
    def address(self) -> Address:
        """Where it listens."""
        host, number = self._socket.getsockname()
        return str(host), int(number)

    @property
    def alone(self) -> str | None:
        return None if self._peers else "nobody has spoken yet; waiting"

    def send(self, data: bytes) -> None:
        for peer in self._peers:
            with suppress(OSError):  # a full buffer, nobody there: datagrams get lost
                self._socket.sendto(data, peer)

    def heard(self) -> list[Heard]:
        found: list[Heard] = []
        with suppress(OSError):
            while True:
                data, peer = self._socket.recvfrom(65536)
                found.append((peer, data))
                if self._learns and len(self._peers) < PEERS:
                    self._peers[peer] = None
        return found

    def close(self) -> None:
        self._socket.close()


class TcpPort:
    """Streams: those who called (server), or the one that was called (client)."""

    def __init__(self, listen: Address | None = None, call: Address | None = None) -> None:
        self._server = None if listen is None else _listening(listen)
        self._call, self._redial = call, -REDIAL_S
        self._refusal = "no answer"
        self._peers: dict[socket.socket, bytearray] = {}

    @property
    def address(self) -> Address:
        """Where it listens."""
        assert self._server is not None
        host, number = self._server.getsockname()
        return str(host), int(number)

    @property
    def alone(self) -> str | None:
        if self._peers:
            return None
        if self._server is not None:
            return "nobody has called; waiting"
        return f"{self._refusal}; calling again every second"

    def send(self, data: bytes) -> None:
        for peer, unsent in list(self._peers.items()):
            unsent += data
            try:
                del unsent[: peer.send(unsent)]
            except BlockingIOError:
                if len(unsent) > BUFFER:
                    self._hang_up(peer)
            except OSError:
                self._hang_up(peer)

    def heard(self) -> list[Heard]:
        self._meet()
        found: list[Heard] = []
        for peer in list(self._peers):
            try:
                while data := peer.recv(65536):
                    found.append((peer, data))
                self._hang_up(peer)
            except BlockingIOError:
                continue
            except OSError:
                self._hang_up(peer)
        return found

    def close(self) -> None:
        for peer in list(self._peers):
            self._hang_up(peer)
        if self._server is not None:
            self._server.close()

    def _meet(self) -> None:
        """Whoever calls, or the other end once it is there."""
        if self._server is not None:
            with suppress(BlockingIOError):
                while len(self._peers) < PEERS:
                    self._welcome(self._server.accept()[0])
        elif self._call and not self._peers and time.monotonic() > self._redial + REDIAL_S:
            self._redial = time.monotonic()
            try:
                self._welcome(socket.create_connection(self._call, PATIENCE_S))
            except OSError as error:
                self._refusal = error.strerror or "no answer"

    def _welcome(self, peer: socket.socket) -> None:
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peers[peer] = bytearray()

    def _hang_up(self, peer: socket.socket) -> None:
        self._peers.pop(peer, None)
        peer.close()


def _listening(address: Address) -> socket.socket:
    server = socket.create_server(address)
    server.setblocking(False)
    return server


KINDS: Mapping[str, Callable[[Address], Port]] = {
    "udpout": lambda address: UdpPort((address,)),
    "udpin": lambda address: UdpPort((), bind=address),
    "tcpin": lambda address: TcpPort(listen=address),
    "tcp": lambda address: TcpPort(call=address),
}
