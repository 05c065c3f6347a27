"""Every kind of link on loopback: frames in, frames out, lost and back."""

import os
import socket
import threading
import time
from queue import Empty

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.links import Inbox, LinkEventKind
from gateway.links.frame_reader import MAX_LISTED
from gateway.links.link import Link
from gateway.links.rate_requests import heartbeat
from gateway.links.transmitter import Identity
from tests.gateway.links.boats import (
    PATIENCE_S,
    Autopilot,
    datagrams,
    decoded,
    event,
    free_port,
    items,
    udp_socket,
)  # fmt: skip

TCP = socket.SOCK_STREAM
US = Identity()


@pytest.fixture
def inbox():
    return Inbox()


@pytest.fixture(autouse=True)
def _no_threads_left():
    before = threading.active_count()
    yield
    assert threading.active_count() == before


def heard(raw):
    return [(m.get_type(), m.get_srcSystem(), m.get_srcComponent()) for m in decoded(raw)]


OURS = [("HEARTBEAT", 245, 191)]


def test_udp_in_one_item_per_datagram_and_an_answer_to_the_sender(inbox):
    boat, port = Autopilot(), free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox, US) as link, udp_socket() as line:
        assert not link.send_message(heartbeat())  # nobody is there yet
        sent, before = [boat.heartbeat(), boat.attitude()], time.time_ns()
        line.sendto(b"".join(sent), ("127.0.0.1", port))
        line.sendto(boat.attitude(), ("127.0.0.1", port))
        first, second = datagrams(inbox, 2)
        assert [frame.raw for frame in first.frames] == sent
        assert [frame.message.get_type() for frame in first.frames] == ["HEARTBEAT", "ATTITUDE"]
        assert len(second.frames) == 1
        assert before <= first.receive_time_ns <= second.receive_time_ns <= time.time_ns()
        assert first.link == f"udpin:127.0.0.1:{port}"
        assert link.send_message(heartbeat())
        assert heard(line.recv(300)) == OURS
    counts = link.counts()
    assert (counts.datagrams, counts.frames, counts.sent, counts.unsent) == (2, 3, 1, 1)


def test_udp_in_requests_go_to_the_boat_they_are_for(inbox):
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox, US) as link, udp_socket() as a, udp_socket() as b:
        a.sendto(Autopilot(1).heartbeat(), ("127.0.0.1", port))
        b.sendto(Autopilot(2).heartbeat(), ("127.0.0.1", port))
        datagrams(inbox, 2)
        ask = dialect.MAVLink_command_long_message(2, 1, 511, 0, 30, 20000, 0, 0, 0, 0, 0)
        assert link.send_message(ask)
        assert link.send_message(heartbeat())
        assert heard(b.recv(300)) == [("COMMAND_LONG", 245, 191)]
        assert heard(b.recv(300)) == OURS
        assert heard(a.recv(300)) == OURS


def test_udp_out_speaks_first_and_hears_what_comes_back(inbox):
    with udp_socket() as boat:
        port = boat.getsockname()[1]
        with Link(f"udpout:127.0.0.1:{port}", inbox, US) as link:
            assert link.announces
            deadline = time.monotonic() + PATIENCE_S
            while not link.send_message(heartbeat()) and time.monotonic() < deadline:
                time.sleep(0.01)  # the thread is still opening the socket
            raw, peer = boat.recvfrom(300)
            assert heard(raw) == OURS
            boat.sendto(Autopilot().attitude(), peer)
            (datagram,) = datagrams(inbox, 1)
            assert datagram.frames[0].message.get_type() == "ATTITUDE"
            with udp_socket() as stranger:  # not the address that the user gave
                stranger.sendto(Autopilot(66).attitude(), peer)
            boat.sendto(Autopilot(2).attitude(), peer)
            (datagram,) = datagrams(inbox, 1)
            assert datagram.frames[0].message.get_srcSystem() == 2


def test_udp_out_survives_that_nobody_is_there_yet(inbox):
    port = free_port()
    with Link(f"udpout:127.0.0.1:{port}", inbox, US) as link:
        for _ in range(20):
            link.send_message(heartbeat())
            time.sleep(0.01)
        with udp_socket(port) as boat:
            while not link.send_message(heartbeat()):
                pass
            _, peer = boat.recvfrom(300)
            boat.sendto(Autopilot().attitude(), peer)
            datagrams(inbox, 1)
    assert link.counts().losses == 0


def test_tcp_client_connects_loses_and_comes_back(inbox):
    port, boat = free_port(TCP), Autopilot()
    with Link(f"tcp:127.0.0.1:{port}", inbox, US) as link:
        assert "refused" in event(inbox, LinkEventKind.LOST).text  # the boat is not on yet
        for _ in range(2):
            with socket.create_server(("127.0.0.1", port)) as server:
                server.settimeout(PATIENCE_S)
                line, _ = server.accept()
                with line:
                    event(inbox, LinkEventKind.CONNECTED)
                    frame = boat.attitude()
                    line.sendall(frame[:10])
                    time.sleep(0.02)
                    line.sendall(frame[10:])
                    (datagram,) = datagrams(inbox, 1)
                    assert datagram.frames[0].raw == frame
                    assert link.send_message(heartbeat())
                    line.settimeout(PATIENCE_S)
                    assert heard(line.recv(300)) == OURS
            assert "closed by the other side" in event(inbox, LinkEventKind.LOST).text
            assert not link.send_message(heartbeat())
    assert link.counts().losses == 2


def test_an_unreachable_network_is_no_connection_and_told_once(inbox):
    """As while a wireless link is down; a socket says so at once, and only once."""
    with Link("tcp:255.255.255.255:5760", inbox, US) as link:
        assert "unreachable" in event(inbox, LinkEventKind.LOST).text
        with pytest.raises(Empty):
            inbox.get(timeout=1.5)  # four attempts
    assert link.counts().losses == 0


def test_tcp_server_takes_several_and_accepts_again(inbox):
    port = free_port(TCP)
    with Link(f"tcpin:127.0.0.1:{port}", inbox, US) as link:
        assert not link.send_message(heartbeat())
        with (
            socket.create_connection(("127.0.0.1", port), PATIENCE_S) as a,
            socket.create_connection(("127.0.0.1", port), PATIENCE_S) as b,
        ):
            a.sendall(Autopilot(1).attitude())
            datagrams(inbox, 1)
            b.sendall(Autopilot(2).attitude())
            datagrams(inbox, 1)
            assert link.send_message(heartbeat())
            assert heard(a.recv(300)) == heard(b.recv(300)) == OURS
            a.close()
            event(inbox, LinkEventKind.LOST)
            b.sendall(Autopilot(2).attitude())
            datagrams(inbox, 1)
        event(inbox, LinkEventKind.LOST)
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as c:
            event(inbox, LinkEventKind.CONNECTED)
            c.sendall(Autopilot(3).attitude())
            assert datagrams(inbox, 1)[0].frames[0].message.get_srcSystem() == 3


def test_tcp_server_outlives_many_short_connections(inbox):
    port = free_port(TCP)
    with Link(f"tcpin:127.0.0.1:{port}", inbox) as link:
        for k in range(30):
            with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as line:
                line.sendall(Autopilot().attitude(k))
            event(inbox, LinkEventKind.LOST)
    assert (link.counts().frames, link.counts().faults) == (30, 0)


@pytest.fixture
def pty():
    """A pseudo-terminal whose device can be taken away: (boat's end, path)."""
    boat, device = os.openpty()
    path = os.ttyname(device)
    os.close(device)
    yield boat, path
    os.close(boat)


def read_some(fd):
    return os.read(fd, 300)


def test_serial_both_ways_without_echo(inbox, pty):
    boat, path = pty
    autopilot = Autopilot()
    with Link(f"{path},57600", inbox, US) as link:
        assert "57600" in event(inbox, LinkEventKind.CONNECTED).text
        os.write(boat, autopilot.attitude()[:7] + b"\n\x03\x04\x11")  # what a terminal would eat
        frames = [autopilot.attitude(k) for k in range(5)]
        os.write(boat, b"".join(frames))
        got = []
        while len(got) < len(frames):
            got += [frame.raw for frame in datagrams(inbox, 1)[0].frames]
        assert got == frames
        assert link.send_message(heartbeat())
        assert heard(read_some(boat)) == OURS  # and not what the boat itself had sent


def test_serial_is_opened_again(inbox, tmp_path):
    device = tmp_path / "tty"
    with Link(f"serial:{device}:115200", inbox) as link:
        assert "No such file" in event(inbox, LinkEventKind.LOST).text
        for _ in range(2):
            boat, end = os.openpty()
            device.symlink_to(os.ttyname(end))
            event(inbox, LinkEventKind.CONNECTED)
            os.close(end)
            os.write(boat, Autopilot().attitude())
            datagrams(inbox, 1)
            device.unlink()
            os.close(boat)
            event(inbox, LinkEventKind.LOST)
    assert link.counts().losses == 2


def test_what_is_no_serial_device_is_said(inbox, tmp_path):
    (tmp_path / "file").touch()
    with Link(str(tmp_path / "file"), inbox):
        assert event(inbox, LinkEventKind.LOST).text


def test_a_baud_rate_that_does_not_exist(inbox):
    with pytest.raises(BadInput, match=r"no baud rate 12345; there is .*57600"):
        Link("/dev/ttyUSB0,12345", inbox)


def test_several_links_into_one_inbox(inbox):
    ports = [free_port(), free_port()]
    with (
        Link(f"udpin:127.0.0.1:{ports[0]}", inbox),
        Link(f"udpin:127.0.0.1:{ports[1]}", inbox),
        udp_socket() as line,
    ):
        for port in ports:
            line.sendto(Autopilot().attitude(), ("127.0.0.1", port))
        assert {d.link for d in datagrams(inbox, 2)} == {f"udpin:127.0.0.1:{p}" for p in ports}


@pytest.mark.parametrize("kind", ["udpin", "tcpin"])
def test_a_port_in_use_is_said_at_once(inbox, kind):
    port = free_port(TCP)
    endpoint = f"{kind}:127.0.0.1:{port}"
    with Link(endpoint, inbox), pytest.raises(BadInput) as caught, Link(endpoint, inbox):
        pass
    assert endpoint in str(caught.value)
    assert "another program" in str(caught.value)


def test_an_address_of_another_machine_is_no_port_in_use(inbox):
    with pytest.raises(BadInput) as caught, Link("udpin:192.0.2.9:14550", inbox):
        pass
    assert "none of this machine's" in str(caught.value)
    assert "another program" not in str(caught.value)


def test_a_host_that_is_none_is_said_and_tried_again(inbox):
    with Link("tcp:a..b:5760", inbox):
        assert "no host name" in event(inbox, LinkEventKind.LOST).text


@pytest.mark.parametrize("endpoint", ["udpin:127.0.0.1:{}", "tcpin:127.0.0.1:{}",
                                      "tcp:127.0.0.1:{}", "udpout:127.0.0.1:{}"])  # fmt: skip
def test_closing_ends_the_thread_at_once(inbox, endpoint):
    with Link(endpoint.format(free_port(TCP)), inbox, US) as link:
        items(inbox, bool) if "out" not in endpoint else None
    assert not link._thread.is_alive()
    assert not link.send_message(heartbeat())


def test_of_two_boats_with_one_system_id_the_first_is_taken(inbox):
    port = free_port()
    first, second = Autopilot(), Autopilot()
    with Link(f"udpin:127.0.0.1:{port}", inbox) as link, udp_socket() as a, udp_socket() as b:
        sent = []
        for k in range(6):
            sent.append(first.attitude(k))
            a.sendto(sent[-1], ("127.0.0.1", port))
            b.sendto(second.attitude(900 + k), ("127.0.0.1", port))
        found = items(inbox, lambda found: sum(not hasattr(i, "kind") for i in found) == 6)
        deadline = time.monotonic() + PATIENCE_S
        while link.counts().apart < 6:
            assert time.monotonic() < deadline
            time.sleep(0.01)
    found += [inbox.get(0) for _ in range(len(inbox))]
    taken = [frame.raw for item in found if not hasattr(item, "kind") for frame in item.frames]
    shared = [i for i in found if getattr(i, "kind", None) is LinkEventKind.SHARED_ID]
    assert taken == sent
    assert len(shared) == 1  # reported once
    assert "two boats with one id" in shared[0].text
    assert "what comes from the other is left out" in shared[0].text


def test_another_sender_that_goes_on_under_an_id_is_told(inbox, monkeypatch):
    """It was "telemetry is fresh again", and then a heading that jumped."""
    monkeypatch.setattr("gateway.links.frame_reader.HOLD_NS", 50_000_000)
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox), udp_socket() as a, udp_socket() as b:
        for line in (a, b, b):
            line.sendto(Autopilot().attitude(), ("127.0.0.1", port))
            time.sleep(0.06)
        found = items(inbox, lambda found: sum(not hasattr(i, "kind") for i in found) == 3)
        sender = b.getsockname()[1]
    (changed,) = [i for i in found if getattr(i, "kind", None) is LinkEventKind.SENDER_CHANGED]
    told = f"another sender holds system id 1 now, 127.0.0.1:{sender}; the one before fell silent"
    assert changed.text.startswith(told)


def test_a_sender_that_comes_back_under_another_port_is_no_second_boat(inbox, monkeypatch):
    monkeypatch.setattr("gateway.links.frame_reader.HOLD_NS", 50_000_000)
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox, US) as link:
        for _ in range(2):
            time.sleep(0.06)
            with udp_socket() as line:
                for _ in range(5):
                    line.sendto(Autopilot().attitude(), ("127.0.0.1", port))
                got = items(inbox, lambda found: sum(not hasattr(i, "kind") for i in found) == 5)
                assert LinkEventKind.SHARED_ID not in [getattr(i, "kind", None) for i in got]
                assert link.send_message(heartbeat())
                assert heard(line.recv(300)) == OURS


def test_a_flood_of_systems_is_not_named_one_by_one(inbox):
    port = free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox), udp_socket() as line:
        for system in range(1, 201):
            line.sendto(Autopilot(system).attitude(), ("127.0.0.1", port))
            time.sleep(0.0005)
        found = items(inbox, lambda found: sum(not hasattr(i, "kind") for i in found) == 200)
    told = [i.text for i in found if getattr(i, "kind", None) is LinkEventKind.HEARD]
    assert len(told) == MAX_LISTED + 1
    assert told[-1] == f"more than {MAX_LISTED} systems heard: further ones are not named"


def test_a_full_inbox_drops_and_counts_but_never_blocks():
    inbox, port = Inbox(capacity=3), free_port()
    with Link(f"udpin:127.0.0.1:{port}", inbox) as link, udp_socket() as line:
        for k in range(10):
            line.sendto(Autopilot().attitude(k), ("127.0.0.1", port))
        deadline = time.monotonic() + PATIENCE_S
        while link.counts().datagrams < 10 and time.monotonic() < deadline:
            time.sleep(0.01)
        counts = link.counts()
    assert counts.dropped == 10 - 1  # two events were there first
    assert [getattr(inbox.get(0), "kind", "datagram") for _ in range(len(inbox))] == [
        LinkEventKind.LISTENING, LinkEventKind.HEARD, "datagram",
    ]  # fmt: skip
