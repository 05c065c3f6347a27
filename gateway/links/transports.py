"""The network and serial lines: UDP, TCP, and a device.

udpin:HOST:PORT    waits for whoever sends datagrams
udpout:HOST:PORT   talks to one fixed address
tcp:HOST:PORT      connects to a server
tcpin:HOST:PORT    is one
/dev/ttyUSB0,57600 a serial device; POSIX only, what it needs is in the standard library
"""

import errno
import os
import selectors
import socket
import termios
import time
from contextlib import suppress

from gateway.errors import BadInput
from gateway.links import (
    CONNECT_TIMEOUT_S,
    READ_BYTES,
    Arrival,
    Endpoint,
    EventSink,
    LineSelector,
    LinkEventKind,
    Peer,
    Waker,
    peer_text,
    positive_number,
    resolve,
)

BUFFER = 4 * 1024 * 1024  # bytes asked of the kernel: bursts wait there while the program is busy

AT_ONCE = 32  # datagrams read without a wait in between, which costs as much as reading one


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
        if not self._selector.wait(timeout_s):
            return []
        arrivals = list[Arrival]()
        # the peer of an earlier datagram may not be there yet: an error of the past, not a loss
        with suppress(BlockingIOError, ConnectionRefusedError):
            while len(arrivals) < AT_ONCE:
                data, peer = self._socket.recvfrom(READ_BYTES)
                arrivals.append(Arrival(data, self.fixed_peer or peer, time.time_ns()))
        return arrivals

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


KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3}  # a loss shows within 11 s
USER_TIMEOUT_MS = 5000  # … also where our heartbeats wait for an acknowledgement
SILENT_S = (
    3.0  # a boat sends a heartbeat a second: a line that is silent for longer may be half open
)
BEGUN = (0, errno.EINPROGRESS)  # what `connect_ex` says of a connection that may come
MAX_CONNECTIONS = 16  # at once: peers may not use up the files of this process


class TcpClientTransport:
    """One connection at a time, to a server."""

    listens = False
    speaks_first = False

    def __init__(self, endpoint: Endpoint) -> None:
        self.address = endpoint.host_port()
        self._name = endpoint.text
        self.fixed_peer: Peer | None = endpoint.text
        self._socket: socket.socket | None = None
        self._selector: LineSelector | None = None
        self._heard = False  # anything, since it was opened

    def open(self, waker: Waker, report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        family, address = resolve(self.address, socket.SOCK_STREAM)
        self._heard = False
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        _prepare(self._socket)
        self._selector = LineSelector(waker)
        code = self._socket.connect_ex(address)
        if code not in BEGUN:  # an unreachable network is known at once, and asked for only once
            raise OSError(code, os.strerror(code))
        # the result is there when the socket can be written to
        self._selector.add(self._socket, events=selectors.EVENT_WRITE)
        if not self._selector.wait(timeout_s):
            raise TimeoutError("no answer")
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            raise OSError(error, os.strerror(error))
        self._selector.remove(self._socket)
        self._selector.add(self._socket)
        report(LinkEventKind.CONNECTED, "connected")

    def connected(self) -> tuple[Peer, ...]:
        return () if self._socket is None else (self._name,)

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        assert self._selector is not None
        assert self._socket is not None
        watched = self._heard and timeout_s is None
        if not self._selector.wait(SILENT_S if watched else timeout_s) and watched:
            raise TimeoutError(f"nothing came for {SILENT_S:.0f} s")
        with suppress(BlockingIOError):
            data = self._socket.recv(READ_BYTES)
            now = time.time_ns()
            if not data:
                raise ConnectionError("closed by the other side")
            self._heard = True
            return [Arrival(data, self._name, now)]
        return []

    def send(self, raw: bytes, peer: Peer) -> bool:
        return self._socket is not None and _send_whole(self._socket, raw)

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        if self._socket is not None:
            self._socket.close()
        self._selector = self._socket = None


class TcpServerTransport:
    """A listening socket and its connections; the loss of one leaves the others alone."""

    listens = True
    speaks_first = False
    fixed_peer: Peer | None = None

    def __init__(self, endpoint: Endpoint) -> None:
        self.address = endpoint.host_port()
        self._listener: socket.socket | None = None
        self._selector: LineSelector | None = None
        self._report: EventSink | None = None
        self._connections: dict[Peer, socket.socket] = {}

    def open(self, waker: Waker, report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        family, address = resolve(self.address, socket.SOCK_STREAM)
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setblocking(False)
        # connections of an earlier run may linger on this port for minutes
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.bind(address)
        self._listener.listen()
        self._report, self._selector = report, LineSelector(waker)
        self._selector.add(self._listener)
        report(LinkEventKind.LISTENING, "waiting for connections")

    def connected(self) -> tuple[Peer, ...]:
        return tuple(self._connections)

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        assert self._selector is not None
        arrivals = []
        for key in self._selector.wait(timeout_s):
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
            connection, peer = self._listener.accept()
        except (BlockingIOError, ConnectionError):
            return  # gone again
        if len(self._connections) >= MAX_CONNECTIONS:
            connection.close()
            return
        _prepare(connection)
        self._connections[peer] = connection
        self._selector.add(connection, peer)
        self._report(LinkEventKind.CONNECTED, f"{peer_text(peer)} connected")

    def _read(self, peer: Peer) -> list[Arrival]:
        try:
            data = self._connections[peer].recv(READ_BYTES)
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
        connection = self._connections.pop(peer)
        self._selector.remove(connection)
        connection.close()
        self._report(LinkEventKind.LOST, f"{peer_text(peer)} went away")

    def send(self, raw: bytes, peer: Peer) -> bool:
        connection = self._connections.get(peer)
        return connection is not None and _send_whole(connection, raw)

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        for line in (*self._connections.values(), self._listener):
            if line is not None:
                line.close()
        self._connections = {}
        self._selector = self._listener = None


def _prepare(connection: socket.socket) -> None:
    """Never wait in it, send at once, notice that the other side is dead."""
    connection.setblocking(False)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEPALIVE.items():
        if hasattr(socket, name):  # not every system has all three
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, USER_TIMEOUT_MS)


def _send_whole(connection: socket.socket, raw: bytes) -> bool:
    """Was it sent whole? A frame that a full line cut short fails its checksum at the other end."""
    try:
        return connection.send(raw) == len(raw)
    except OSError:
        return False


DEFAULT_BAUD = 115200  # as pymavlink assumes
SPEEDS = {
    int(name[1:]): getattr(termios, name)
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdigit() and int(name[1:]) > 0
}
IFLAG, OFLAG, CFLAG, LFLAG, ISPEED, OSPEED, CC = range(7)  # of termios.tcgetattr


class SerialTransport:
    """A device that may be unplugged and come back."""

    listens = False
    speaks_first = False

    def __init__(self, endpoint: Endpoint) -> None:
        """`/dev/NAME[,BAUD]`, and behind `serial:` also `/dev/NAME:BAUD`."""
        separator = ":" if endpoint.text.startswith("serial:") and ":" in endpoint.address else ","
        self.device, _, baud = endpoint.address.partition(separator)
        if not self.device.startswith("/"):
            raise ValueError("the device is missing")
        self.baud = positive_number(baud, "baud") if baud else DEFAULT_BAUD
        if self.baud not in SPEEDS:
            known = ", ".join(str(speed) for speed in sorted(SPEEDS) if speed >= 9600)
            raise BadInput(
                f'endpoint "{endpoint.text}": no baud rate {self.baud}; there is {known}'
            )
        self._name = endpoint.text
        self.fixed_peer: Peer | None = endpoint.text
        self._file: int | None = None
        self._selector: LineSelector | None = None

    def open(self, waker: Waker, report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        self._file = os.open(self.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        _make_raw(self._file, SPEEDS[self.baud])
        self._selector = LineSelector(waker)
        self._selector.add(self._file)
        report(LinkEventKind.CONNECTED, f"{self.device} is open at {self.baud} baud")

    def connected(self) -> tuple[Peer, ...]:
        return () if self._file is None else (self._name,)

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        assert self._selector is not None
        assert self._file is not None
        self._selector.wait(timeout_s)
        with suppress(BlockingIOError):
            data = os.read(self._file, READ_BYTES)
            now = time.time_ns()
            if not data:
                raise ConnectionError("the device is gone")
            return [Arrival(data, self._name, now)]
        return []

    def send(self, raw: bytes, peer: Peer) -> bool:
        file = self._file
        try:
            return file is not None and os.write(file, raw) == len(raw)
        except OSError:
            return False

    def close(self) -> None:
        if self._selector is not None:
            self._selector.close()
        file, self._file, self._selector = self._file, None, None
        if file is not None:
            os.close(file)


def _make_raw(file: int, speed: int) -> None:
    """Eight bits, no parity, no flow control, and above all no echo back to the boat."""
    try:
        mode = termios.tcgetattr(file)
        mode[IFLAG] = mode[OFLAG] = mode[LFLAG] = 0
        mode[CFLAG] = termios.CS8 | termios.CREAD | termios.CLOCAL
        mode[ISPEED] = mode[OSPEED] = speed
        mode[CC][termios.VMIN], mode[CC][termios.VTIME] = 1, 0
        termios.tcsetattr(file, termios.TCSANOW, mode)
        termios.tcflush(file, termios.TCIOFLUSH)
    except termios.error as error:
        raise OSError(error.args[0], f"not a serial device: {error.args[1]}") from None
