"""Reading back: what was written, from a finished file, a killed writer's, and a repaired one."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC, Writer

from gateway.errors import BadInput
from gateway.ingest.open import open_log
from gateway.recording.reader import Recording
from gateway.recording.recorder import Recorder, RecordingSettings
from gateway.recording.repair import repair
from gateway.recording.spans import PREFIX, PREFIX_BYTES, read_spans
from gateway.recording.writer import Compression
from tests.conftest import ROOT
from tests.gateway.voyages import LATE, METADATA, VESSEL, event, frames_of, record, rows_of, times

SMALL = RecordingSettings(chunk_bytes=4000)


@pytest.mark.parametrize("compression", Compression)
def test_what_was_written_is_read_back(tmp_path: Path, compression: Compression) -> None:
    settings = RecordingSettings(chunk_bytes=4000, compression=compression)
    (path,) = record(tmp_path / "a.mcap", settings=settings)
    recording = Recording.open(path)
    assert recording.finished
    assert recording.metadata == METADATA
    assert recording.attachments == {VESSEL.name: VESSEL}
    read = list(recording.rows("shadow"))
    written = rows_of("shadow", 100)
    assert [payload for rows in read for payload in rows.payloads] == written.payloads
    assert np.concatenate([rows.vehicle_time_ns for rows in read]).tolist() == times(100).tolist()
    assert recording.counts()["measured"] == 100


def test_raw_frames_come_with_both_clocks_and_their_link(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", free=lambda _: 10**12, settings=SMALL) as recorder:
        recorder.write_raw(frames_of(50), times(50) + LATE, times(50), link="b")
        recorder.write_raw(frames_of(50, seed=1), times(50, 50) + LATE, link="a")
    raw = Recording.open(tmp_path / "a.mcap").raw()
    assert raw.frames() == frames_of(50) + frames_of(50, seed=1)
    assert raw.receive_time_ns.tolist() == (times(100) + LATE).tolist()
    assert raw.vehicle_time_ns[:50].tolist() == times(50).tolist()
    assert [raw.links[i] for i in raw.link.tolist()] == ["b"] * 50 + ["a"] * 50


def test_columns_are_the_fields(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap", settings=SMALL)
    columns = Recording.open(path).columns("control")
    values = np.random.default_rng(0).normal(size=(100, 6))
    assert np.array_equal(columns["surge_n"], values[:, 0])
    assert columns["vehicle_time_ns"].tolist() == times(100).tolist()
    assert Recording.open(path).columns("health") == {}


def unfinished(path: Path) -> Path:
    """A recording whose writer stopped in the middle of a chunk."""
    (whole,) = record(path, settings=SMALL)
    data = whole.read_bytes()
    path.write_bytes(data[: len(data) * 6 // 10])
    os.utime(path, (time.time() - 60, time.time() - 60))
    return path


def test_every_cut_of_a_file_opens_and_gives_a_beginning_of_it(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap", rows=40, settings=SMALL)
    data = path.read_bytes()
    frames = Recording.open(path).raw().frames()
    lengths = []
    for cut in (*range(8, 500), *range(500, len(data), 97)):  # the start: metadata, attachment
        path.write_bytes(data[:cut])
        recording = Recording.open(path)
        found = recording.raw().frames()
        assert not recording.finished
        assert recording.attachments in ({}, {VESSEL.name: VESSEL})
        assert found == frames[: len(found)]
        lengths.append(len(found))
    assert lengths == sorted(lengths)
    assert lengths[-1] == len(frames)


@pytest.mark.parametrize("tail", [b"\0" * 5000, b"\x06" + b"\xff" * 8, b"\x06\x20" + b"\0" * 200])
def test_a_tail_of_rubbish_ends_an_unfinished_file(tmp_path: Path, tail: bytes) -> None:
    path = unfinished(tmp_path / "a.mcap")
    before = Recording.open(path).counts()
    whole = Recording.open(path)._spans.records[-1]
    path.write_bytes(path.read_bytes()[: whole.start + whole.length] + tail)
    assert Recording.open(path).counts() == before


def test_records_of_a_kind_that_nobody_knows_are_passed_over(tmp_path: Path) -> None:
    """An application may write its own among the others (0x80 and above), also into a file that
    was never finished.
    """
    (path,) = record(tmp_path / "a.mcap", rows=40, settings=SMALL)
    data, frames = path.read_bytes(), Recording.open(path).raw().frames()
    spans = read_spans(BytesIO(data), len(data)).records
    second = [span for span in spans if span.opcode == Opcode.CHUNK][1].start - PREFIX_BYTES
    own = PREFIX.pack(0x91, 12) + b"of ourselves"
    path.write_bytes(data[:second] + own + data[second:])
    assert Recording.open(path).finished
    assert Recording.open(path).raw().frames() == frames
    path.write_bytes(data[:second] + own + data[second : spans[-1].start - PREFIX_BYTES])
    assert not Recording.open(path).finished
    assert Recording.open(path).raw().frames() == frames


def streamed(path: Path, size: int | None = None) -> None:
    """Pack its chunks anew as a writer does that streams: the packed data do not tell how much
    they hold; size: what the chunk says of that [bytes], else the truth.
    """
    data, out = path.read_bytes(), MCAP0_MAGIC
    for span in read_spans(BytesIO(data), len(data)).records:
        content = data[span.start : span.start + span.length]
        if span.opcode == Opcode.CHUNK:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            packer = zstandard.ZstdCompressor().compressobj()
            packed = packer.compress(zstandard.decompress(chunk.data)) + packer.flush()
            assert zstandard.frame_content_size(packed) == -1
            told = chunk.uncompressed_size if size is None else size
            record_of = RecordBuilder()
            replace(chunk, data=packed, uncompressed_size=told).write(record_of)
            out += record_of.end()
        elif span.opcode != Opcode.FOOTER:
            out += PREFIX.pack(span.opcode, span.length) + content
    path.write_bytes(out)


def test_a_chunk_that_was_packed_as_a_stream_is_read(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap", rows=40, settings=SMALL)
    frames = Recording.open(path).raw().frames()
    streamed(path)
    assert Recording.open(path).raw().frames() == frames


def test_a_stream_is_unpacked_as_far_as_its_chunk_says(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap", rows=40, settings=SMALL)
    streamed(path, size=100)
    assert Recording.open(path).raw().frames() == []
    (path,) = record(tmp_path / "b.mcap", rows=40, settings=SMALL)
    streamed(path, size=1 << 40)
    with pytest.raises(BadInput, match="unpacks to more than 200 times its size"):
        Recording.open(path).raw()


def test_repair_makes_an_unfinished_file_whole(tmp_path: Path) -> None:
    path = unfinished(tmp_path / "a.mcap")
    counts = Recording.open(path).counts()
    raw = Recording.open(path).raw().frames()
    result = repair(path)
    assert (result.was_finished, result.messages) == (False, sum(counts.values()))
    repaired = Recording.open(path)
    assert repaired.finished
    assert repaired.counts() == counts
    assert repaired.raw().frames() == raw
    assert repaired.metadata == METADATA
    assert repaired.attachments == {VESSEL.name: VESSEL}
    assert sorted(tmp_path.iterdir()) == [path, result.kept]  # it ended inside a chunk
    with path.open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == result.messages


def test_repair_leaves_a_finished_file_alone(tmp_path: Path) -> None:
    (path,) = record(tmp_path / "a.mcap")
    before = path.read_bytes()
    assert repair(path).was_finished
    assert path.read_bytes() == before


def test_repair_refuses_a_file_that_may_still_be_written(tmp_path: Path) -> None:
    path = unfinished(tmp_path / "a.mcap")
    before = path.read_bytes()
    written = path.stat().st_mtime
    with pytest.raises(BadInput, match="was written 9 s ago"):
        repair(path, now=lambda: written + 9.0)
    assert path.read_bytes() == before
    assert not repair(path, now=lambda: written + 10.0).was_finished


WRITER = """
import sys, time
from pathlib import Path
from gateway.recording.recorder import Recorder
from tests.gateway.voyages import rows_of, frames_of, VESSEL, METADATA
frame = frames_of(1)
path = Path(sys.argv[1])
with Recorder(path, live=True, attachments=[VESSEL], metadata=METADATA) as recorder:
    while True:
        now = time.time_ns()
        recorder.write_rows(rows_of("measured", 1))
        recorder.write_raw(frame, [now])
        print(now, flush=True)
        time.sleep(0.02)
"""


@pytest.mark.alone
def test_a_killed_writer_loses_at_most_a_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        sent = [int(writer.stdout.readline()) for _ in range(120)]
        writer.send_signal(signal.SIGKILL)
        sent += [int(line) for line in writer.stdout]
    recording = Recording.open(path)
    assert not recording.finished
    assert recording.attachments == {VESSEL.name: VESSEL}
    kept = recording.raw().receive_time_ns.tolist()
    assert kept == sent[: len(kept)]
    assert sent[-1] - kept[-1] <= 1_000_000_000
    repair(path, now=lambda: path.stat().st_mtime + 60.0)
    assert Recording.open(path).finished
    with path.open("rb") as stream:
        found = list(make_reader(stream).iter_messages(topics=["mavlink/raw"]))
    assert [message.log_time for _, _, message in found] == kept


def test_a_file_without_chunks_is_read_too(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start()
        channel = writer.register_channel("mavlink/raw", "mavlink", 0)
        writer.add_message(channel, 5, b"frame", 4)
        writer.finish()
    raw = Recording.open(path).raw()
    assert (raw.frames(), raw.receive_time_ns.tolist()) == ([b"frame"], [5])


@pytest.mark.parametrize("content", [b"", b"text\n", b"\x89MCAP"])
def test_what_is_no_recording_is_one_clear_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(BadInput, match="not an MCAP file") as caught:
        Recording.open(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder_are_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be read: No such file"):
        Recording.open(tmp_path / "none.mcap")
    with pytest.raises(BadInput, match="cannot be read: Is a directory"):
        Recording.open(tmp_path)


def test_a_recording_without_frames_is_no_log(tmp_path: Path) -> None:
    with Recorder(tmp_path / "a.mcap", free=lambda _: 10**12) as recorder:
        recorder.write_rows(event())
    with pytest.raises(BadInput, match=r"holds no MAVLink frames.*simulate --log"):
        open_log(tmp_path / "a.mcap")


def heartbeats(count: int) -> list[bytes]:
    """MAVLink 2 frames by pymavlink itself."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    link = dialect.MAVLink(None, srcSystem=3, srcComponent=1)
    frames = []
    for number in range(count):
        frames.append(bytes(dialect.MAVLink_heartbeat_message(10, 3, 0, number, 4, 3).pack(link)))
        link.seq = (link.seq + 1) % 256
    return frames


@pytest.mark.parametrize("finished", [True, False])
def test_the_gateways_own_recording_is_a_log(tmp_path: Path, finished: bool) -> None:
    path = tmp_path / "a.mcap"
    with Recorder(path, free=lambda _: 10**12) as recorder:
        recorder.write_raw([*heartbeats(20), b"\xfd junk"], times(21) + LATE, link="udp")
    if not finished:
        path.write_bytes(path.read_bytes()[:-20])
    log = open_log(path)
    table = log.table("HEARTBEAT")
    assert log.kind == "mcap"
    assert log.counts() == {"HEARTBEAT": 20}
    assert table.columns["custom_mode"].tolist() == list(range(20))
    assert table.receive_time_ns.tolist() == (times(20) + LATE).tolist()
    assert log.statistics.truncated_tail is not finished
    assert log.statistics.size_bytes == path.stat().st_size
