"""Small files that ask for much: refused by a limit with a name, in one short line, at once."""

import struct
import time
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from gateway.ingest.mavlink.log import MavlinkLog
from gateway.recording.reader import Recording
from gateway.recording.recorder import Recorder
from tests.gateway.command_line import Run, one_line
from tests.gateway.ingest.scripted import Script, heartbeat

SIZE = 1 << 30  # bytes that a chunk of the bomb unpacks to
SOON_S = 20.0


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def chunk(packed: bytes, size: int, compression: str) -> bytes:
    head = struct.pack("<QQQI", 0, 1, size, 0) + text(compression)
    return record(Opcode.CHUNK, head + struct.pack("<Q", len(packed)) + packed)


def bomb(path: Path, chunks: list[bytes]) -> Path:
    header = record(Opcode.HEADER, text("") + text(""))
    path.write_bytes(MCAP0_MAGIC + header + b"".join(chunks))
    return path


def zeros(compression: str, size: int) -> bytes:
    """So many zeros, packed."""
    if compression == "lz4":
        return lz4.frame.compress(bytes(size), store_size=False)
    squeeze = zstandard.ZstdCompressor().compressobj(size=size)
    block = bytes(min(size, 1 << 20))
    parts = [squeeze.compress(block) for _ in range(size // len(block))]
    return b"".join([*parts, squeeze.flush()])


@pytest.mark.parametrize("claim", ["true", "small"])
def test_a_chunk_that_unpacks_to_a_gigabyte_is_refused_before_it_is_unpacked(
    run: Run, tmp_path: Path, claim: str
) -> None:
    packed = zeros("zstd", SIZE)
    assert len(packed) < 100_000
    path = bomb(tmp_path / "bomb.mcap", [chunk(packed, SIZE if claim == "true" else 9, "zstd")])
    began = time.monotonic()
    line = one_line(run("info", path), 2, str(path), "MAX_EXPANSION")
    assert time.monotonic() - began < SOON_S
    assert len(line) < 300


def test_many_chunks_count_together(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gateway.recording.blocks.ALWAYS_UNPACKED", 1 << 18)
    packed = zeros("zstd", 1 << 17)
    path = bomb(tmp_path / "bomb.mcap", [chunk(packed, 1 << 17, "zstd")] * 40)
    one_line(run("info", path), 2, str(path), "MAX_EXPANSION")


def test_lz4_gives_no_more_than_it_says(tmp_path: Path) -> None:
    packed = zeros("lz4", 8 << 20)
    path = bomb(tmp_path / "bomb.mcap", [chunk(packed, 1000, "lz4")])
    assert list(Recording.open(path).blocks()) == []  # damaged: an unfinished file ends there


def test_a_long_recording_of_nothing_new_is_no_bomb(tmp_path: Path) -> None:
    with Recorder(tmp_path / "still.mcap") as recorder:
        for k in range(400):
            times = [10**9 * (1000 * k + i) for i in range(1000)]
            recorder.write_raw([b"\xfd" * 200] * 1000, times)
    assert Recording.open(tmp_path / "still.mcap").counts() == {"mavlink/raw": 400_000}


@pytest.fixture(scope="module")
def crowd() -> MavlinkLog:
    script = Script()
    for system in range(1, 255):
        for component in range(1, 21):
            script.send(0.001 * system, heartbeat(), system, component)
    return script.log()


def test_thousands_of_vehicles_in_one_log_are_refused(
    run: Run, tmp_path: Path, crowd: MavlinkLog
) -> None:
    path = tmp_path / "crowd.tlog"
    path.write_bytes(crowd.frames.data.tobytes())
    line = one_line(run("info", path), 2, "5,080 vehicles in it, more than 255 (MAX_BOATS)")
    assert len(line) < 300
    line = one_line(run("compare", path, "-v", "otter"), 2, "several boats", "and 234 more")
    assert len(line) < 3000
