"""Which pages may open the Foxglove socket; everything else passes the gate byte for byte."""

import errno
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from gateway.config import FoxgloveSettings
from gateway.errors import BadInput
from gateway.recording import origin_gate
from gateway.recording.foxglove_server import MAX_TOLD, FoxgloveServer
from gateway.recording.origin_gate import (
    MAX_CLIENTS,
    MAX_HEAD_BYTES,
    ORIGINS,
    PROTOCOL,
    OriginGate,
    allowed,
    inner_host,
    origin_of,
    protocols_of,
)

PATIENCE_S = 10.0


@pytest.mark.parametrize(
    ("origin", "may"),
    [
        (None, True),
        ("file://", True),
        ("https://app.foxglove.dev", True),
        ("http://localhost:8080", True),
        ("http://127.0.0.1:3000", True),
        ("http://[::1]:3000", True),
        ("https://evil.example", False),
        ("https://app.foxglove.dev.evil.example", False),
        ("http://localhost.evil.example", False),
        ("http://evil.example#localhost", False),
        ("null", False),
        ("", False),
        ("http://[", False),
        ("chrome-extension://localhost", False),
    ],
)
def test_pages_by_their_origin(origin: str | None, may: bool) -> None:
    assert allowed(origin, ORIGINS) is may


def test_the_origin_is_found_in_a_head_however_it_is_written() -> None:
    head = b"GET / HTTP/1.1\r\nHost: a\r\n%s\r\n\r\n"
    assert origin_of(head % b"oRiGiN:  https://a ") == "https://a"
    assert origin_of(head % b"X-Origin: https://a") is None
    assert origin_of(head % b"Origin: https://a\r\nOrigin: file://") == ""


@contextmanager
def echo() -> Iterator[tuple[str, int]]:
    """A server that gives back what it gets."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve(line: socket.socket) -> None:
            with line, suppress(OSError):
                while piece := line.recv(4096):
                    line.sendall(piece)

        def run() -> None:
            while True:
                try:
                    line, _ = listener.accept()
                except OSError:
                    return
                threading.Thread(target=serve, args=(line,), daemon=True).start()

        threading.Thread(target=run, daemon=True).start()
        yield listener.getsockname()[:2]
        listener.shutdown(socket.SHUT_RDWR)


def ask(
    port: int, origin: str | None, protocols: str | None = PROTOCOL
) -> tuple[socket.socket, bytes]:
    """A handshake, in two pieces -> the connection and what was sent."""
    line = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
    said = b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n"
    said += b"" if origin is None else f"Origin: {origin}\r\n".encode()
    said += b"" if protocols is None else f"Sec-WebSocket-Protocol: {protocols}\r\n".encode()
    line.sendall(said)
    line.sendall(b"\r\nand more")
    return line, said + b"\r\nand more"


def heard(line: socket.socket, count: int) -> bytes:
    found = b""
    while len(found) < count and (piece := line.recv(4096)):
        found += piece
    return found


def test_listed_pages_pass_and_others_are_told_to_go() -> None:
    refused: list[str] = []
    with (
        echo() as inner,
        OriginGate(("127.0.0.1", 0), inner, ["https://ours"], refused.append) as gate,
    ):
        for origin in (None, "https://ours"):
            line, said = ask(gate.port, origin)
            with line:
                assert heard(line, len(said)) == said
                for _ in range(20):
                    line.sendall(b"x" * 30_000)
                    assert heard(line, 30_000) == b"x" * 30_000
        line, _ = ask(gate.port, "https://theirs")
        with line:
            assert heard(line, 1000).startswith(b"HTTP/1.1 403 ")
    assert refused == ["https://theirs"]


def test_a_connection_that_cannot_be_taken_does_not_close_the_gate() -> None:
    """No more files may be opened for a moment, or a client is gone before it is taken."""
    with echo() as inner, OriginGate(("127.0.0.1", 0), inner, []) as gate:
        assert gate._listener is not None
        good, failed = gate._listener, threading.Event()

        class Starved:
            def accept(self) -> tuple[socket.socket, object]:
                if failed.is_set():
                    return good.accept()
                failed.set()
                raise OSError(errno.EMFILE, "Too many open files")

        threading.Thread(target=gate._accept, args=(Starved(),), daemon=True).start()
        assert failed.wait(PATIENCE_S)
        for _ in range(4):  # the first listener's thread and the starved one's take turns
            line, said = ask(gate.port, None)
            with line:
                assert heard(line, len(said)) == said


def test_no_handshake_no_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(origin_gate, "HEAD_TIMEOUT_S", 0.2)
    with echo() as inner, OriginGate(("127.0.0.1", 0), inner, []) as gate:
        for said in (b"", b"GET / HT", b"x" * (MAX_HEAD_BYTES + 5000)):
            with socket.create_connection(("127.0.0.1", gate.port), PATIENCE_S) as line:
                line.sendall(said)
                with suppress(ConnectionResetError):
                    assert line.recv(100) == b""


def test_a_handshake_that_trickles_in_does_not_hold_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(origin_gate, "HEAD_TIMEOUT_S", 0.5)
    with (
        echo() as inner,
        OriginGate(("127.0.0.1", 0), inner, []) as gate,
        socket.create_connection(("127.0.0.1", gate.port), PATIENCE_S) as line,
    ):
        begun, hung_up = time.monotonic(), False
        while not hung_up and time.monotonic() - begun < PATIENCE_S:
            time.sleep(0.05)  # well within the time that one read may take
            try:
                line.sendall(b"x")
            except OSError:
                hung_up = True
    assert hung_up


def test_clients_are_bounded_and_leave_room_when_they_go() -> None:
    full: list[None] = []
    told = {"full": lambda: full.append(None)}
    with echo() as inner, OriginGate(("127.0.0.1", 0), inner, [], **told) as gate:
        lines = [ask(gate.port, None) for _ in range(MAX_CLIENTS)]
        for line, said in lines:
            assert heard(line, len(said)) == said
        assert not full
        one_more, _ = ask(gate.port, None)
        with one_more:
            answer = heard(one_more, 10_000)
        assert answer.startswith(b"HTTP/1.1 503 ")
        assert b"32 players are connected: close one" in answer
        assert len(full) == 1
        for line, _ in lines:
            line.close()
        deadline = time.monotonic() + PATIENCE_S
        while gate._clients:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        line, said = ask(gate.port, None)
        with line:
            assert heard(line, len(said)) == said


def test_the_end_hangs_up_on_everybody() -> None:
    with echo() as inner, OriginGate(("127.0.0.1", 0), inner, []) as gate:
        line, said = ask(gate.port, None)
        assert heard(line, len(said)) == said
    with line:
        assert line.recv(10) == b""


def test_the_socket_behind_the_gate_is_on_this_machine() -> None:
    host = inner_host()
    assert host.startswith("127.")
    with socket.create_server((host, 0)):
        pass


def test_the_server_refuses_pages_and_says_so_a_few_times() -> None:
    told: list[str] = []
    with FoxgloveServer("0", 10.0, ["https://mine.example"], told.append) as server:
        for k in range(MAX_TOLD + 3):
            line, _ = ask(server.port, f"https://{k}.example")
            with line:
                assert heard(line, 1000).startswith(b"HTTP/1.1 403 ")
        line, _ = ask(server.port, "https://mine.example")
        with line:
            assert b"403" not in heard(line, 12)
    assert len(told) == MAX_TOLD
    assert told[0].startswith("Foxglove: a web page of https://0.example was refused; origins")


def test_subprotocols_are_found_however_they_are_offered() -> None:
    head = b"GET / HTTP/1.1\r\nHost: a\r\n%s\r\n\r\n"
    assert protocols_of(head % b"sec-websocket-PROTOCOL: a, b,") == ["a", "b"]
    assert protocols_of(head % b"Sec-WebSocket-Protocol: a\r\nSec-WebSocket-Protocol: b") == [
        "a",
        "b",
    ]
    assert protocols_of(head % b"X: a") == []


@pytest.mark.parametrize(
    ("protocols", "says", "told"),
    [
        ("foxglove.websocket.v1", "not foxglove.websocket.v1", "speaks foxglove.websocket.v1 was"),
        (None, "and none was asked for", "speaks no subprotocol was"),
    ],
)
def test_a_player_of_another_subprotocol_is_told_which_one_is_spoken(
    protocols: str | None, says: str, told: str
) -> None:
    lines: list[str] = []
    with FoxgloveServer("0", 10.0, progress=lines.append) as server:
        for _ in range(3):
            line, _ = ask(server.port, "https://app.foxglove.dev", protocols)
            with line:
                head, _, body = heard(line, 10_000).decode().partition("\r\n\r\n")
            assert head.startswith("HTTP/1.1 400 ")
            assert f"Content-Length: {len(body)}" in head
            assert body.startswith(
                f"This server speaks the WebSocket subprotocol {PROTOCOL}, {says}"
            )
            assert "Lichtblick (1.21 does not speak it, 1.29 does)" in body
        for k in range(MAX_TOLD + 3):
            line, _ = ask(server.port, None, f"v{k}")
            with line:
                assert heard(line, 12)[:12] == b"HTTP/1.1 400"
    assert len(lines) == MAX_TOLD
    assert sum(told in text for text in lines) == 1
    assert PROTOCOL in lines[0]


def test_a_player_that_offers_both_subprotocols_is_let_in() -> None:
    with echo() as inner, OriginGate(("127.0.0.1", 0), inner, []) as gate:
        line, said = ask(gate.port, None, f"foxglove.websocket.v1, {PROTOCOL}")
        with line:
            assert heard(line, len(said)) == said


def test_an_origin_that_is_none_is_bad_input() -> None:
    assert FoxgloveSettings("1", ("https://a.example:8443",)).origins
    with pytest.raises(BadInput, match="expected such as https://example"):
        FoxgloveSettings("1", ("a.example/page",))


def test_that_there_is_no_place_is_told_once_in_a_while() -> None:
    told: list[str] = []
    server = FoxgloveServer("0", 10.0, progress=told.append)
    for _ in range(3):
        server._tell_full()
    (line,) = told
    assert str(line).startswith("Foxglove: 32 players are connected, and one more was refused")
