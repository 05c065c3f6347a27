"""ArduPilot's JSON interface: servo packets in, a line of JSON out. Pure.

A packet is little-endian: uint16 magic, uint16 frame rate [Hz], uint32 frame count, pulses uint16
[µs]; magic 18458 with 16 of them, 29569 with 32. The reply is a line of JSON between newlines:
without the first or the last the firmware is a frame late. It looks keys up as text, so there may
be no space after a colon, and `velocity` stands before `velocity_wind`, whose end it would match.

The firmware waits for the reply, and asks with the same count again when none came: then the same
answer is due, and the boat does not move. Count 0 is a firmware that has just started. Time in the
reply drives its clock; the frame rate only says how far to go.

Source: libraries/SITL/examples/JSON/readme.md of ArduPilot; order of keys, spaces, newlines and
repeated counts as Rover 4.6.3 has them.
"""

from struct import Struct, error
from typing import NamedTuple

import orjson

from gateway.hil import Played, Session
from gateway.links import Peer, peer_text
from sim.hil import Readings

CHANNELS = {18458: 16, 29569: 32}  # magic -> pulses
HEAD = Struct("<HHI")
PULSES = {magic: Struct(f"<{count}H") for magic, count in CHANNELS.items()}
FORM = "expected 40 bytes with magic 18458 or 72 with 29569, ArduPilot's JSON interface"
ALONE_S = 1.5  # firmware that has said nothing for so long is gone: it asks again after 1.1 s


class MalformedPacket(ValueError):
    """No servo packet; the message says why."""


class ServoPacket(NamedTuple):
    """What the firmware sends for each frame."""

    frame_rate: int  # Hz
    frame_count: int
    pulses: tuple[int, ...]  # µs, of channels 1, 2, …


def parse_packet(data: bytes) -> ServoPacket:
    """A datagram -> the packet in it; MalformedPacket says what is wrong."""
    try:
        magic, rate, count = HEAD.unpack_from(data)
    except error:
        raise MalformedPacket(f"a datagram of {len(data)} bytes: {FORM}") from None
    if magic not in CHANNELS:
        raise MalformedPacket(f"a datagram with magic {magic}: {FORM}")
    if len(data) != HEAD.size + PULSES[magic].size:
        raise MalformedPacket(f"a datagram of {len(data)} bytes with magic {magic}: {FORM}")
    if rate == 0:
        raise MalformedPacket("a servo packet with a frame rate of 0 Hz: expected 1 or more")
    return ServoPacket(rate, count, PULSES[magic].unpack_from(data, HEAD.size))


def reply(readings: Readings) -> bytes:
    """Readings as the line that the firmware parses."""
    values: dict[str, object] = {
        "timestamp": readings.time,
        "imu": {"gyro": readings.gyro, "accel_body": readings.accel},
        "position": readings.position,
        "attitude": readings.attitude,
        "velocity": readings.velocity,
        "battery": {"voltage": readings.voltage, "current": readings.current},
    }
    if readings.wind is not None and readings.vane is not None:
        values["velocity_wind"] = (*readings.wind, 0.0)
        values["windvane"] = {"direction": readings.vane[0], "speed": readings.vane[1]}
    if readings.depth is not None:
        values["rng_1"] = readings.depth
    return b"\n" + orjson.dumps(values) + b"\n"


class JsonSession(Session):
    """Lock-step with one firmware; another takes its place when it has fallen silent."""

    absent = (
        "no ArduPilot has called yet. As a program it first waits for a ground station on its own "
        "port: TCP 5760, 5770 with -I1"
    )

    def __init__(self, played: Played) -> None:
        super().__init__(played)
        self._count: int | None = None
        self._peer: Peer | None = None
        self._answer = b""
        self._heard_s = 0.0
        self._other: Peer | None = None  # who spoke while the firmware may still be there

    def received(self, data: bytes, peer: Peer, now: float) -> list[bytes]:
        """A datagram -> the answer, or none where there is nothing to answer."""
        try:
            packet = parse_packet(data)
        except MalformedPacket as problem:
            self.played.notice("malformed", f"{problem}; it is passed over")
            return []
        if peer != self._peer and self._peer is not None and now - self._heard_s < ALONE_S:
            self._other = peer
            return []
        if peer == self._peer and self._other is not None:
            text = f"{peer_text(self._other)} speaks as well: one firmware for each endpoint"
            self.played.notice("second", text)
        self._heard_s, self._other = now, None
        if peer == self._peer and packet.frame_count == self._count:
            self.played.count("repeated", "the firmware asked again: a packet was lost or late")
            return [self._answer]
        if not self._follow(packet.frame_count, peer):
            return []
        pulses = dict(enumerate(packet.pulses, 1))
        self._answer = reply(self.played.step(pulses, 1.0 / packet.frame_rate))
        self.played.keep(packet.frame_count)
        return [self._answer]

    def wait_s(self, now: float) -> float:
        """Nothing is due before a packet comes."""
        return 1.0

    def due(self, now: float, peers: tuple[Peer, ...]) -> list[bytes]:
        """Nothing: the firmware speaks first."""
        return []

    def _follow(self, count: int, peer: Peer) -> bool:
        """Take note of a new count -> whether to answer it."""
        last, same = self._count, peer == self._peer
        if last is None:
            text = f"the firmware is there, frame {count}{self._joined(count)}"
            self.played.start("there", text, under_way=count > 0)
        elif count == 0 or not same:
            text = f"the firmware has restarted, frame {count}: the boat starts anew"
            self.played.start("restart", text, under_way=count > 0)
        elif count < last:
            self.played.count("late", "a packet came twice or too late; it is passed over")
            return False
        elif count > last + 1:
            self.played.notice("gap", f"{count - last - 1} frames of the firmware were lost")
        self._count, self._peer = count, peer
        return True

    def _joined(self, count: int) -> str:
        """Where the boat of a firmware that has just called begins, as the end of a sentence."""
        if count == 0:
            return ""
        if self.played.resume(count):
            return ": the boat goes on where it was"
        return (
            ": it runs already, and the boat begins anew at its start, since "
            f"{self.played.misfit(count)}. The firmware's filter will not follow a boat that "
            "jumps: restart the firmware"
        )
