"""Recordings with damaged bytes: what is behind them is read, and repair loses nothing."""

import os
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from gateway.errors import BadInput, ShadowError
from gateway.recording.reader import Recording
from gateway.recording.recorder import Recorder, RecordingSettings
from gateway.recording.repair import repair
from gateway.recording.spans import MAX_TRIES, PREFIX, PREFIX_BYTES, Span, read_spans
from gateway.recording.writer import Compression
from tests.gateway.command_line import Run, one_line
from tests.gateway.test_recording import heartbeats
from tests.gateway.voyages import LATE, record, times

SMALL = RecordingSettings(chunk_bytes=4000)
LENGTH = slice(1, PREFIX_BYTES)


class Whole(NamedTuple):
    """A finished recording of several chunks, before anything happens to it."""

    path: Path
    data: bytes
    chunks: list[Span]
    messages: int

    def write(self, data: bytes) -> Path:
        """Put other bytes into the file, as if a minute ago."""
        self.path.write_bytes(data)
        os.utime(self.path, (1.0, 1.0))
        return self.path

    def flipped(self, *places: int) -> Path:
        """The file with bytes changed."""
        data = bytearray(self.data)
        for place in places:
            data[place] ^= 0x55
        return self.write(bytes(data))

    def head(self, chunk: int) -> int:
        """Where the opcode of a chunk stands."""
        return self.chunks[chunk].start - PREFIX_BYTES


@pytest.fixture(params=Compression)
def whole(tmp_path: Path, request: pytest.FixtureRequest) -> Whole:
    settings = RecordingSettings(chunk_bytes=4000, compression=request.param)
    return whole_at(tmp_path, settings)


@pytest.fixture
def small(tmp_path: Path) -> Whole:
    return whole_at(tmp_path, SMALL)


def whole_at(folder: Path, settings: RecordingSettings) -> Whole:
    (path,) = record(folder / "a.mcap", settings=settings)
    data = path.read_bytes()
    spans = read_spans(BytesIO(data), len(data)).records
    chunks = [span for span in spans if span.opcode == Opcode.CHUNK]
    assert len(chunks) > 4
    return Whole(path, data, chunks, messages(path))


def messages(path: Path) -> int:
    return sum(Recording.open(path).counts().values())


def of_others(path: Path) -> int:
    """How many messages the library's own reader finds."""
    with path.open("rb") as stream:
        return sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())


@pytest.mark.parametrize("byte", range(PREFIX_BYTES))
def test_the_head_of_a_chunk_may_be_damaged(whole: Whole, byte: int) -> None:
    """Its opcode, and each byte of its length: what it holds says both once more."""
    path = whole.flipped(whole.head(2) + byte)
    recording = Recording.open(path)
    assert recording.finished
    assert messages(path) == whole.messages
    assert recording.damage
    before = path.read_bytes()
    done = repair(path)
    assert not done.was_whole
    assert done.messages == of_others(path) == whole.messages
    assert done.kept is not None
    assert done.kept.read_bytes() == before


def test_no_damaged_byte_takes_more_than_its_chunk(small: Whole) -> None:
    of_chunk = -(-small.messages // len(small.chunks)) * 2
    for place in range(len(MCAP0_MAGIC), len(small.data) - len(MCAP0_MAGIC), 1501):
        recording = Recording.open(small.flipped(place))
        count = messages(small.path)
        assert count >= small.messages - 2 * of_chunk
        assert count == small.messages or recording.damage


def test_a_damaged_size_is_no_bomb_also_where_no_index_tells_the_true_one(small: Whole) -> None:
    """Of a recording that was cut off: the packed data say themselves how much they unpack to."""
    cut = bytearray(small.data[: small.chunks[4].start])
    cut[small.chunks[2].start + 20] ^= 0x55  # of the size: two times of eight bytes are before it
    path = small.write(bytes(cut))
    assert (damage := Recording.open(path).damage).chunks == 1
    assert 0 < messages(path) < small.messages
    assert "1 of 4 chunks is damaged and left out" in damage.text()


def test_a_chunk_with_a_damaged_byte_is_left_out_and_told(whole: Whole) -> None:
    chunk = whole.chunks[2]
    path = whole.flipped(chunk.end - 20)
    text = Recording.open(path).damage.text()
    assert text.startswith(f"1 of {len(whole.chunks)} chunks is damaged and left out: about ")
    done = repair(path)
    assert 0 < done.messages < whole.messages
    assert of_others(path) == done.messages
    assert text in done.text()
    assert str(done.kept) in done.text()
    assert repair(path).was_whole


def hole(data: bytes, chunks: list[Span]) -> bytes:
    return data[: chunks[1].start] + bytes(6000) + data[chunks[1].start + 6000 :]


def gone(data: bytes, chunks: list[Span]) -> bytes:
    return data[: chunks[1].start + 10] + data[chunks[3].start + 10 :]


@pytest.mark.parametrize("harm", [hole, gone])
def test_a_stretch_that_is_overwritten_or_missing(
    whole: Whole, harm: Callable[[bytes, list[Span]], bytes]
) -> None:
    path = whole.write(harm(whole.data, whole.chunks))
    recording = Recording.open(path)
    assert recording.finished
    assert 1 <= recording.damage.chunks <= 5
    assert recording.damage.of_chunks == len(whole.chunks)
    done = repair(path)
    assert done.messages == of_others(path) > 0
    assert done.messages >= whole.messages * (len(whole.chunks) - 5) // len(whole.chunks) - 30


def test_what_is_behind_damage_of_an_unfinished_file_is_read(small: Whole) -> None:
    cut = small.head(4)
    path = small.write(small.data[:cut])
    before = messages(path)
    data = bytearray(small.data[:cut])
    data[small.chunks[2].end - 20] ^= 0x55
    path = small.write(bytes(data))
    assert 0.6 * before < messages(path) < before
    assert "1 of 4 chunks is damaged" in Recording.open(path).damage.text()


def test_channels_of_a_chunk_that_is_lost_are_in_the_summary(small: Whole) -> None:
    path = small.flipped(small.chunks[0].end - 20)
    assert messages(path) > small.messages // 2
    assert not Recording.open(path).damage.messages
    cut = small.write(path.read_bytes()[: small.head(4)])  # no summary
    recording = Recording.open(cut)
    assert recording.damage.messages > 0
    assert "of unknown channels left out" in recording.damage.text()
    repair(cut)


def test_a_damaged_attachment_is_told(small: Whole) -> None:
    spans = read_spans(BytesIO(small.data), len(small.data)).records
    (place,) = [span for span in spans if span.opcode == Opcode.ATTACHMENT]
    path = small.flipped(place.end - 10)
    recording = Recording.open(path)
    assert recording.attachments == {}
    assert recording.damage.text() == "damaged attachment left out"
    assert repair(path).messages == small.messages


def test_repair_replaces_no_file_that_was_kept_before(small: Whole) -> None:
    path = small.flipped(small.head(2))
    before = path.read_bytes()
    kept = path.with_name("a.mcap.damaged")
    kept.write_text("of yesterday")
    with pytest.raises(BadInput, match=r"a\.mcap\.damaged exists"):
        repair(path)
    assert (path.read_bytes(), kept.read_text()) == (before, "of yesterday")
    assert sorted(path.parent.iterdir()) == [path, kept]


@pytest.mark.parametrize("data", [MCAP0_MAGIC, MCAP0_MAGIC + bytes(5000)])
def test_a_file_that_holds_nothing_is_left_as_it_is(small: Whole, data: bytes) -> None:
    path = small.write(data)
    with pytest.raises(BadInput, match="nothing in it can be read: it is left as it is"):
        repair(path)
    assert path.read_bytes() == data
    assert list(path.parent.iterdir()) == [path]


def test_what_is_not_copied_keeps_the_file_as_it_was(small: Whole) -> None:
    """Records of an application's own, and a second attachment of one name."""
    own = PREFIX.pack(0x91, 12) + b"of ourselves"
    spans = read_spans(BytesIO(small.data), len(small.data)).records
    (item,) = [span for span in spans if span.opcode == Opcode.ATTACHMENT]
    again = small.data[item.start - PREFIX_BYTES : item.end]
    path = small.write(small.data[: small.head(4)] + own + again)
    before = path.read_bytes()
    done = repair(path)
    assert not done.damage
    assert "2 records of unknown kinds or of a name that comes again left out" in done.text()
    assert done.kept is not None
    assert done.kept.read_bytes() == before


def test_zeros_behind_an_unfinished_file_are_nothing_to_keep(small: Whole) -> None:
    """A disk that lost power often leaves them."""
    path = small.write(small.data[: small.head(4)] + bytes(5000))
    assert repair(path).kept is None
    assert list(path.parent.iterdir()) == [path]


def test_a_message_without_a_channel_is_left_out(tmp_path: Path) -> None:
    """It ended in a KeyError."""
    message = b"\x05" + (23).to_bytes(8, "little") + bytes(23)
    path = tmp_path / "a.mcap"
    path.write_bytes(MCAP0_MAGIC + message + message)
    recording = Recording.open(path)
    assert recording.counts() == {}
    assert recording.damage.messages == 2


def test_info_and_repair_say_what_is_so(run: Run, small: Whole) -> None:
    path = small.flipped(small.chunks[2].end - 20)
    line = run("repair", path).out
    assert "1 of " in line
    assert "the file as it was: " in line
    one_line(run("repair", small.write(MCAP0_MAGIC)), 2, "nothing in it can be read")


def test_a_log_says_what_its_recording_lacks(tmp_path: Path) -> None:
    from gateway.ingest.open import open_log

    path = tmp_path / "a.mcap"
    with Recorder(path, free=lambda _: 10**12, settings=SMALL) as recorder:
        for k in range(20):
            recorder.write_raw(heartbeats(100), times(100, 100 * k) + LATE, link="udp")
    data = bytearray(path.read_bytes())
    spans = read_spans(BytesIO(data), len(data)).records
    chunks = [span for span in spans if span.opcode == Opcode.CHUNK]
    path.write_bytes(data[: chunks[3].end])
    unfinished = "the recording was not finished: `shadow repair` makes it whole"
    assert unfinished in open_log(path).statistics.notes
    data[chunks[2].end - 20] ^= 0x55
    path.write_bytes(data)
    found = open_log(path).statistics
    (note,) = [note for note in found.notes if "damaged" in note]
    assert note.startswith(f"1 of {len(chunks)} chunks is damaged and left out: about ")
    assert "not finished" not in note
    assert not found.truncated_tail
    path.write_bytes(data[: chunks[3].end])
    (note,) = [note for note in open_log(path).statistics.notes if "damaged" in note]
    assert "and the recording was not finished: `shadow repair` writes" in note


def test_a_file_in_which_no_log_is_left_is_refused(tmp_path: Path) -> None:
    from gateway.ingest.open import open_log

    (path,) = record(tmp_path / "a.mcap")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x55  # of its only chunk
    path.write_bytes(data)
    with pytest.raises(ShadowError, match="the file is damaged: use another copy of it"):
        open_log(path)


def test_a_file_of_what_only_looks_like_records_is_given_up(tmp_path: Path) -> None:
    """Looking for the next record has a limit (MAX_TRIES): a large file took minutes."""
    path = tmp_path / "a.mcap"
    looks = b"\x03" + (5).to_bytes(8, "little")
    path.write_bytes(MCAP0_MAGIC + looks * (MAX_TRIES * 6))
    began = time.monotonic()
    assert not Recording.open(path).finished
    assert time.monotonic() - began < 60.0
