"""Whatever a stranger sends, the receiver goes on; and what we send is only what is documented."""

import contextlib
import socket
import time
from queue import Empty

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.links import Datagram, Inbox, LinkEventKind
from gateway.links.link import Link
from gateway.links.rate_requests import LinkRequests, heartbeat
from gateway.links.transmitter import Identity, Transmitter, permitted, signing_timestamp
from tests.gateway.links.boats import (
    PATIENCE_S,
    Autopilot,
    datagrams,
    decoded,
    event,
    free_port,
    udp_socket,
)  # fmt: skip
from tests.gateway.links.test_framing import UNKNOWN

KEY = bytes(range(32))
NAN, INF = float("nan"), float("inf")


@pytest.fixture
def inbox():
    return Inbox()


@pytest.fixture(scope="module")
def open_link():
    inbox, port = Inbox(), free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        yield inbox, link, line
    assert link.counts().faults == 0


NOISE = st.one_of(
    st.binary(max_size=600),
    st.binary(max_size=30).map(lambda tail: b"\xfd" + tail),
    st.integers(1, 9000).map(lambda n: b"\xfd" * n),
    st.tuples(st.integers(0, 39), st.integers(1, 255)).map(
        lambda change: bytes(
            b ^ change[1] if k == change[0] else b for k, b in enumerate(Autopilot().attitude(3))
        )
    ),
)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(NOISE, max_size=5))
def test_random_datagrams_do_not_keep_the_next_good_one_away(open_link, noise):
    inbox, _, line = open_link
    for data in noise:
        line.send(data)
    good = Autopilot(7).attitude(len(noise))
    line.send(good)
    while True:
        found = [frame.raw for frame in datagrams(inbox, 1)[0].frames]
        if good in found:
            break


def test_empty_and_huge_datagrams(open_link):
    inbox, link, line = open_link
    before = link.counts()
    line.send(b"")
    line.send(bytes(65507))
    line.send(Autopilot().attitude() * 1600)
    assert len(datagrams(inbox, 1)[0].frames) == 1600
    counts = link.counts()
    assert counts.datagrams == before.datagrams + 3
    assert counts.junk_bytes == before.junk_bytes + 65507


def test_nan_and_absurd_fields_pass_as_they_are(open_link):
    inbox, _, line = open_link
    boat = Autopilot()
    line.send(boat.frame(dialect.MAVLink_attitude_message(2**32 - 1, NAN, INF, -INF, 1e38, 0, NAN)))
    line.send(boat.frame(dialect.MAVLink_statustext_message(6, b"\xff\xfe\x80")))
    first, second = datagrams(inbox, 2)
    assert first.frames[0].message.yaw == -INF
    assert first.frames[0].message.roll != first.frames[0].message.roll
    assert second.frames[0].message.get_type() == "STATUSTEXT"


def test_unknown_ids_are_kept_raw_and_mean_nothing(open_link):
    inbox, link, line = open_link
    before = link.counts()
    line.send(UNKNOWN)
    (datagram,) = datagrams(inbox, 1)
    assert datagram.frames == ((UNKNOWN, None),)
    assert link.counts().unknown == before.unknown + 1


def test_a_defect_of_ours_costs_one_datagram(inbox, monkeypatch):
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        monkeypatch.setattr(link._reader._decoder, "decode", lambda raw: 1 / 0)
        line.send(Autopilot().attitude())
        line.send(Autopilot().attitude())
        assert "ZeroDivisionError" in event(inbox, LinkEventKind.FAULT).text
        while link.counts().faults < 2:
            time.sleep(0.01)
        monkeypatch.undo()
        line.send(Autopilot().attitude())
        datagrams(inbox, 1)
    assert link.counts().faults == 2


def test_with_a_key_only_signed_frames_are_taken(inbox):
    port, now = free_port(), signing_timestamp(time.time_ns())
    ours, wrong = Autopilot(1, KEY, now), Autopilot(1, bytes(32), now + 500)
    with Link(f"udpin:127.0.0.1:{port}", inbox, key=KEY) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        first = ours.attitude(1)
        sent = [
            Autopilot(1).attitude(0),
            wrong.attitude(0),
            first,
            first,
            UNKNOWN,
            ours.attitude(2),
        ]
        for raw in sent:
            line.send(raw)
        found = datagrams(inbox, 2)
        assert [d.frames[0].raw for d in found] == [first, sent[-1]]
        counts = link.counts()
    assert (counts.unsigned, counts.wrong_signature, counts.old_signature) == (2, 1, 1)
    assert counts.frames == 2


def test_refusals_are_reported_but_not_each(inbox):
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox, key=KEY) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        for _ in range(20):
            line.send(Autopilot().attitude())
        assert "1 unsigned" in event(inbox, LinkEventKind.REFUSED).text
        while link.counts().unsigned < 20:
            time.sleep(0.01)
        assert len(inbox) == 0


def test_what_we_say_is_signed_and_a_boat_behind_in_time_can_catch_up(inbox):
    """A boat without clock starts at 2015: it is refused until it has heard us."""
    port, boat = free_port(), Autopilot(1, KEY, 1)
    with Link(f"udpin:127.0.0.1:{port}", inbox, Identity(), KEY, 5) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        assert link.announces
        line.send(boat.attitude(1))
        assert "1 with an old timestamp" in event(inbox, LinkEventKind.REFUSED).text
        end = time.monotonic() + 5.0  # the refusal is told before its sender is known
        while not link.send_message(heartbeat()):
            assert time.monotonic() < end
            time.sleep(0.01)
        message = boat.mavlink.decode(bytearray(line.recv(300)))
        assert message.get_signed()
        assert message.get_link_id() == 5
        line.send(boat.attitude(2))
        assert datagrams(inbox, 1)[0].frames[0].message.time_boot_ms == 2


FORBIDDEN = [
    dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, 8, 0, 0, 4, 3),
    dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3),
    dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, *[0] * 7),
    dialect.MAVLink_param_set_message(1, 1, b"X", 0.0, 9),
    dialect.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
    dialect.MAVLink_request_data_stream_message(1, 1, 0, 4, 1),
    dialect.MAVLink_set_mode_message(1, 0, 4),
]


@pytest.mark.parametrize("message", FORBIDDEN, ids=lambda m: m.get_type())
def test_nothing_else_can_be_said(inbox, message):
    raw = Transmitter(Identity(), None, 0).pack(message)
    with pytest.raises(ValueError, match="never sent"):
        permitted(raw)
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox, Identity()) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        line.send(Autopilot().heartbeat())
        datagrams(inbox, 1)
        for send, given in ((link.send, raw), (link.send_message, message), (link.send, b"x")):
            with pytest.raises(ValueError, match="never sent"):
                send(given)
    assert link.counts().sent == 0


def converse(link: Link, inbox: Inbox, requests: LinkRequests, seconds: float) -> LinkRequests:
    """What the live loop does with requests, for a while."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        with contextlib.suppress(Empty):
            item = inbox.get(0.01)
            for frame in item.frames if isinstance(item, Datagram) else ():
                requests = requests.take(frame.message, time.monotonic_ns())
        requests, messages, _ = requests.due(time.monotonic_ns())
        for message in messages:
            link.send_message(message)
    return requests


def boat_end(kind, port):
    """The boat's end of a link: its socket, and the link's endpoint."""
    if kind == "tcp":
        server = socket.create_server(("127.0.0.1", port))
        server.settimeout(PATIENCE_S)
        return server
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect(("127.0.0.1", port))
    return line


@pytest.mark.parametrize("silent", [False, True])
@pytest.mark.parametrize("kind", ["udpin", "tcp"])
def test_the_wire_carries_what_is_documented_and_nothing_when_silent(inbox, kind, silent):
    """A boat that never answers, so that every try goes out; everything it receives is kept."""
    port, boat = free_port(socket.SOCK_STREAM), Autopilot()
    identity = None if silent else Identity(200, 190)
    requests = LinkRequests(identity, {"ATTITUDE": 50.0, "GPS_RAW_INT": 5.0})
    with contextlib.ExitStack() as scope:
        end = scope.enter_context(boat_end(kind, port))
        link = scope.enter_context(Link(f"{kind}:127.0.0.1:{port}", inbox, identity))
        if kind == "tcp":
            end, _ = end.accept()
            scope.enter_context(end)
        end.send(boat.heartbeat() + boat.attitude())
        converse(link, inbox, requests, 1.3)
        end.settimeout(0.1)
        wire = b""
        with contextlib.suppress(TimeoutError):
            while True:
                wire += end.recv(4096)
    messages = decoded(wire)
    assert b"".join(bytes(m.get_msgbuf()) for m in messages) == wire
    if silent:
        assert wire == b""
        return
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in messages} == {(200, 190)}
    assert {m.get_type() for m in messages} == {"HEARTBEAT", "COMMAND_LONG"}
    assert [m.get_seq() for m in messages] == list(range(len(messages)))
    asks = [m for m in messages if m.get_type() == "COMMAND_LONG"]
    assert [(m.command, m.param1, m.param2, m.confirmation) for m in asks] == [
        (511, 30.0, 20_000.0, 0), (511, 30.0, 20_000.0, 1),
    ]  # fmt: skip


def test_a_silent_link_refuses_to_speak_and_to_be_where_it_must(inbox):
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox) as link, udp_socket() as line:
        line.connect(("127.0.0.1", port))
        line.send(Autopilot().heartbeat())
        datagrams(inbox, 1)
        assert not link.announces
        assert not link.send_message(heartbeat())
        assert not link.send(Transmitter(Identity(), None, 0).pack(heartbeat()))
        line.settimeout(0.2)
        with pytest.raises(TimeoutError):
            line.recv(300)
    with pytest.raises(BadInput, match="udpin"):
        Link("udpout:127.0.0.1:14550", inbox)
