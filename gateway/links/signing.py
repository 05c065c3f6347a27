"""MAVLink 2 signatures: 6 bytes of SHA-256(key, frame, link id, timestamp) at the end of a frame.

Timestamps count 10 µs since 2015 and only grow within a stream (link id, system, component); a
new stream may be at most a minute behind the newest timestamp that is known here.

pymavlink's own check is not used: it moves a stream's timestamp before it has verified the
signature, so that one forged frame can lock a boat out for good.
"""

import hashlib
import hmac
import string
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

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
