"""A flight controller on the bench: the boat as its external AHRS, its outputs back by MAVLink.

ArduPilot on a board takes no simulated sensors, but it does take a VectorNav on a serial port for
its attitude, place and velocity (EAHRS_TYPE 1, AHRS_EKF_TYPE 11). The boat is that VectorNav: its
packets go out at the rates that the driver asks for, at the pace of the clock.

**Its packets** are those of a VectorNav VN-200 as ArduPilot's own driver talks to it: registers in,
binary packets out. Pure.

The driver asks in text, `$VNWRG,75,3,16,01,0721*CK`, and waits for the same text back; CK is the
exclusive or of what stands between `$` and `*`. Register 1 is the model, 75 to 77 are the three
binary packets that it wants, with a divisor of 800 Hz; `VNASY,0` and `VNASY,1` stop and start them.

    75 IMU   time, rate, specific force, both uncompensated, magnetic field [gauss], °C, kPa
    76 INS   time, yaw pitch roll [deg], quaternion x y z w, its errors, status, latitude, longitude
             [deg], height [m], velocity NED [m/s], errors of both
    77 GNSS  time, GPS time [ns], satellites, fix, place, velocity, errors, dilutions

A packet is the byte 0xFA, the header that names its fields, the fields (little-endian), and CRC-16
CCITT from 0 over all but the first byte, big-endian.

Source: libraries/AP_ExternalAHRS/AP_ExternalAHRS_VectorNav.cpp of ArduPilot 4.6; VectorNav,
VN-200 Interface Control Document (groups of the binary outputs).

**The servo outputs** are read from the autopilot's MAVLink: what its motors would get.

A thread of its own listens on a link, asks once in a while for SERVO_OUTPUT_RAW 25 times a
second (the only thing that it sends, `permitted` by the gateway's own rule), and keeps the newest
pulses. Pulses that are older than a second are none.
"""

import time
from binascii import crc_hqx
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import reduce
from math import degrees
from operator import xor
from struct import Struct
from threading import Thread
from typing import Any, NamedTuple, Self

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.errors import BadInput
from gateway.hil import Played, Session
from gateway.hil.px4 import magnetic_field, quaternion
from gateway.ingest.mapping import Origin
from gateway.links import Closing, Peer, Waker
from gateway.links.link import transport_of
from gateway.links.transmitter import SET_RATE, Identity, Transmitter, permitted
from gateway.simulated_boat.telemetry import degrees_e7
from sim.hil import Attitude, Readings, Vector, to_hull

MODEL = "VN-200"
BASE_HZ = 800  # the device's own rate, of which the driver asks for a part
IMU, INS, GNSS = 75, 76, 77  # registers of the packets
SYNC = b"\xfa"
HEADERS = {
    IMU: bytes([0x01, 0x21, 0x07]),
    INS: bytes([0x31, 0x01, 0x00, 0x06, 0x01, 0x13, 0x06]),
    GNSS: bytes([0x49, 0x03, 0x00, 0xB8, 0x26, 0x18, 0x00]),
}
FIELDS = {
    IMU: Struct("<Q3f3f3f3f3fff"),
    INS: Struct("<Q3f4f3fH3d3fff"),
    GNSS: Struct("<QQBB3d3f3ff7fBB"),
}
TRACKING = 2 | 4  # of the INS status: within its performance, with a GNSS fix
FIX, SATELLITES, DILUTION = 3, 14, 0.9
LAST_DIGIT_C = 0.01  # it moves, since firmware takes numbers that never do for a dead barometer
TEMPERATURE_C, SEA_LEVEL_KPA, KPA_PER_M = 15.0, 101.325, 0.012
LONGEST = 256  # of a command; what is longer is noise
GPS_EPOCH_UNIX_S, LEAP_S = 315_964_800, 18


class Fix(NamedTuple):
    """Readings on the Earth: place [deg, deg, m], field [gauss, body], GPS time [ns]."""

    place: tuple[float, float, float]
    field: Vector
    gps_ns: int


def sentence(text: str) -> bytes:
    """`VNASY,0` -> `$VNASY,0*CK` with its checksum and line end."""
    return f"${text}*{reduce(xor, text.encode(), 0):02X}\r\n".encode()


def packet(register: int, *values: float) -> bytes:
    """The binary packet of a register."""
    body = HEADERS[register] + FIELDS[register].pack(*values)
    return SYNC + body + crc_hqx(body, 0).to_bytes(2, "big")


def imu_packet(r: Readings, at: Fix) -> bytes:
    """Rates and specific force; the uncompensated ones are the same."""
    pressure = SEA_LEVEL_KPA - KPA_PER_M * at.place[2]
    temperature = TEMPERATURE_C + LAST_DIGIT_C * (int(r.time) % 2)
    return packet(
        IMU, round(r.time * 1e9), *r.gyro, *r.accel, *r.accel, *r.gyro, *at.field, temperature,
        pressure,
    )  # fmt: skip


def ins_packet(r: Readings, at: Fix) -> bytes:
    """Attitude, place and velocity as the device's filter has them."""
    roll, pitch, yaw = r.attitude
    w, x, y, z = quaternion(roll, pitch, yaw)
    return packet(
        INS, round(r.time * 1e9), degrees(yaw), degrees(pitch), degrees(roll), x, y, z, w,
        0.5, 0.2, 0.2, TRACKING, *at.place, *r.velocity, 0.3, 0.05,
    )  # fmt: skip


def gnss_packet(r: Readings, at: Fix) -> bytes:
    """Place and velocity as its receiver has them."""
    return packet(
        GNSS, round(r.time * 1e9), at.gps_ns, SATELLITES, FIX, *at.place, *r.velocity,
        0.5, 0.5, 0.8, 0.1, *(DILUTION,) * 7, 0, 0,
    )  # fmt: skip


class Registers:
    """The device's side of the conversation: commands in, answers out, and what it then sends."""

    def __init__(self) -> None:
        self._rest = b""
        self.streaming = False
        self.hertz: dict[int, float] = {}

    def received(self, data: bytes) -> tuple[list[bytes], int, bool]:
        """Bytes -> answers, how many commands were wrong, whether the driver has begun anew."""
        *lines, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        self._rest = self._rest[-LONGEST:]
        answers, wrong, anew = list[bytes](), 0, False
        for line in filter(None, lines):
            text = checked(line)
            if text is None:
                wrong += 1
                continue
            anew = anew or (text == "VNASY,0" and self.streaming)
            answers.append(sentence(self._answer(text)))
        return answers, wrong, anew

    def _answer(self, text: str) -> str:
        name, *words = text.split(",")
        if name == "VNASY":
            self.streaming = words[:1] == ["1"]
        if name == "VNRRG" and words[:1] in (["01"], ["1"]):
            return f"{text},{MODEL}"
        if name == "VNWRG" and words and words[0].isdigit() and int(words[0]) in HEADERS:
            divisor = int(words[2]) if len(words) > 2 and words[2].isdigit() else 0
            if divisor > 0:
                self.hertz[int(words[0])] = BASE_HZ / divisor
        return text


def checked(line: bytes) -> str | None:
    """`$TEXT*CK` -> TEXT; None where it is none."""
    start, star = line.rfind(b"$"), line.rfind(b"*")
    if start < 0 or star < start or len(line) > LONGEST:
        return None
    body = line[start + 1 : star]
    try:
        right = int(line[star + 1 : star + 3], 16) == reduce(xor, body, 0)
        return body.decode("ascii") if right else None
    except ValueError:
        return None


HZ = 25  # Rover's loop of 50 Hz allows no more than 40
FRESH_S = 1.0  # older pulses are none
ASK_S = 2.0  # between two requests while they do not come often enough
RETRY_S = 1.0  # between attempts to open the link
AUTOPILOT = mavlink.MAV_COMP_ID_AUTOPILOT1


class ServoOutputs:
    """Pulses by output on one link; open while inside."""

    def __init__(self, link: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._link, self._clock = link, clock
        self._transport = transport_of(link)
        self._waker = Waker()
        self._parser: Any = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._transmitter = Transmitter(Identity(), None, 0)
        self._pulses: Mapping[int, float] = {}
        self._heard = self._asked = self._since = float("-inf")
        self._count = 0
        self._thread = Thread(target=self._listen, name=f"outputs on {link}", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._waker.wake()
        self._thread.join()
        self._waker.__exit__()

    def pulses(self) -> Mapping[int, float] | None:
        """The newest pulses [µs] by output; None where none came within a second."""
        return self._pulses if self._clock() - self._heard < FRESH_S else None

    def _listen(self) -> None:
        while True:
            try:
                self._transport.open(self._waker, lambda kind, text: None)
                while True:
                    self._receive()
            except Closing:
                break
            except OSError:
                self._transport.close()
            try:
                self._waker.sleep(RETRY_S)
            except Closing:
                break
        self._transport.close()

    def _receive(self) -> None:
        for arrival in self._transport.receive(RETRY_S):
            for message in self._parser.parse_buffer(arrival.data) or ():
                self._note(message, arrival.peer)

    def _note(self, message: Any, peer: Peer) -> None:
        kind, now = message.get_type(), self._clock()
        if kind == "SERVO_OUTPUT_RAW":
            first = 16 * message.port + 1
            new = {first + n: float(getattr(message, f"servo{n + 1}_raw")) for n in range(16)}
            self._pulses = {**self._pulses, **new}
            self._heard, self._count = now, self._count + 1
        if kind == "HEARTBEAT" and message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
            self._ask(message.get_srcSystem(), peer, now)

    def _ask(self, system: int, peer: Peer, now: float) -> None:
        """Ask for the rate where they come less than half as often."""
        if now - self._asked < ASK_S:
            return
        often = self._count >= 0.5 * HZ * (now - self._asked)
        self._asked, self._count = now, 0
        if often:
            return
        request = mavlink.MAVLink_command_long_message(
            system, AUTOPILOT, SET_RATE, 0, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 1e6 / HZ,
            0, 0, 0, 0, 0,
        )  # fmt: skip
        raw = self._transmitter.pack(request)
        permitted(raw)
        self._transport.send(raw, peer)


def check_link(link: str | None) -> str:
    """The link, or BadInput that says that one is needed."""
    if link is None:
        raise BadInput(
            "ahrs: the servo outputs come back by MAVLink: give --outputs LINK, as in "
            "--outputs /dev/ttyACM0,115200 or --outputs tcp:127.0.0.1:5760"
        )
    transport_of(link)
    return link


WARNING = (
    "MOTORS MAY TURN: a real board drives its outputs from now on as if it were afloat. Take the "
    "propellers off, or cut the motors' power, before anything is armed"
)
STEP_S = 0.005  # of the boat, at most
WAIT_S = 0.5
BEHIND_S = 0.25  # what is later than this is not made up for
PACKETS = {IMU: imu_packet, INS: ins_packet, GNSS: gnss_packet}


class AhrsSession(Session):
    """One board; nothing goes out before its driver has asked."""

    talks = False
    absent = (
        "no board has asked yet. Its driver does that when it starts: reboot the board (as a "
        "program: start it again) while this runs"
    )

    def __init__(self, played: Played, outputs: ServoOutputs) -> None:
        super().__init__(played)
        self._outputs, self._place = outputs, Origin(*played.boat.day.place)
        now = datetime.now(UTC)
        self._gps_ns = round((now.timestamp() - GPS_EPOCH_UNIX_S + LEAP_S) * 1e9)
        self._field = magnetic_field(self._place, now.year + now.month / 12.0)
        self._registers = Registers()
        self._next = 0.0
        self._due: dict[int, float] = {}
        self._begun = False

    def received(self, data: bytes, peer: Peer, now: float) -> list[bytes]:
        """Commands of the driver -> its answers."""
        was = self._registers.streaming
        answers, wrong, anew = self._registers.received(data)
        if wrong:
            self.played.notice("malformed", "a command with a wrong checksum; it is passed over")
        if self._registers.streaming and (anew or not was):
            rates = ", ".join(f"{hertz:g} Hz" for hertz in self._registers.hertz.values())
            if self._begun:
                text = f"the board has begun anew ({rates}): the boat starts anew"
            else:
                text = f"a board asks ({rates})"
            self.played.start("restart" if self._begun else "there", text)
            self._begun, self._next = True, now
            self._due = dict.fromkeys(self._registers.hertz, 0.0)
        return answers

    def wait_s(self, now: float) -> float:
        """How long nothing is due [s]."""
        return min(max(self._next - now, 0.0), WAIT_S) if self._registers.streaming else WAIT_S

    def due(self, now: float, peers: tuple[Peer, ...]) -> list[bytes]:
        """The packets whose time has come."""
        if not peers:
            self._registers.streaming = False  # whoever comes next will ask anew
        if not self._registers.streaming or now < self._next:
            return []
        self._next = max(self._next + STEP_S, now - BEHIND_S)
        pulses = self._outputs.pulses()
        if pulses is None:
            self.played.notice("deaf", "no servo outputs are heard: motors stand still")
        readings = self.played.step(pulses or {}, STEP_S)
        at = self._fix(readings)
        return [PACKETS[register](readings, at) for register in self._registers_due(readings.time)]

    def _registers_due(self, time: float) -> list[int]:
        """Those whose packet is due; one that was held up is not made up for."""
        found = [r for r in self._registers.hertz if time >= self._due.get(r, 0.0)]
        for register in found:
            self._due[register] = max(self._due.get(register, 0.0), time - STEP_S) + (
                1.0 / self._registers.hertz[register]
            )
        return found

    def _fix(self, r: Readings) -> Fix:
        lat, lon = degrees_e7(self._place, *r.position[:2])
        field = to_hull(Attitude(*r.attitude, *(0.0,) * 6), *self._field)
        place = (lat * 1e-7, lon * 1e-7, -r.position[2])
        return Fix(place, field, self._gps_ns + round(r.time * 1e9))
