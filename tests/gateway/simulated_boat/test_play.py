"""In real time, over real sockets: frames arrive, requests are answered, stopping is quick."""

import socket
import time
from contextlib import closing
from threading import Event, Thread

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.links import Arrival
from gateway.simulated_boat import FAST
from gateway.simulated_boat.play import PlayLoop, play, playing, simulate_live
from tests.gateway.simulated_boat.frames import simulated_boat
from tests.sim.vessels import WAMV

HOST = "127.0.0.1"
LONG = 10.0  # s, more than anything here takes


class Listener:
    """A gateway's end: a socket, and what came out of it."""

    def __init__(self, plug: socket.socket) -> None:
        self.plug, self.parser = plug, mavlink.MAVLink(None, 200, 190)
        plug.settimeout(LONG)

    def until(self, wanted):
        """Messages up to the first that is wanted."""
        found = []
        deadline = time.monotonic() + LONG
        while time.monotonic() < deadline:
            for message in self.parser.parse_buffer(self.plug.recv(65536)) or ():
                found.append(message)
                if wanted(message):
                    return found
        raise AssertionError(f"never came; {len(found)} others did")

    def ask(self, send) -> None:
        """An interval of 20 ms for ATTITUDE."""
        message = mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 20000, 0, 0, 0, 0, 0)
        send(message.pack(self.parser))


def udp():
    plug = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    plug.bind((HOST, 0))
    return plug


def free_port():
    with closing(socket.socket()) as plug:
        plug.bind((HOST, 0))
        return plug.getsockname()[1]


def acknowledged(message):
    return message.get_type() == "COMMAND_ACK" and message.result == 0


def from_system(system):
    return lambda message: message.get_srcSystem() == system


def test_udp_out_and_a_request_over_the_same_link():
    with (
        closing(udp()) as plug,
        playing([simulated_boat()], f"udpout:{HOST}:{plug.getsockname()[1]}"),
    ):
        _, boat_side = plug.recvfrom(65536)
        listener = Listener(plug)
        listener.ask(lambda data: plug.sendto(data, boat_side))
        listener.until(acknowledged)
        listener.until(lambda m: m.get_type() == "ATTITUDE")


def test_udp_in_sends_to_those_it_received_from():
    number = free_port()
    with closing(udp()) as plug, playing([simulated_boat()], f"udpin:{HOST}:{number}"):
        listener = Listener(plug)
        plug.settimeout(0.1)
        for _ in range(50):
            listener.ask(lambda data: plug.sendto(data, (HOST, number)))
            try:
                listener.until(acknowledged)
                return
            except (TimeoutError, ConnectionError):  # it was not there yet
                continue
        raise AssertionError("no answer")


def test_tcp_in_serves_and_survives_a_listener_that_leaves():
    number = free_port()
    with playing([simulated_boat()], f"tcpin:{HOST}:{number}"):
        for _ in range(2):
            with closing(_call(number)) as plug:
                listener = Listener(plug)
                listener.ask(plug.sendall)
                listener.until(acknowledged)


def _call(number):
    deadline = time.monotonic() + LONG
    while True:
        try:
            return socket.create_connection((HOST, number))
        except OSError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.02)


def test_tcp_calls_until_somebody_is_there():
    number = free_port()
    with playing([simulated_boat()], f"tcp:{HOST}:{number}") as played:
        _wait(lambda: played.seconds > 0.05)  # the first call found nobody
        with closing(socket.create_server((HOST, number))) as server:
            server.settimeout(LONG)
            plug, _ = server.accept()
            with closing(plug):
                Listener(plug).until(lambda m: m.get_type() == "ATTITUDE")


def _wait(condition):
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline, "it never happened"
        time.sleep(0.01)


def test_several_boats_share_a_port():
    boats = [simulated_boat(system_id=1), simulated_boat(system_id=7)]
    with closing(udp()) as plug, playing(boats, f"udpout:{HOST}:{plug.getsockname()[1]}"):
        listener = Listener(plug)
        listener.until(from_system(1))
        listener.until(from_system(7))


def test_stopping_ends_play_at_once():
    stop = Event()
    thread = Thread(target=play, args=([simulated_boat()], f"udpout:{HOST}:9", stop))
    thread.start()
    stop.set()
    thread.join(LONG)
    assert not thread.is_alive()


class Box:
    """A port that keeps what is sent, and receives what a test puts in."""

    no_listener = None

    def __init__(self):
        self.sent, self.inbox = [], []

    def send(self, data):
        self.sent.append(data)

    def receive(self):
        arrivals, self.inbox = self.inbox, []
        return [Arrival(data, peer, 0) for peer, data in arrivals]


def test_pace_is_kept_against_the_start():
    """Turns that come late do not move those after them."""
    loop = PlayLoop([simulated_boat(rates=FAST)], Box())
    for late in (0.0, 0.011, 0.005, 0.3, 0.0):
        due = loop.next_s()
        assert due * 50.0 == pytest.approx(round(due * 50.0))
        loop.turn(due + late)


def test_boats_on_one_port_send_at_different_moments():
    box, sent = Box(), []
    loop = PlayLoop(
        [simulated_boat(system_id=1, rates=FAST), simulated_boat(system_id=2, rates=FAST)], box
    )
    for _ in range(8):
        loop.turn(loop.next_s())
        sent.append({data[5] for data in box.sent})
        box.sent.clear()
    assert sent == [{1}, {2}] * 4


def test_after_a_stall_old_frames_are_not_sent():
    box = Box()
    loop = PlayLoop([simulated_boat(rates=FAST)], box)
    loop.turn(0.0)
    sent = len(box.sent)
    loop.turn(60.0)
    assert len(box.sent) - sent < 150
    assert loop.status.stale > 8000


def test_boats_go_on_where_they_were_after_the_machine_has_slept():
    times = iter([0.0, 0.0, 0.0, 0.0, 0.0, 3600.0, *[3600.0 + k * 0.001 for k in range(200)]])
    played = play(
        [simulated_boat()], f"udpout:{HOST}:9", Event(), seconds=0.1, clock=lambda: next(times)
    )
    assert played.stale == 0
    assert played.seconds < 0.2


def test_two_boats_with_one_system_id_both_send():
    box = Box()
    loop = PlayLoop([simulated_boat(seed=1), simulated_boat(seed=2)], box)
    for k in range(6):
        loop.turn(k * 0.2)
    numbers = [data[4] for data in box.sent]
    assert len(numbers) > len(set(numbers)) > 10


def test_rubbish_on_the_port_is_passed_over():
    box = Box()
    loop = PlayLoop([simulated_boat()], box)
    loop.turn(0.0)
    question = mavlink.MAVLink_param_request_read_message(1, 1, b"FRAME_CLASS", -1)
    packed = question.pack(mavlink.MAVLink(None, 200, 190))
    box.inbox = [("a", b"GET / HTTP/1.1\r\n\r\n"), ("b", bytes(300)), ("c", packed[:9])]
    loop.turn(0.1)
    box.inbox = [("c", packed[9:])]
    loop.turn(0.2)
    assert loop.status.received == 1


def test_what_the_command_calls(tmp_path):
    with closing(udp()) as plug:
        endpoint = f"udpout:{HOST}:{plug.getsockname()[1]}"
        turns = []
        played = simulate_live([WAMV, WAMV], endpoint, Event(), seconds=0.3, each_turn=turns.append)
        assert played.frames > 10
        assert turns[-1] is played
        listener = Listener(plug)
        listener.until(from_system(1))
        listener.until(from_system(2))
    with pytest.raises(BadInput, match="--vessel"):
        simulate_live([], endpoint, Event())
