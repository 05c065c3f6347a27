"""A VectorNav VN-200 as ArduPilot's own driver talks to it: registers in, binary packets out. Pure.

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
"""

from binascii import crc_hqx
from functools import reduce
from math import degrees
from operator import xor
from struct import Struct
from typing import NamedTuple

from gateway.hil.px4 import quaternion
from sim.hil.inertial import Vector
from sim.hil.sensors import Readings

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
FIX_3D, SATELLITES, DILUTION = 3, 14, 0.9
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
        GNSS, round(r.time * 1e9), at.gps_ns, SATELLITES, FIX_3D, *at.place, *r.velocity,
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
