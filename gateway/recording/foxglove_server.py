"""A live Foxglove WebSocket: the channels of a recording, as they are made.

It listens at [HOST:]PORT, on this machine alone by default. The library's threads serve the
sockets; the loop only hands messages over, and only those that somebody asked for. It never waits:
a client that is too slow loses the oldest of its backlog. Clients can do nothing but subscribe. The
boat of the first vessel has the topics of a recording, so that the same layout fits; those of other
boats begin with their names.

A browser lets any page connect to a WebSocket of this machine, and says in `Origin` which page that
is. The library behind the socket does not look at it. A gate stands in front: it reads the head of
each connection, refuses pages that nobody listed, and passes everything else on, byte for byte.
Programs that are no browser send no `Origin` and are let in. The library's own port is on this
machine alone, on Linux under a loopback address drawn by lot, so that a page cannot find it beside
the gate.
"""

import contextlib
import ipaddress
import logging
import re
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Thread
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.errors import BadInput, ShadowError
from gateway.json_rows import TopicRows
from gateway.recording import foxglove
from gateway.recording.foxglove import PlayerRows
from gateway.recording.recorder import JSON, JSON_SCHEMA
from gateway.topics import TOPICS

MAX_CLIENTS = 32
ACCEPT_AGAIN_S = 0.1  # after a connection could not be taken
MAX_HEAD_BYTES = 16_384
HEAD_TIMEOUT_S = 5.0  # for the handshake of a client, all of it: one that trickles keeps others out
PIECE = 65_536
LOCAL = ("localhost", "127.0.0.1", "::1")
# Pages that players are served from, and "file://": programs of the desktop, as those two are.
ORIGINS = (
    "file://",
    "https://app.foxglove.dev",
    "https://studio.foxglove.dev",
    "https://lichtblick-suite.github.io",
)
ORIGIN = re.compile(r"[a-z][a-z0-9+.-]*://[^\s/]*")  # scheme, host, perhaps a port


def inner_host() -> str:
    """A loopback address that nobody guesses; where there is only one, that."""
    if not sys.platform.startswith("linux"):
        return "127.0.0.1"
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


def allowed(origin: str | None, origins: Sequence[str]) -> bool:
    """May a page of that origin connect? Pages served by this machine may."""
    if origin is None or origin in origins:
        return True
    try:
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.hostname in LOCAL
    except ValueError:
        return False


def origin_of(head: bytes) -> str | None:
    """The `Origin` in the head of a request; None without one, "" where there are several."""
    lines = head.decode("latin-1").split("\r\n")[1:]
    pairs = [line.partition(":") for line in lines]
    found = [value.strip() for name, _, value in pairs if name.strip().lower() == "origin"]
    if len(found) > 1:
        return ""
    return found[0] if found else None


class OriginGate:
    """Listens while inside; `refused` is called with the origin of each page kept out."""

    def __init__(
        self,
        address: tuple[str, int],
        inner: tuple[str, int],
        origins: Sequence[str],
        refused: Callable[[str], None] = lambda origin: None,
    ) -> None:
        self._address, self._inner = address, inner
        self._origins, self._refused = tuple(origins), refused
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        self._clients = 0
        self._listener: socket.socket | None = None

    def __enter__(self) -> Self:
        host, port = self._address
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        self._listener = socket.create_server((host, port), family=family)
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            ends, self._open = [*self._open], set()
            listener, self._listener = self._listener, None
        for end in [*ends, *([listener] if listener else [])]:
            _hang_up(end)

    @property
    def port(self) -> int:
        """The TCP port that it listens on."""
        assert self._listener is not None
        return int(self._listener.getsockname()[1])

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:  # closed; or the client is gone again, or no more files may be opened
                if self._listener is None:
                    return
                time.sleep(ACCEPT_AGAIN_S)
                continue
            with self._lock:
                full = self._clients >= MAX_CLIENTS or self._listener is None
                self._clients += not full
                if not full:
                    self._open.add(client)
            if full:
                _hang_up(client)
            else:
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        """One connection: its handshake, then both ways until one end hangs up."""
        inner: socket.socket | None = None
        try:
            head = _head(client)
            origin = origin_of(head)
            if not allowed(origin, self._origins):
                self._refused(origin or "")
                client.sendall(b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\n\r\n")
                client.shutdown(socket.SHUT_WR)
                client.recv(PIECE)  # what is left unread would take the answer away
                return
            inner = socket.create_connection(self._inner, HEAD_TIMEOUT_S)
            with self._lock:
                self._open.add(inner)
            for end in (client, inner):
                end.settimeout(None)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            inner.sendall(head)
            back = threading.Thread(target=_pass_on, args=(inner, client), daemon=True)
            back.start()
            _pass_on(client, inner)
            back.join()
        except (OSError, ValueError):
            pass  # of this client alone
        finally:
            with self._lock:
                self._clients -= 1
                self._open -= {client, inner}
            for end in filter(None, (client, inner)):
                _hang_up(end)


def _head(client: socket.socket) -> bytes:
    """What a client sends until the empty line; ValueError where that is too much or too late."""
    until, head = time.monotonic() + HEAD_TIMEOUT_S, b""
    while b"\r\n\r\n" not in head:
        client.settimeout(max(until - time.monotonic(), 0.001))
        piece = client.recv(4096)
        head += piece
        if not piece or len(head) > MAX_HEAD_BYTES:
            raise ValueError("no handshake")
    return head


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    """Copy until one end hangs up; then the other does."""
    with contextlib.suppress(OSError):
        while piece := source.recv(PIECE):
            target.sendall(piece)
    for end in (source, target):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


def _hang_up(end: socket.socket) -> None:
    with contextlib.suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()


HOST = "127.0.0.1"


def parse_address(text: str, what: str = "Foxglove server") -> tuple[str, int]:
    """ "8765", "0.0.0.0:8765" or "[::1]:8765" -> host, port; port 0 is any that is free."""
    host, mark, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") if mark else HOST
    if not host or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise BadInput(f'{what} on "{text}": expected [HOST:]PORT, as in 8765')
    return host, int(port)


def on_this_machine(host: str) -> bool:
    """Does nobody else reach that address?"""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


BACKLOG = 1024  # messages that wait for one client: about three seconds of a boat at 50 Hz
MAX_TOLD = 8  # pages that were refused and are named
STOP_S = 0.5  # a client that does not read would hold up the end
NAME = "digital shadow"


class BoatView:
    """The channels of one boat; `prefix` is its name where the topics are another's."""

    def __init__(self, sdk: Any, context: Any, rate_hz: float, prefix: str) -> None:
        self._sdk, self._context = sdk, context
        start = f"{prefix}/" if prefix else ""
        known = [foxglove.named(c, prefix) if prefix else c for c in foxglove.CHANNELS]
        self._topics = {
            name: self._channel(f"{start}{name}", topic.schema, orjson.dumps(topic.json_schema()))
            for name, topic in TOPICS.items()
        }
        self._known = {
            c.topic: self._channel(c.topic, c.schema, foxglove.schema_text(c.schema)) for c in known
        }
        self._players = PlayerRows(rate_hz, known)

    def show(self, rows: Sequence[TopicRows]) -> None:
        """Send messages to the players that have subscribed; without any, nothing is made."""
        for part in rows:
            channel, times = self._topics[part.topic], part.receive_time_ns
            if channel.has_sinks():
                self._log(channel, times, part.payloads)
            for shown in self._players.of(part, self._wanted):
                self._log(self._known[shown.channel.topic], times[shown.rows], shown.payloads)

    def _wanted(self, channel: foxglove.Channel) -> bool:
        return bool(self._known[channel.topic].has_sinks())

    def _log(self, channel: Any, times: NDArray[np.int64], payloads: Sequence[bytes]) -> None:
        for time_ns, payload in zip(times.tolist(), payloads, strict=True):
            channel.log(payload, log_time=time_ns)

    def _channel(self, topic: str, schema: str, text: bytes) -> Any:
        described = self._sdk.Schema(name=schema, encoding=JSON_SCHEMA, data=text)
        return self._sdk.Channel(
            topic, schema=described, message_encoding=JSON, context=self._context
        )


class FoxgloveServer:
    """Listens while inside.

    address   [HOST:]PORT
    origins   of web pages that may connect, beside `ORIGINS` and those of this machine
    progress  is told of pages that were refused
    """

    def __init__(
        self,
        address: str,
        rate_hz: float,
        origins: Sequence[str] = (),
        progress: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.host, self._port = parse_address(address)
        self._rate_hz = rate_hz
        self._origins, self._progress = (*ORIGINS, *origins), progress
        self._server: Any = None
        self._gate: OriginGate | None = None
        self._refused: set[str] = set()
        self._plain_given = False

    def __enter__(self) -> Self:
        self._sdk = _library()
        self._context = self._sdk.Context()
        inner = inner_host()
        try:
            self._server = self._sdk.start_server(
                name=NAME, host=inner, port=0, context=self._context, message_backlog_size=BACKLOG,
            )  # fmt: skip
            inside = inner, int(self._server.port)
            gate = OriginGate((self.host, self._port), inside, self._origins, self._refuse)
            self._gate = gate.__enter__()
        except (RuntimeError, OSError) as error:
            self.__exit__()
            why = (getattr(error, "strerror", None) or str(error)).split(" (")[0]
            raise BadInput(
                f"Foxglove server on {self.host}:{self._port}: cannot listen there: {why}; "
                "is another program using the port?"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        gate, self._gate = self._gate, None
        if gate is not None:
            gate.__exit__()
        server, self._server = self._server, None
        if server is None:  # the library does not stand being stopped twice
            return
        ending = Thread(target=server.stop, name="foxglove", daemon=True)
        ending.start()
        ending.join(STOP_S)

    @property
    def port(self) -> int:
        """The TCP port that it listens on."""
        assert self._gate is not None
        return self._gate.port

    @property
    def text(self) -> str:
        """The address to connect to, and from where that is possible, in words."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        others = "" if on_this_machine(self.host) else ", for everyone who reaches this machine"
        return f"Foxglove WebSocket on ws://{host}:{self.port}{others}"

    def _refuse(self, origin: str) -> None:
        """Tell of a page that was refused, once for each of the first few."""
        if origin not in self._refused and len(self._refused) < MAX_TOLD:
            self._refused.add(origin)
            self._progress(
                f"Foxglove: a web page of {origin[:100] or 'several origins'} was refused; "
                "origins under [foxglove] in gateway.toml lists those that may watch"
            )

    def boat(self, name: str, leading: bool) -> BoatView:
        """Channels for a boat; the first leading one has the topics of a recording."""
        plain = leading and not self._plain_given
        self._plain_given |= plain
        return BoatView(self._sdk, self._context, self._rate_hz, "" if plain else name)


def _library() -> Any:
    """Loaded only where it is wanted: it is large. What it has to say of strangers is left out."""
    try:
        import foxglove as sdk
    except ImportError as error:
        raise ShadowError(
            f"the Foxglove server needs the library foxglove-sdk ({error}): "
            "pip install foxglove-sdk, or do without --foxglove"
        ) from None
    log = logging.getLogger("foxglove")
    log.addHandler(logging.NullHandler())
    log.propagate = False
    return sdk
