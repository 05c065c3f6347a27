"""Frames are found whatever stands around them, and the same ones as in a log."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.links.frame_reader import split_frames
from tests.gateway.ingest.streams import frames_of
from tests.gateway.links.boats import Autopilot

UNKNOWN = b"\xfd\x04\x00\x00\x07\x00\x00\xff\xff\xffabcd\x12\x34"  # id 0xFFFFFF, source 0/0


def raws(split):
    return [frame.raw for frame in split.frames if frame.known]


def test_all_frames_of_a_datagram_both_versions():
    boat = Autopilot()
    old = boat.frame(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3), version1=True)
    frames = [boat.heartbeat(), old, boat.attitude()]
    split = split_frames(b"".join(frames))
    assert raws(split) == frames
    assert (split.rest, split.junk_bytes, split.bad_checksum) == (b"", 0, 0)


def test_a_stray_magic_byte_swallows_nothing():
    frame = Autopilot().attitude()
    split = split_frames(b"\xfd\xff" + frame * 3 + b"xyz")
    assert raws(split) == [frame] * 3
    assert split.junk_bytes == 2 + 3


def test_a_wrong_checksum_is_counted_and_the_next_frame_found():
    frame = Autopilot().attitude()
    bad = frame[:-1] + bytes([frame[-1] ^ 1])
    split = split_frames(frame + bad + frame)
    assert raws(split) == [frame, frame]
    assert split.bad_checksum == 1


def test_an_unknown_id_is_kept_apart():
    frame = Autopilot().attitude()
    split = split_frames(frame + UNKNOWN + frame)
    assert [piece.raw for piece in split.frames] == [frame, UNKNOWN, frame]
    assert [piece.known for piece in split.frames] == [True, False, True]


def test_an_unknown_id_cannot_hide_a_good_frame():
    frame = Autopilot().attitude()
    cover = b"\xfd" + bytes([len(frame)]) + UNKNOWN[2:10] + frame + b"\x00\x00"
    assert raws(split_frames(cover)) == [frame]


def test_unknown_flags_are_not_taken():
    """A frame that needs more than MAVLink 2 defines cannot be understood."""
    raw = bytearray(Autopilot().attitude())
    raw[2] = 0x02
    assert raws(split_frames(bytes(raw))) == []


@settings(deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 60))
def test_any_cutting_of_a_stream_gives_the_same_frames(seed, size):
    random = np.random.default_rng(seed)
    boat = Autopilot()
    parts = [boat.attitude(k, float(random.normal())) for k in range(6)]
    frames = list(parts)
    for place in sorted(random.integers(0, 6, 2), reverse=True):
        parts.insert(place, random.integers(0, 253, random.integers(0, 9), np.uint8).tobytes())
    stream, found, rest = b"".join(parts), [], b""
    for at in range(0, len(stream), size):
        split = split_frames(rest + stream[at : at + size])
        found += raws(split)
        rest = split.rest
    assert found == frames


@settings(max_examples=300, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=40), st.sampled_from([b"\xfd", b"\xfe\x09", UNKNOWN]),
                          st.integers(0, 9).map(lambda k: Autopilot().attitude(k)))))  # fmt: skip
def test_every_byte_is_accounted_for_and_known_frames_are_a_logs(parts):
    data = b"".join(parts)
    split = split_frames(data)
    assert len(split.rest) < 280
    log = frames_of(raws(split), [0] * len(raws(split)))
    assert len(log) == len(raws(split))
    used = sum(len(p.raw) for p in split.frames) + len(split.rest) + split.junk_bytes
    refused = len(data) - used  # frames with a wrong checksum are no junk; covers may overlap
    if not split.bad_checksum and all(p.known for p in split.frames):
        assert refused == 0


@settings(deadline=None)
@given(st.binary(max_size=3000))
def test_noise_is_survived(data):
    split = split_frames(data)
    assert data.endswith(split.rest)
