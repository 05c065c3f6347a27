"""Random MAVLink streams, packed by pymavlink itself."""

import itertools
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.mavlink.log import Frames

START_US = 1_700_000_000_000_000
MESSAGES = [m for _, m in sorted(dialect.mavlink_map.items())]
SHORT_IDS = [m for m in MESSAGES if m.id < 256]


def message(kind: Any, payload: bytes) -> Any:
    """A message whose packed payload is `payload`, in the hands of pymavlink."""
    flat = kind.unpacker.unpack(payload)
    starts = [0, *itertools.accumulate(kind.lengths)]
    packed = [
        flat[starts[k]] if n == 1 else list(flat[starts[k] : starts[k] + n])
        for k, n in enumerate(kind.lengths)
    ]
    return kind(*[packed[k] for k in kind.orders])


def packer(system: int = 1, component: int = 1, key: bytes = b"") -> Any:
    """pymavlink's packer of one source; with a key it signs."""
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    if key:
        mav.signing.secret_key = key
        mav.signing.sign_outgoing = True
    return mav


def record(frame: bytes, time_us: int) -> bytes:
    """A record of a .tlog."""
    return struct.pack(">Q", time_us) + frame


def frames_of(frames: Sequence[bytes], receive_time_ns: Sequence[int]) -> Frames:
    """Frames one by one, as a recording delivers them."""
    end = np.cumsum(np.array([0, *map(len, frames)], np.int64))
    return Frames.from_buffer(b"".join(frames), end[:-1], end[1:], np.array(receive_time_ns))


def unknown_frame(number: int = 60_000, payload: bytes = b"bogus") -> bytes:
    """A frame of a message that no definition knows, with a checksum of nothing."""
    head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), 0, 0, 7, 0, 0, number & 0xFFFF, 0)
    return head + payload + b"\x12\x34"


@st.composite
def good_frames(draw: Any) -> bytes:
    """One frame that must be accepted: MAVLink 1 or 2, signed or not, any message."""
    first = draw(st.booleans())
    kind = draw(st.sampled_from(SHORT_IDS if first else MESSAGES))
    size = kind.unpacker.size
    # zeros at the end are common: MAVLink 2 leaves them out
    head = draw(st.binary(max_size=size))
    key = b"k" * 32 if not first and draw(st.booleans()) else b""
    mav = packer(draw(st.integers(1, 255)), draw(st.integers(0, 255)), key)
    mav.seq = draw(st.integers(0, 255))
    return bytes(message(kind, head.ljust(size, b"\0")).pack(mav, force_mavlink1=first))


def damaged(frame: bytes, at: int, cut: bool) -> bytes:
    """The record of a frame with one wrong byte up to its checksum, or cut off behind that byte.

    A signature stands behind the checksum: pymavlink without the key does not look at it either.
    """
    checksum_at = frame[1] + (6 if frame[0] == 0xFE else 10)
    k = min(at, checksum_at)
    wrong = frame[:k] + bytes([frame[k] ^ 0x55])
    return record(wrong + (b"" if cut else frame[k + 1 :]), START_US)


def harmless(junk: bytes) -> bytes:
    """Junk that may begin like a frame but never is one: hypothesis builds whole ones otherwise."""
    return junk.replace(b"\xfd", b"\xfd\xff\xff").replace(b"\xfe", b"\xfe\xff")


DAMAGE = st.one_of(
    st.binary(max_size=40).map(harmless),
    st.integers(1, 600).map(bytes),  # a hole of zeros
    st.builds(damaged, good_frames(), st.integers(0, 300), st.booleans()),
    st.builds(lambda: record(unknown_frame(), START_US)),
)


@st.composite
def streams(draw: Any) -> tuple[bytes, list[bytes]]:
    """Bytes of a .tlog with damage in between, and the frames in it that are whole."""
    pieces, frames = [draw(DAMAGE)], []
    for k, frame in enumerate(draw(st.lists(good_frames(), max_size=12))):
        frames.append(frame)
        pieces += [record(frame, START_US + 1000 * k), draw(st.just(b"") | DAMAGE)]
    return b"".join(pieces), frames
