"""MAVLink 2 signatures: 6 bytes of SHA-256(key, frame, link id, timestamp) at the end of a frame.

Timestamps count 10 µs since 2015 and only grow within a stream (link id, system, component); a
new stream may be at most a minute behind the newest timestamp that is known here.

pymavlink's own check is not used: it moves a stream's timestamp before it has verified the
signature, so that one forged frame can lock a boat out for good.

All that the gateway can send to a boat: its own heartbeat, requests for message rates, and requests
to read parameters.

A shadow never commands a boat: every frame passes `permitted` before it reaches a transport.

**Parameters** that a boat is asked for are those that tell how its telemetry came about.

Reading changes nothing aboard. One name at a time and slowly, behind the requests for rates; what
is not answered is asked once more, and then left. Pure: time comes from outside.
"""

import hashlib
import hmac
import string
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput

KEY_BYTES = 32
EPOCH_S = 1_420_070_400  # 2015-01-01 in Unix time
TICK_NS = 10_000
MINUTE_TICKS = 6_000_000  # a new stream may be behind by as much: the MAVLink specification
SIGNED_FLAG = 0x01  # in byte 2 of a MAVLink 2 frame
BLOCK_BYTES, SIGNATURE_BYTES = 13, 6  # link id, timestamp and signature; the signature alone


class SignatureStatus(StrEnum):
    """The result of checking a frame's signature."""

    VALID = "valid"
    UNSIGNED = "unsigned"
    WRONG = "wrong signature"
    OLD = "old timestamp"  # the key is right: a repeated or late frame, or a boat behind in time


class SigningStream(NamedTuple):
    """The frames of one sender on one link: their timestamps only grow."""

    link_id: int
    system: int
    component: int


def load_key(path: str | Path) -> bytes:
    """The key in a file: 32 raw bytes, 64 hexadecimal digits, or a passphrase on one line.

    A passphrase is hashed with SHA-256, as Mission Planner and MAVProxy do. Printable text of 32
    characters is a passphrase: no random key looks like that.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: cannot read the signing key: {error.strerror}") from None
    try:
        line = content.decode("utf-8").rstrip("\r\n")
    except UnicodeDecodeError:
        line = ""
    if line and line.isprintable():
        return bytes.fromhex(line) if _is_hex(line) else hashlib.sha256(line.encode()).digest()
    if len(content) == KEY_BYTES:
        return content
    raise BadInput(
        f"{path}: no signing key: expected 32 raw bytes, 64 hexadecimal digits "
        "or a passphrase on one line"
    )


def _is_hex(line: str) -> bool:
    return len(line) == 2 * KEY_BYTES and all(c in string.hexdigits for c in line)


def signing_timestamp(unix_ns: int) -> int:
    """Unix time [ns] -> timestamp [10 µs since 2015], never negative."""
    return max(unix_ns - EPOCH_S * 1_000_000_000, 0) // TICK_NS


class Signatures:
    """Verifies the frames that one link receives; gives the timestamps to sign with."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._newest = self._sent = 0
        self._streams: dict[SigningStream, int] = {}

    def check(self, raw: bytes, now_ns: int) -> SignatureStatus:
        """Check the signature of a frame whose checksum holds, or cannot be known."""
        if raw[0] != 0xFD or not raw[2] & SIGNED_FLAG:
            return SignatureStatus.UNSIGNED
        expected = hashlib.sha256(self._key + raw[:-SIGNATURE_BYTES]).digest()[:SIGNATURE_BYTES]
        if not hmac.compare_digest(expected, raw[-SIGNATURE_BYTES:]):
            return SignatureStatus.WRONG
        stream = SigningStream(raw[-BLOCK_BYTES], raw[5], raw[6])
        stamp = int.from_bytes(raw[1 - BLOCK_BYTES : -SIGNATURE_BYTES], "little")
        known = max(self._newest, self._sent, signing_timestamp(now_ns))
        if stamp <= self._streams.get(stream, known - MINUTE_TICKS - 1):
            return SignatureStatus.OLD
        self._streams[stream] = stamp
        self._newest = max(self._newest, stamp)
        return SignatureStatus.VALID

    def next_timestamp(self, now_ns: int) -> int:
        """The next timestamp to sign with: above all that were sent or received."""
        self._sent = max(self._sent + 1, self._newest + 1, signing_timestamp(now_ns))
        return self._sent


GROUND_STATION = 255  # by convention the ground station's, whose commands a boat obeys
ONBOARD_COMPUTER: int = dialect.MAV_COMP_ID_ONBOARD_COMPUTER
SET_RATE: int = dialect.MAV_CMD_SET_MESSAGE_INTERVAL


@dataclass(frozen=True)
class Identity:
    """The gateway's own address on a link."""

    system: int = 245
    component: int = ONBOARD_COMPUTER

    def __post_init__(self) -> None:
        if not 1 <= self.system < GROUND_STATION:
            raise BadInput(
                f"own system id {self.system}: expected 1 … 254 (255 is the ground station's)"
            )
        if not 1 <= self.component <= 255:
            raise BadInput(f"own component id {self.component}: expected 1 … 255")


class Transmitter:
    """Packs messages for one link: address, sequence number and, with a key, signature."""

    def __init__(self, identity: Identity, key: bytes | None, link_id: int) -> None:
        self._mavlink = dialect.MAVLink(None, identity.system, identity.component)
        if key is not None:
            self._mavlink.signing.secret_key = key
            self._mavlink.signing.sign_outgoing = True
            self._mavlink.signing.link_id = link_id

    def pack(self, message: Any, timestamp: int = 0) -> bytes:
        """One frame; `timestamp` is what it is signed with."""
        self._mavlink.signing.timestamp = timestamp
        raw: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return raw


def permitted(raw: bytes) -> Any:
    """The message in a frame that may be sent; ValueError for anything else."""
    try:
        message = dialect.MAVLink(None).decode(bytearray(raw))
    except dialect.MAVError as error:
        raise ValueError(f"never sent: {error}") from None
    reading = message.get_type() == "PARAM_REQUEST_READ"
    if not (_own_heartbeat(message) or _rate_request(message) or reading):
        raise ValueError(f"never sent: {message.get_type()}")
    return message


def _own_heartbeat(message: Any) -> bool:
    return (
        message.get_type() == "HEARTBEAT"
        and message.type == dialect.MAV_TYPE_ONBOARD_CONTROLLER
        and message.autopilot == dialect.MAV_AUTOPILOT_INVALID
    )


def _rate_request(message: Any) -> bool:
    return message.get_type() == "COMMAND_LONG" and message.command == SET_RATE


GAP_NS = 200_000_000  # between two requests: answers share a radio with telemetry
ROUNDS = 2
SERVOS, PX4_OUTPUTS = 16, 8
WANTED = {
    "ArduPilot": (
        "INS_GYRO_FILTER",  # the delay of reported yaw rates
        "GPS_DELAY_MS",
        "GPS1_DELAY_MS",  # the same since 4.6
        *(
            f"SERVO{n}_{what}"
            for what in ("FUNCTION", "TRIM", "MIN", "MAX", "REVERSED")
            for n in range(1, SERVOS + 1)
        ),
    ),
    "PX4": (
        "IMU_GYRO_CUTOFF",  # the delay of reported yaw rates
        "CA_R_REV",  # which motors reverse
        *(f"PWM_{group}_FUNC{n}" for group in ("MAIN", "AUX") for n in range(1, PX4_OUTPUTS + 1)),
    ),
}


@dataclass(frozen=True)
class ParameterRequests:
    """The requests to one boat. Times [ns] are those of any clock that only goes forward."""

    system: int
    component: int
    pending: tuple[str, ...]  # to be sent, the next one first
    due_ns: int = 0

    @classmethod
    def of(cls, system: int, component: int, autopilot: str) -> "ParameterRequests":
        """All that a boat with that autopilot is asked for."""
        return cls(system, component, ROUNDS * WANTED[autopilot])

    @property
    def next_ns(self) -> int | None:
        """When the next request is due; None: never."""
        return self.due_ns if self.pending else None

    def due(self, now_ns: int) -> tuple["ParameterRequests", tuple[Any, ...]]:
        """The state after now, and the request to send, if any."""
        if not self.pending or now_ns < self.due_ns:
            return self, ()
        first, *others = self.pending
        after = replace(self, pending=tuple(others), due_ns=now_ns + GAP_NS)
        request = dialect.MAVLink_param_request_read_message(
            self.system, self.component, first.encode(), -1
        )
        return after, (request,)

    def answered(self, name: str) -> "ParameterRequests":
        """PARAM_VALUE came, whoever asked for it."""
        return replace(self, pending=tuple(other for other in self.pending if other != name))
