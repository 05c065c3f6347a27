"""The table of live sources: every form of a connection string, and one line for what is none."""

import socket
from unittest.mock import MagicMock

import pytest

from gateway.errors import BadInput
from gateway.links import Endpoint, Waker, link
from gateway.links.link import ALIASES, SOURCES, LinkSource, opening, transport_of
from gateway.links.transports import (
    AT_ONCE,
    DEFAULT_BAUD,
    SerialTransport,
    TcpClientTransport,
    TcpServerTransport,
    UdpTransport,
    free_udp_port,
)
from gateway.links.zenoh_key import ZenohTransport
from gateway.live import gateway
from tests.conftest import ROOT


@pytest.mark.parametrize(
    ("text", "kind", "listens", "address"),
    [
        ("udpin:0.0.0.0:14550", UdpTransport, True, ("0.0.0.0", 14550)),
        ("udp:127.0.0.1:14550", UdpTransport, True, ("127.0.0.1", 14550)),
        ("udpout:boat.local:14551", UdpTransport, False, ("boat.local", 14551)),
        ("udpin:[::1]:14550", UdpTransport, True, ("::1", 14550)),
        ("tcp:10.0.0.2:5760", TcpClientTransport, False, ("10.0.0.2", 5760)),
        ("tcpin:127.0.0.1:5770", TcpServerTransport, True, ("127.0.0.1", 5770)),
        ("/dev/ttyUSB0", SerialTransport, False, ("/dev/ttyUSB0", DEFAULT_BAUD)),
        ("/dev/ttyUSB0,57600", SerialTransport, False, ("/dev/ttyUSB0", 57600)),
        ("serial:/dev/ttyACM0:921600", SerialTransport, False, ("/dev/ttyACM0", 921600)),
        ("serial:/dev/ttyACM0,9600", SerialTransport, False, ("/dev/ttyACM0", 9600)),
        ("serial:/dev/ttyACM0", SerialTransport, False, ("/dev/ttyACM0", DEFAULT_BAUD)),
    ],
)
def test_every_form(text, kind, listens, address):
    transport = transport_of(text)
    assert type(transport) is kind
    assert transport.listens is listens
    assert transport.speaks_first is (kind is UdpTransport and not listens)
    assert transport.fixed_peer == (None if listens else text)
    found = (transport.device, transport.baud) if kind is SerialTransport else transport.address
    assert found == address


@pytest.mark.parametrize(
    "text",
    ["", "14550", "udpin", "udpin:", "udpin:14550", "udpin:host:", "udpin:host:0", "udpin:host:x",
     "udpin:host:65536", "udpin:host:-1", "udpin:host:１４", "mcast:14550", "serial:",
     "zenoh:", "zenoh:mavlink raw", "zenoh:**", "zenoh:a//b", "zenoh:/a", "zenoh:a@host",
     "serial:COM3", "COM3", "/dev/ttyUSB0,fast", "tcp::5760", "UDPIN:host:1"],
)  # fmt: skip
def test_a_wrong_one_lists_the_forms_that_exist(text):
    with pytest.raises(BadInput) as caught:
        transport_of(text)
    line = str(caught.value)
    assert f'"{text}"' in line
    assert all(source.form in line for source in SOURCES)
    assert "\n" not in line


@pytest.mark.parametrize(
    ("text", "key", "router", "answer"),
    [
        ("zenoh:mavlink_raw/out", "mavlink_raw/out", "tcp/127.0.0.1:7447", "mavlink_raw/in"),
        ("zenoh:a/out@tcp/10.0.0.2:7448", "a/out", "tcp/10.0.0.2:7448", "a/in"),
        ("zenoh:frames@udp/[::1]:1", "frames", "udp/[::1]:1", None),
    ],
)
def test_a_zenoh_key_and_its_router(text, key, router, answer):
    transport = transport_of(text)
    assert type(transport) is ZenohTransport
    assert (transport.key, transport.router, transport.answer_key) == (key, router, answer)
    assert not transport.listens
    assert not transport.speaks_first


@pytest.mark.parametrize(
    ("endpoints", "says"),
    [
        (["tcp:h:5760"], "connecting to tcp:h:5760"),
        (["udp:h:1", "tcp:h:2", "tcpin:h:3"],
         "listening on udp:h:1, tcpin:h:3, connecting to tcp:h:2"),
        (["/dev/ttyUSB0,57600", "zenoh:a/out"], "reading /dev/ttyUSB0,57600, zenoh:a/out"),
        (["udpout:h:1"], "calling udpout:h:1"),
    ],
)  # fmt: skip
def test_what_a_program_begins_to_do_on_its_links_is_true(endpoints, says):
    assert opening(endpoints) == says


def test_live_says_that_it_dials_where_it_does(monkeypatch):
    class Nothing:
        def __init__(self, plans, options, progress):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def run(self, stop):
            pass

        def unfinished(self):
            return []

        def left(self):
            return []

    said = []
    for name, stand_in in (
        ("Gateway", Nothing), ("stop_on_signals", lambda: None), ("gc", MagicMock()),
        ("sys", MagicMock()),
    ):  # fmt: skip
        monkeypatch.setattr(gateway, name, stand_in)
    gateway.run_until_stopped([], gateway.LiveOptions(("tcp:h:5760",), None), said.append)
    assert "connecting to tcp:h:5760; Ctrl-C ends" in said


def test_a_plug_in_adds_a_kind_of_link(monkeypatch):
    class Point:
        def __init__(self, value):
            self.load = lambda: value

    class Loopback:
        def __init__(self, endpoint: Endpoint) -> None:
            if not endpoint.address:
                raise ValueError("the name is missing")
            self.address = endpoint.address

    plugged = LinkSource("loop", "loop:NAME", "a queue within the process", Loopback)
    points = [Point(plugged), Point("something else")]
    monkeypatch.setattr(
        link, "entry_points", lambda group: points if group == "shadow.links" else []
    )
    link.known_sources.cache_clear()
    try:
        assert transport_of("loop:a").address == "a"
        assert isinstance(transport_of("udp:h:1"), UdpTransport)
        with pytest.raises(BadInput, match=r"the name is missing; expected udpin.*, loop:NAME"):
            transport_of("loop:")
    finally:
        link.known_sources.cache_clear()


def test_the_docs_describe_every_kind():
    text = (ROOT / "docs" / "live.md").read_text()
    for source in SOURCES:
        form = "/dev/ttyUSB0,57600" if source.kind == "serial" else source.form
        assert f"| `{form}` | {source.description}" in text
    assert all(f"`{alias}:HOST:PORT` is the same" in text for alias in ALIASES)


def test_a_refusal_names_the_short_forms():
    with pytest.raises(BadInput, match=r"; udp: is udpin:$"):
        transport_of("http:a:1")


def test_datagrams_that_wait_are_read_one_after_the_other_with_one_wait():
    port = free_udp_port()
    transport = transport_of(f"udpin:127.0.0.1:{port}")
    with Waker() as waker, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as boat:
        transport.open(waker, lambda kind, text: None)
        for k in range(AT_ONCE + 3):
            boat.sendto(bytes([k]), ("127.0.0.1", port))
        arrivals = [transport.receive(5.0) for _ in range(2)]
        assert transport.receive(0.0) == []
        transport.close()
    assert [len(read) for read in arrivals] == [AT_ONCE, 3]
    heard = [arrival for read in arrivals for arrival in read]
    assert [arrival.data[0] for arrival in heard] == list(range(AT_ONCE + 3))
    receipts = [arrival.receive_time_ns for arrival in heard]
    assert receipts == sorted(receipts)
