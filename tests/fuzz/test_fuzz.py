"""The fuzzer finds what it is for; parsers stand some mutants; what was found stays mended."""

import math
import re
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from gateway.errors import BadInput, ShadowError
from gateway.hil.day_file import load_day
from gateway.ingest.open import open_log
from tests.conftest import ROOT
from tests.fuzz import __main__ as fuzzer
from tests.fuzz.__main__ import Found, fuzz
from tests.fuzz.mutations import KINDS, TEXT_KINDS, Change, changed
from tests.fuzz.targets import TARGETS, Target, is_fault
from tests.gateway.ingest.dataflash_writer import voyage_log
from tests.gateway.test_bombs import record, text

# of the slow round, for slow targets
BATCHES = {"tlog": 50, "BIN": 70, "datagrams": 15, "autopilots": 5}
OTHER_BATCHES = 200  # for the rest: ten to twenty seconds each
CORPUS = [b"abc=1.5 def", bytes(range(256))]


@pytest.fixture(autouse=True)
def _place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzzer, "OUT", tmp_path)


def reads(read) -> Target:
    return Target("made", lambda: CORPUS, read)


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_every_specimen_is_read(target: Target) -> None:
    for specimen in target.corpus():
        target.read(specimen)  # none is refused: a mutant of what is refused says little


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_every_parser_stands_some_mutants(target: Target) -> None:
    assert fuzz(target, 0.2, 1) > 0


@pytest.mark.alone
@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_every_parser_stands_a_short_round(target: Target) -> None:
    """Other mutants than above, the same ones on every machine; `make fuzz` goes on."""
    assert fuzz(target, math.inf, 1000, BATCHES.get(target.name, OTHER_BATCHES)) > 0


def test_an_exception_is_found_and_its_mutant_kept(tmp_path: Path) -> None:
    def read(data: bytes) -> None:
        if data not in CORPUS and len(data) < 150:
            raise KeyError("lost")

    with pytest.raises(Found, match="made: KeyError") as found:
        fuzz(reads(read), 20.0, 1)
    kept = Path(re.search(r"kept: (.*)", str(found.value))[1])
    assert kept.parent == tmp_path
    with pytest.raises(KeyError):
        read(kept.read_bytes())


def test_what_was_found_in_a_long_mutant_is_told() -> None:
    def read(data: bytes) -> None:
        if data not in specimens:
            raise KeyError("lost")

    specimens = [bytes(100_000)]  # longer than what hypothesis would show without a warning
    with pytest.raises(Found, match="made: KeyError"):
        fuzz(Target("made", lambda: specimens, read), 20.0, 1)


def test_as_many_batches_as_asked_for() -> None:
    target = reads(lambda data: None)
    assert fuzz(target, math.inf, 1, batches=2) == 2 * fuzzer.BATCH
    assert fuzz(target, math.inf, 1, batches=0) == 0


def test_what_the_command_line_tells_in_a_line_is_no_fault() -> None:
    def refuse(data: bytes) -> None:
        raise BadInput("no")

    assert fuzz(reads(refuse), 0.2, 1) > 0
    assert is_fault(ValueError("anything"))
    assert not is_fault(OSError("gone"))


def test_growth_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    hoard: list[bytearray] = []

    def read(data: bytes) -> None:
        if data not in CORPUS:
            hoard.append(bytearray(b"x" * 30_000_000))

    monkeypatch.setattr(fuzzer, "GROWTH_BYTES", 200_000_000)
    with pytest.raises(Found, match="memory grew by"):
        fuzz(reads(read), 20.0, 1)


HANGS = """
import time
from tests.fuzz import __main__ as fuzzer
from tests.fuzz.targets import Target

fuzzer.HANG_S = 1.0
fuzzer.OUT = __import__("pathlib").Path({out!r})
read = lambda data: time.sleep(60.0) if data != b"good" else None
fuzzer.TARGETS = (Target("made", lambda: [b"good"], read),)
fuzzer._try.__defaults__ = (1.0,)
fuzzer.fuzz(fuzzer.TARGETS[0], 30.0, 1)
"""


@pytest.mark.alone
def test_a_hang_ends_the_process_and_leaves_its_mutant(tmp_path: Path) -> None:
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", HANGS.format(out=str(tmp_path))], cwd=ROOT, capture_output=True,
        text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode != 0
    assert "Timeout" in done.stderr
    assert time.monotonic() - began < 50.0
    assert (tmp_path / "made-running").read_bytes() != b"good"


@pytest.mark.parametrize("kind", sorted({*KINDS, *TEXT_KINDS}))
def test_every_kind_of_change_changes(kind: str) -> None:
    places = [k << 28 for k in range(16)]
    found = {changed(CORPUS[0], [Change(kind, at, 9000, 20000 + at)], CORPUS) for at in places}
    assert found - {CORPUS[0]}


# ---- found by it


@pytest.mark.parametrize("content", ["x = " + "[" * 5000, "x = " + "9" * 5000])
def test_a_day_that_nests_without_end_or_counts_without_end(tmp_path: Path, content: str) -> None:
    (tmp_path / "day.toml").write_text(content)
    with pytest.raises(BadInput, match=r"nest too deeply|too many digits"):
        load_day(tmp_path / "day.toml")


@pytest.mark.parametrize("opcode", [Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL])
def test_names_in_an_mcap_that_are_no_text(tmp_path: Path, opcode: Opcode) -> None:
    name = b"\x04\0\0\0\xd1\xd1\xd1\xd1"
    content = {
        Opcode.CHUNK: bytes(28) + name + bytes(8),
        Opcode.SCHEMA: b"\x01\0" + name + bytes(8),
        Opcode.CHANNEL: b"\x01\0\0\0" + name + bytes(8),
    }[opcode]
    header = record(Opcode.HEADER, text("") + text(""))
    end = record(Opcode.FOOTER, bytes(20)) + MCAP0_MAGIC
    path = tmp_path / "a.mcap"
    path.write_bytes(MCAP0_MAGIC + header + record(opcode, content) + end)
    with pytest.raises(ShadowError, match="the file is damaged: use another copy of it"):
        open_log(path)


@pytest.mark.slow
@pytest.mark.parametrize("year", [2014, 2025])
def test_definitions_of_a_dataflash_log_that_were_damaged(year: int) -> None:
    """Each number of four bytes declared a text, and each column without its name."""
    target = next(target for target in TARGETS if target.name == "BIN")
    whole, count = voyage_log(year, 4.0), 0
    for found in re.finditer(rb"\xa3\x95\x80..(.{4})(.{16})(.{64})", whole, re.DOTALL):
        letters, columns = found[2].rstrip(b"\0"), found[3].rstrip(b"\0").split(b",")
        texts = [
            letters[:k] + b"n" + letters[k + 1 :] for k, c in enumerate(letters) if c in b"fiIL"
        ]
        lost = [
            b",".join([*columns[:k], b"Zz", *columns[k + 1 :]])[:64] for k in range(len(columns))
        ]
        for first, size, others in ((found.start(2), 16, texts), (found.start(3), 64, lost)):
            for other in others:
                with suppress(ShadowError):  # one line
                    target.read(whole[:first] + other.ljust(size, b"\0") + whole[first + size :])
                count += 1
    assert count > 60
