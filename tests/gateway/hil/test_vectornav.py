"""The VN-200 that a board sees, held against a driver that asks and checks as ArduPilot's does."""

import math
import os
import struct
import time
import tty

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.hil.ahrs import Fix, Registers, ServoOutputs, checked, imu_packet, sentence
from gateway.hil.run import LoopOptions, LoopPlan
from gateway.links import Endpoint, Waker
from gateway.links.transports import UdpTransport, free_udp_port
from gateway.vessel_file import load_vessel
from sim.hil import Readings
from sim.hil.day import Day
from tests.gateway.hil.firmware import looping, wait_for

ASKED = [  # what the driver of ArduPilot 4.6 sends at EAHRS_RATE 100
    "VNASY,0", "VNWRG,06,0,1", "VNWRG,06,0,2", "VNRRG,01", "VNWRG,75,3,8,01,0721",
    "VNWRG,76,3,16,31,0001,0106,0613", "VNWRG,77,3,160,49,0003,26B8,0018", "VNASY,1",
]  # fmt: skip
LENGTHS = {b"\x01\x21\x07": 82, b"\x31\x01\x00\x06\x01\x13\x06": 104, b"\x49\x03": 110}
DAY = Day(place=(51.5, -0.1))


def crc16(data: bytes) -> int:
    """CRC-16 CCITT as ArduPilot's crc16_ccitt has it, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def test_the_checksum_is_that_of_the_manual():
    assert sentence("VNWRG,76,3,16,31,0001,0106,0613").startswith(b"$VNWRG,76,3,16,31")
    assert sentence("VNRRG,01") == b"$VNRRG,01*72\r\n"
    assert checked(b"$VNRRG,01*72") == "VNRRG,01"
    for wrong in (b"$VNRRG,01*73", b"VNRRG,01*72", b"$VNRRG,01", b"*72$", b"$\xff*FF", b"$VN*xy"):
        assert checked(wrong) is None


def test_commands_are_answered_in_the_words_in_which_they_came():
    device = Registers()
    for text in ASKED:
        ((answer,), wrong, anew) = device.received(sentence(text))
        expected = f"{text},VN-200" if text == "VNRRG,01" else text
        assert (answer, wrong, anew) == (sentence(expected), 0, False)
        assert device.streaming == (text == "VNASY,1")
    assert device.hertz == {75: 100.0, 76: 50.0, 77: 5.0}
    assert device.received(sentence("VNASY,0"))[2], "the driver has begun anew"
    assert not device.streaming


def test_noise_and_halves_do_no_harm():
    device = Registers()
    assert device.received(os.urandom(5000).replace(b"\n", b"").replace(b"\r", b"")) == (
        [],
        0,
        False,
    )
    assert device.received(b"\r\n")[1] == 1
    whole = sentence("VNASY,1")
    assert device.received(whole[:5])[0] == []
    assert device.received(whole[5:])[0] == [whole]
    assert device.received(sentence("VNWRG,75,3,0,01,0721"))[1] == 0
    assert device.hertz == {}, "a divisor of 0 is no rate"


def test_the_barometer_of_a_boat_at_rest_is_no_dead_one():
    """ArduPilot calls one unhealthy, and does not arm, that says the same for two seconds."""
    rest = Readings(
        0.0, (0.0,) * 3, (0.0, 0.0, -9.80665), (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, None, None, 14.8,
        0.0, None,
    )  # fmt: skip
    at = Fix((51.5, -0.1, 0.0), (0.2, 0.0, 0.4), 0)
    packets = [imu_packet(rest._replace(time=0.01 * k), at) for k in range(800)]
    air = [struct.unpack_from("<2f", packet, 4 + 8 + 15 * 4) for packet in packets]
    assert air[0] == pytest.approx((15.0, 101.325), abs=0.02)
    changed = [k for k in range(1, 800) if air[k] != air[k - 1]]
    assert all(b - a < 150 for a, b in zip([0, *changed], [*changed, 800], strict=True))


class Board:
    """ArduPilot's end of the serial port: it asks, then takes packets whose checksum is right."""

    def __init__(self) -> None:
        self.near, self._far = os.openpty()
        tty.setraw(self.near)
        self.device = os.ttyname(self._far)
        os.set_blocking(self.near, False)
        self.data = b""

    def __enter__(self) -> "Board":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.near)
        os.close(self._far)

    def read(self) -> bytes:
        try:
            self.data += os.read(self.near, 65536)
        except BlockingIOError:
            time.sleep(0.005)
        return self.data

    def ask(self) -> None:
        for text in ASKED:
            self.data = b""
            os.write(self.near, sentence(text))
            assert wait_for(lambda t=text: f"${t}".encode() in self.read()), text

    def listen(self, seconds: float) -> dict[bytes, list[bytes]]:
        """Payloads by the first two bytes of their header."""
        self.data, end, out = b"", time.monotonic() + seconds, {}
        while time.monotonic() < end:
            self.read()
        while (at := self.data.find(b"\xfa")) >= 0:
            for header, length in LENGTHS.items():
                raw = self.data[at : at + length]
                if raw[1:].startswith(header) and len(raw) == length and crc16(raw[1:]) == 0:
                    out.setdefault(header[:2], []).append(raw)
                    at += length - 1
                    break
            self.data = self.data[at + 1 :]
        return out


class Outputs:
    """The board's MAVLink on a link of its own."""

    def __init__(self, port: int) -> None:
        self._transport = UdpTransport(Endpoint("", "udpout", f"127.0.0.1:{port}"))
        self._waker = Waker()
        self._transport.open(self._waker, lambda kind, text: None)
        self._mav = mavlink.MAVLink(None, 1, 1)
        self.asked: list[mavlink.MAVLink_message] = []

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()
        self._waker.__exit__()

    def send(self, left: int, right: int) -> None:
        beat = mavlink.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)
        servos = mavlink.MAVLink_servo_output_raw_message(0, 0, left, 0, right, *[0] * 13)
        for message in (beat, servos):
            self._transport.send(message.pack(self._mav), "")
        for arrival in self._transport.receive(0.0):
            self.asked += self._mav.parse_buffer(arrival.data) or []


def test_outputs_are_read_asked_for_and_forgotten():
    port, now = free_udp_port(), [0.0]
    link = f"udpin:127.0.0.1:{port}"
    with ServoOutputs(link, lambda: now[0]) as read, Outputs(port) as board:
        assert read.pulses() is None

        def heard() -> bool:
            board.send(1600, 1700)
            return (read.pulses() or {}).get(3) == 1700.0

        assert wait_for(heard)
        assert wait_for(lambda: board.send(1600, 1700) or board.asked)
        request = board.asked[0]
        assert (request.get_type(), request.command) == ("COMMAND_LONG", 511)
        assert request.param1 == mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
        now[0] += 1.5
        assert read.pulses() is None, "they are older than a second"


def bench(board, outputs, plan, options):
    """Five seconds on the bench under thrust -> the packets of the last one."""
    with looping([plan], options) as running:
        assert running.said("MOTORS MAY TURN")
        assert board.listen(0.3) == {}, "nothing goes out before it is asked for"
        board.ask()
        end = time.monotonic() + 4.0
        while time.monotonic() < end:
            outputs.send(1800, 1800)
            board.read()
        found = board.listen(1.0)
    assert running.said("a board asks (100 Hz, 50 Hz, 5 Hz)")
    return found


def test_the_boat_sails_by_the_outputs_of_the_board_and_tells_it_so():
    port = free_udp_port()
    options = LoopOptions(day=DAY, outputs=f"udpin:127.0.0.1:{port}")
    with Board() as board, Outputs(port) as outputs:
        plan = LoopPlan(f"ahrs:{board.device}", "ferry", load_vessel("otter"))
        found = bench(board, outputs, plan, options)
    imu, ins, gnss = (found[key] for key in (b"\x01\x21", b"\x31\x01", b"\x49\x03"))
    assert len(imu) > 1.5 * len(ins) > 3.0 * len(gnss) > 0
    accel = struct.unpack_from("<3f", imu[-1], 4 + 8 + 12)
    assert accel[2] == pytest.approx(-9.81, abs=0.05)
    body = struct.unpack("<Q3f4f3fH3d3fff", ins[-1][8:-2])
    assert math.hypot(*body[4:8]) == pytest.approx(1.0, abs=1e-6)
    assert body[12] == pytest.approx(51.5, abs=1e-3)
    assert body[12] > 51.5 + 1e-6, "it has sailed north"
    assert body[15] > 0.2, "m/s north"
    fix = struct.unpack("<QQBB3d3f3ff7fBB", gnss[-1][8:-2])
    assert fix[3] == 3
    assert fix[1] / 1e9 / 604800 > 2300, "weeks since 1980"


def test_a_board_that_does_not_ask_is_to_be_started_again(monkeypatch):
    """Its driver asks once, when it starts: one that ran before `hil` was started stays mute."""
    monkeypatch.setattr("gateway.hil.hearing.SILENT_S", 0.3)
    options = LoopOptions(outputs=f"udpin:127.0.0.1:{free_udp_port()}")
    with Board() as board, Board() as mute:
        plan = LoopPlan(f"ahrs:{mute.device}", "ferry", load_vessel("otter"))
        with looping([plan], options) as running:
            assert wait_for(lambda: running.said("no board has asked yet"))
        assert len(running.said("reboot the board")) == 1
        plan = LoopPlan(f"ahrs:{board.device}", "ferry", load_vessel("otter"))
        monkeypatch.setattr("gateway.hil.hearing.SILENT_S", 1.5)
        with looping([plan], options) as running:
            board.ask()
            board.listen(2.0)
        assert not running.said("no board has asked yet")


def test_without_a_link_for_the_outputs_it_does_not_begin():
    plan = LoopPlan("ahrs:/dev/null", "ferry", load_vessel("otter"))
    with pytest.raises(BadInput, match="give --outputs LINK"), looping([plan], LoopOptions()):
        pass
