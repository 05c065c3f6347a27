"""Frames over zenoh, published as mavlink-server does by its public source (`zenoh/raw.rs`).

Key `mavlink_raw/out`, encoding application/octet-stream;mavlink, one packet a sample; what comes on
`mavlink_raw/in` goes to the vehicle.
"""

import queue
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh

from gateway.bus import session_config
from gateway.errors import BadInput
from gateway.links import Inbox, LinkEventKind
from gateway.links.link import Link
from gateway.links.rate_requests import heartbeat
from gateway.links.transmitter import Identity
from tests.gateway.links.boats import PATIENCE_S, Autopilot, datagrams, event, free_port

OCTETS = zenoh.Encoding.APPLICATION_OCTET_STREAM.with_schema("mavlink")


class Server:
    """mavlink-server's side of the two keys."""

    def __init__(self, session: zenoh.Session) -> None:
        self.received: queue.Queue[bytes] = queue.Queue()
        self._out = session.declare_publisher(
            "mavlink_raw/out",
            encoding=OCTETS,
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.REAL_TIME,
            express=False,
        )
        self._in = session.declare_subscriber(
            "mavlink_raw/in", lambda sample: self.received.put(bytes(sample.payload))
        )

    def publish(self, *packets: bytes) -> None:
        for packet in packets:
            self._out.put(packet)


@contextmanager
def server(port: int) -> Iterator[Server]:
    config = session_config("router", {"listen": [f"tcp/127.0.0.1:{port}"]})
    with zenoh.open(config) as session:
        yield Server(session)


@pytest.fixture
def inbox() -> Inbox:
    return Inbox()


def eventually(happens: Any) -> None:
    until = time.monotonic() + PATIENCE_S
    while not happens():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_frames_come_as_they_were_published_and_ours_go_back(inbox: Inbox) -> None:
    boat, port = Autopilot(), free_port(socket.SOCK_STREAM)
    with server(port) as far, Link(_at(port), inbox, Identity()) as link:
        event(inbox, LinkEventKind.CONNECTED)
        eventually(lambda: _heard(far, inbox, boat))
        before = link.counts().frames
        sent = [boat.heartbeat(), boat.attitude(), boat.attitude()]
        far.publish(*sent)
        found = datagrams(inbox, 3)
        assert [frame.raw for one in found for frame in one.frames] == sent
        assert link.counts().frames == before + 3
        assert link.send_message(heartbeat())
        assert far.received.get(timeout=PATIENCE_S)[0] == 0xFD


def test_a_silent_link_sends_nothing(inbox: Inbox) -> None:
    boat, port = Autopilot(), free_port(socket.SOCK_STREAM)
    with server(port) as far, Link(_at(port), inbox) as link:
        event(inbox, LinkEventKind.CONNECTED)
        eventually(lambda: _heard(far, inbox, boat))
        assert not link.send_message(heartbeat())
        assert far.received.empty()


def test_frames_cut_anywhere_and_junk_between_them_are_found(inbox: Inbox) -> None:
    boat, port = Autopilot(), free_port(socket.SOCK_STREAM)
    with server(port) as far, Link(_at(port), inbox):
        event(inbox, LinkEventKind.CONNECTED)
        eventually(lambda: _heard(far, inbox, boat))
        frame = boat.attitude()
        far.publish(frame[:9], frame[9:], b"junk" * 20, b"", boat.heartbeat())
        found = datagrams(inbox, 2)
        assert [f.message.get_type() for one in found for f in one.frames] == [
            "ATTITUDE", "HEARTBEAT",
        ]  # fmt: skip


def test_a_router_that_is_not_there_is_tried_again(inbox: Inbox) -> None:
    boat, port = Autopilot(), free_port(socket.SOCK_STREAM)
    with Link(_at(port), inbox):
        lost = event(inbox, LinkEventKind.LOST)
        assert f"no zenoh router at tcp/127.0.0.1:{port}" in lost.text
        with server(port) as far:
            event(inbox, LinkEventKind.CONNECTED)
            eventually(lambda: _heard(far, inbox, boat))


def test_a_router_that_goes_and_comes_back_is_joined_again(inbox: Inbox) -> None:
    boat, port = Autopilot(), free_port(socket.SOCK_STREAM)
    with Link(_at(port), inbox):
        for _ in range(2):
            with server(port) as far:
                eventually(lambda far=far: _heard(far, inbox, boat))


def test_a_key_with_wildcards_is_refused(inbox: Inbox) -> None:
    with pytest.raises(BadInput, match="no zenoh key without wildcards"):
        Link("zenoh:mavlink/**", inbox)


def _at(port: int) -> str:
    return f"zenoh:mavlink_raw/out@tcp/127.0.0.1:{port}"


def _heard(far: Server, inbox: Inbox, boat: Autopilot) -> bool:
    """Publish until the subscription has reached the other side; nothing is left in the inbox."""
    far.publish(boat.heartbeat())
    time.sleep(0.2)
    before = len(inbox)
    while len(inbox):
        inbox.get(0)
    return before > 0
