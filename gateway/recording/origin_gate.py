"""Who may open the Foxglove socket: pages that are listed, players that speak its subprotocol.

A browser lets any page connect to a WebSocket of this machine, and says in `Origin` which page that
is. The library behind the socket does not look at it. A gate stands in front: it reads the head of
each connection, refuses pages that nobody listed, and passes everything else on, byte for byte.
Programs that are no browser send no `Origin` and are let in. It also answers players that do not
speak the library's subprotocol: the library's own answer names no player that does. The library's
own port is on this machine alone, on Linux under a loopback address drawn by lot, so that a page
cannot find it beside the gate.
"""

import contextlib
import re
import secrets
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Self
from urllib.parse import urlsplit

MAX_CLIENTS = 32
MAX_TURNED_AWAY = 8  # at a time that are told why; of more the connection is closed
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


PROTOCOL = "foxglove.sdk.v1"
FULL = "close one, there is no place for more"
UPDATE = "update Foxglove, or Lichtblick (1.21 does not speak it, 1.29 does)"
FORBIDDEN = b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\n\r\n"


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
    found = _values_of("origin", head)
    if len(found) > 1:
        return ""
    return found[0] if found else None


def protocols_of(head: bytes) -> list[str]:
    """The subprotocols that the head of a request offers."""
    offered = ",".join(_values_of("sec-websocket-protocol", head)).split(",")
    return [text.strip() for text in offered if text.strip()]


def _values_of(wanted: str, head: bytes) -> list[str]:
    lines = head.decode("latin-1").split("\r\n")[1:]
    pairs = [line.partition(":") for line in lines]
    return [value.strip() for name, _, value in pairs if name.strip().lower() == wanted]


def _outdated(offered: Sequence[str]) -> bytes:
    """The answer to a player that does not speak our subprotocol."""
    asked = f"not {', '.join(offered)[:100]}" if offered else "and none was asked for"
    body = f"This server speaks the WebSocket subprotocol {PROTOCOL}, {asked}: {UPDATE}.\n"
    return _answer("400 Bad Request", body)


def _answer(status: str, body: str) -> bytes:
    """A refusal with a text for people."""
    raw = body.encode("latin-1")
    head = (
        f"HTTP/1.1 {status}\r\nConnection: close\r\n"
        f"Content-Type: text/plain; charset=iso-8859-1\r\nContent-Length: {len(raw)}\r\n\r\n"
    )
    return head.encode() + raw


def _full() -> bytes:
    """The answer to a player for which there is no place."""
    return _answer("503 Service Unavailable", f"{MAX_CLIENTS} players are connected: {FULL}.\n")


class OriginGate:
    """Listens while inside.

    refused   is called with the origin of each page kept out
    outdated  … with the subprotocols of each player that does not speak ours
    full      … for each player for which there is no place
    """

    def __init__(
        self,
        address: tuple[str, int],
        inner: tuple[str, int],
        origins: Sequence[str],
        refused: Callable[[str], None] = lambda origin: None,
        outdated: Callable[[str], None] = lambda protocols: None,
        full: Callable[[], None] = lambda: None,
    ) -> None:
        self._address, self._inner = address, inner
        self._origins, self._refused, self._outdated = tuple(origins), refused, outdated
        self._full = full
        self._lock = threading.Lock()
        self._open: set[socket.socket] = set()
        self._clients = self._turned_away = 0
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
            if (work := self._place_for(client)) is None:
                _hang_up(client)
            else:
                threading.Thread(target=work, args=(client,), daemon=True).start()

    def _place_for(self, client: socket.socket) -> Callable[[socket.socket], None] | None:
        """What is to be done with a client; None: nothing, there are too many of them."""
        with self._lock:
            full = self._clients >= MAX_CLIENTS
            if self._listener is None or (full and self._turned_away >= MAX_TURNED_AWAY):
                return None
            self._clients += not full
            self._turned_away += full
            self._open.add(client)
        return self._turn_away if full else self._serve

    def _turn_away(self, client: socket.socket) -> None:
        """Tell one more than there is a place for."""
        self._full()
        try:
            _head(client)
            _last_words(client, _full())
        except (OSError, ValueError):
            pass  # of this client alone
        finally:
            with self._lock:
                self._turned_away -= 1
                self._open.discard(client)
            _hang_up(client)

    def _serve(self, client: socket.socket) -> None:
        """One connection: its handshake, then both ways until one end hangs up."""
        inner: socket.socket | None = None
        try:
            head = _head(client)
            if answer := self._refusal(head):
                _last_words(client, answer)
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

    def _refusal(self, head: bytes) -> bytes | None:
        """What a client is told that is kept out; None: it is let in."""
        origin, offered = origin_of(head), protocols_of(head)
        if not allowed(origin, self._origins):
            self._refused(origin or "")
            return FORBIDDEN
        if PROTOCOL not in offered:
            self._outdated(", ".join(offered))
            return _outdated(offered)
        return None


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


def _last_words(client: socket.socket, answer: bytes) -> None:
    """An answer, after which nothing comes."""
    client.sendall(answer)
    client.shutdown(socket.SHUT_WR)
    client.recv(PIECE)  # what is left unread would take the answer away


def _hang_up(end: socket.socket) -> None:
    with contextlib.suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()
