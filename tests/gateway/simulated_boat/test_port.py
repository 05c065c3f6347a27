"""The boat's end of a link: which endpoints there are, and whether there is a listener."""

import socket
import time
from contextlib import suppress

import pytest

from gateway.errors import BadInput, ShadowError
from gateway.simulated_boat.play import (
    NOTICE_S,
    BoatPort,
    ListenerNotice,
    PlayStatus,
    boat_transport,
    play_until_stopped,
)
from tests.gateway.links.boats import Autopilot, free_port
from tests.sim.vessels import WAMV

HOST = "127.0.0.1"
PATIENCE_S = 10.0


def notices(*moments: tuple[float, str | None]) -> list[str]:
    """What is reported where, at these seconds, there is a listener (None) or none (why)."""
    reported: list[str] = []
    notice = ListenerNotice("tcp:a:1", reported.append)
    for seconds, reason in moments:
        notice.note(PlayStatus(seconds=seconds, no_listener=reason))
    return reported


def test_nothing_is_reported_where_a_listener_comes_in_time() -> None:
    assert notices((0.0, "x"), (NOTICE_S - 0.1, "x"), (NOTICE_S, None), (9.0, None)) == []


def test_no_listener_is_reported_once_and_a_listener_after_it() -> None:
    moments = [(0.1 * k, "no answer") for k in range(100)]
    assert notices(*moments) == ["tcp:a:1: no answer"]
    assert notices(*moments, (10.0, None)) == ["tcp:a:1: no answer", "tcp:a:1: connected"]


def test_a_listener_that_leaves_is_missed_after_as_long() -> None:
    gone = [(100.0, None), (100.1, "gone"), (100.0 + NOTICE_S - 0.1, "gone")]
    assert notices(*gone) == []
    assert notices(*gone, (100.0 + NOTICE_S, "gone")) == ["tcp:a:1: gone"]


def received(port: BoatPort, count: int = 1) -> list[bytes]:
    """What arrives at a port that is polled."""
    found: list[bytes] = []
    deadline = time.monotonic() + PATIENCE_S
    while len(found) < count:
        assert time.monotonic() < deadline, "nothing arrived"
        found += [arrival.data for arrival in port.receive()]
    return found


def wait_for_listener(port: BoatPort) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while port.no_listener is not None:
        assert time.monotonic() < deadline, port.no_listener
        port.receive()


def test_each_kind_of_port_knows_whether_it_has_a_listener() -> None:
    number = free_port(socket.SOCK_STREAM)
    with BoatPort(f"udpout:{HOST}:{number}") as port:
        assert port.no_listener is None  # datagrams do not show it
    with BoatPort(f"udpin:{HOST}:{number}") as port:
        assert port.no_listener == "nobody has spoken yet; waiting"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plug:
            plug.sendto(b"x", (HOST, number))
            assert received(port) == [b"x"]
            assert port.no_listener is None
    with BoatPort(f"tcp:{HOST}:{number}") as port:
        assert port.no_listener == "Connection refused; calling again every second"
        with socket.create_server((HOST, number)):
            port._retry_s = 0.0
            wait_for_listener(port)
    with BoatPort(f"tcpin:{HOST}:{number}") as port:
        assert port.no_listener == "nobody has called; waiting"
        with socket.create_connection((HOST, number)):
            wait_for_listener(port)
        deadline = time.monotonic() + PATIENCE_S
        while port.no_listener is None and time.monotonic() < deadline:
            port.receive()
        assert port.no_listener == "nobody has called; waiting"


def test_a_connection_that_breaks_is_opened_again_after_a_while() -> None:
    number = free_port(socket.SOCK_STREAM)
    with socket.create_server((HOST, number)) as server, BoatPort(f"tcp:{HOST}:{number}") as port:
        server.accept()[0].close()
        deadline = time.monotonic() + PATIENCE_S
        while port.no_listener is None and time.monotonic() < deadline:
            port.receive()
        assert port.no_listener == "closed by the other side; calling again every second"
        port._retry_s = 0.0
        wait_for_listener(port)
        port.send(b"again")
        server.settimeout(PATIENCE_S)
        with server.accept()[0] as plug:
            assert plug.recv(100) == b"again"


def test_a_slow_listener_loses_frames_and_the_boat_does_not_wait_for_it() -> None:
    """Its unread bytes are bounded; once it reads again, frames come whole again."""
    number, boat, count = free_port(socket.SOCK_STREAM), Autopilot(), 400_000
    with (
        BoatPort(f"tcpin:{HOST}:{number}") as port,
        socket.create_connection((HOST, number)) as plug,
    ):
        wait_for_listener(port)
        first, last = boat.attitude(), boat.attitude(time_ms=77)
        begun = time.monotonic()
        for _ in range(count):
            port.send(first)
        assert time.monotonic() - begun < PATIENCE_S
        plug.settimeout(0.01)
        read = b""
        while last not in read:
            assert time.monotonic() - begun < 2.0 * PATIENCE_S
            port.send(last)
            with suppress(TimeoutError):
                read += plug.recv(1 << 20)
    assert len(first) < len(read) < count * len(first) / 2


def test_a_port_that_is_taken_is_one_line() -> None:
    number = free_port()
    endpoint = f"udpin:{HOST}:{number}"
    with BoatPort(endpoint), pytest.raises(ShadowError, match="cannot open it: "):
        BoatPort(endpoint).__enter__()


@pytest.mark.parametrize(
    "endpoint",
    ["udp:a:1", "udpout:14550", "udpout:h:x", "tcp::1", "", "tcp", "serial:/dev/ttyUSB0",
     "/dev/ttyUSB0,57600", "udpin:h:65536"],
)  # fmt: skip
def test_an_endpoint_that_is_none_says_how_one_looks(endpoint: str) -> None:
    with pytest.raises(BadInput, match=r"udpout, udpin, tcpin, tcp .* udpout:127\.0\.0\.1:14550"):
        boat_transport(endpoint)


def test_the_command_reports_it(monkeypatch: pytest.MonkeyPatch) -> None:
    number = free_port(socket.SOCK_STREAM)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr("gateway.simulated_boat.play.NOTICE_S", 0.2)
    lines: list[str] = []
    play_until_stopped(
        WAMV, f"tcp:{HOST}:{number}", lines.append, program="mixed", system=1, fast=False, seed=0,
        seconds=0.5,
    )  # fmt: skip
    ready, plays, refused, *_, end = lines
    assert ready.startswith(f"making {WAMV.name} ready")
    assert plays == f"playing {WAMV.name} as system 1 on tcp:{HOST}:{number}; Ctrl-C ends"
    assert refused == f"tcp:{HOST}:{number}: Connection refused; calling again every second"
    assert end.startswith("played ")


def test_nothing_is_made_ready_to_play_where_there_is_no_place() -> None:
    lines: list[str] = []
    with pytest.raises(BadInput, match="expected"):
        play_until_stopped(WAMV, "127.0.0.1:9", lines.append, program="mixed", system=1, fast=False,
                           seed=0, seconds=0.5)  # fmt: skip
    assert lines == []
