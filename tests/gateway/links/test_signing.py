"""Signatures: pymavlink signs, we verify, and the other way round."""

import hashlib

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.links.transmitter import (
    MINUTE_TICKS,
    Identity,
    Signatures,
    SignatureStatus,
    Transmitter,
    load_key,
    signing_timestamp,
)
from tests.gateway.links.boats import Autopilot

KEY = bytes(range(32))
NOW = 1_760_000_000_000_000_000


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (KEY, KEY),
        (KEY.hex().encode(), KEY),
        (KEY.hex().upper().encode() + b"\r\n", KEY),
        (b"open sesame\n", hashlib.sha256(b"open sesame").digest()),
        (b"exactly thirty-one characters..\n",
         hashlib.sha256(b"exactly thirty-one characters..").digest()),
        ("Möwe".encode(), hashlib.sha256("Möwe".encode()).digest()),
    ],
)  # fmt: skip
def test_three_kinds_of_key_files(tmp_path, content, key):
    path = tmp_path / "key"
    path.write_bytes(content)
    assert load_key(path) == key


@pytest.mark.parametrize("content", [b"", b"\n", b"one\ntwo\n", bytes(31), bytes(33), b"\xff\xfe"])
def test_what_is_no_key_says_so(tmp_path, content):
    path = tmp_path / "key"
    path.write_bytes(content)
    with pytest.raises(BadInput, match="64 hexadecimal digits"):
        load_key(path)


def test_a_key_that_is_not_there(tmp_path):
    with pytest.raises(BadInput, match="cannot read the signing key"):
        load_key(tmp_path / "none")


def signed(timestamp, system=1, key=KEY):
    return Autopilot(system, key, timestamp).attitude()


def test_pymavlinks_signature_holds_and_the_wrong_key_does_not():
    frame = signed(signing_timestamp(NOW))
    assert Signatures(KEY).check(frame, NOW) is SignatureStatus.VALID
    assert Signatures(bytes(32)).check(frame, NOW) is SignatureStatus.WRONG


def test_unsigned_frames_of_both_versions():
    boat = Autopilot()
    old = boat.frame(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3), version1=True)
    assert Signatures(KEY).check(boat.attitude(), NOW) is SignatureStatus.UNSIGNED
    assert Signatures(KEY).check(old, NOW) is SignatureStatus.UNSIGNED


def test_any_changed_byte_breaks_it():
    frame = signed(signing_timestamp(NOW))
    for at in range(3, len(frame)):
        changed = frame[:at] + bytes([frame[at] ^ 0x10]) + frame[at + 1 :]
        assert Signatures(KEY).check(changed, NOW) is SignatureStatus.WRONG


def test_timestamps_of_a_stream_only_grow():
    keeper, t = Signatures(KEY), signing_timestamp(NOW)
    assert keeper.check(signed(t), NOW) is SignatureStatus.VALID
    assert keeper.check(signed(t), NOW) is SignatureStatus.OLD
    assert keeper.check(signed(t - 1), NOW) is SignatureStatus.OLD
    assert keeper.check(signed(t + 1), NOW) is SignatureStatus.VALID
    assert keeper.check(signed(t, system=2), NOW) is SignatureStatus.VALID


def test_a_new_stream_may_be_a_minute_behind():
    t = signing_timestamp(NOW)
    assert Signatures(KEY).check(signed(t - MINUTE_TICKS), NOW) is SignatureStatus.VALID
    assert Signatures(KEY).check(signed(t - MINUTE_TICKS - 1), NOW) is SignatureStatus.OLD


def test_a_forged_frame_locks_nobody_out():
    """pymavlink moves the stream's time before it has verified the signature."""
    keeper, t = Signatures(KEY), signing_timestamp(NOW)
    forged = signed(t + 10 * MINUTE_TICKS, key=bytes(32))
    assert keeper.check(forged, NOW) is SignatureStatus.WRONG
    assert keeper.check(signed(t), NOW) is SignatureStatus.VALID


def test_what_we_sign_pymavlink_accepts_and_time_never_stands():
    keeper, voice = Signatures(KEY), Transmitter(Identity(), KEY, link_id=3)
    boat = dialect.MAVLink(None)
    boat.signing.secret_key = KEY
    boat.signing.timestamp = signing_timestamp(NOW) + 5
    keeper.check(signed(signing_timestamp(NOW) + 5), NOW)  # the boat is ahead of us
    for _ in range(3):
        stamp = keeper.next_timestamp(NOW)
        raw = voice.pack(dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), stamp)
        message = boat.decode(bytearray(raw))
        assert message.get_signed()
        assert message.get_link_id() == 3
    assert boat.signing.timestamp > signing_timestamp(NOW) + 5
