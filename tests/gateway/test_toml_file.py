"""TOML that asks for much: keys of many parts, found before they are parsed."""

import time
from pathlib import Path

import pytest

from gateway.config import load_settings
from gateway.errors import BadInput
from gateway.fleet import read_fleet
from gateway.hil.day_file import load_day
from gateway.ingest.csv.log import read_mapping
from gateway.plants.fmu import load_fmu
from gateway.toml_file import MAX_BYTES, MAX_KEY_PARTS, MAX_NESTING, read_toml
from gateway.vessel_file import load_vessel

SOON_S = 5.0  # a million bytes in words take half a second
BOMB = "a" + ".a" * 50_000
DEEP = MAX_KEY_PARTS
READERS = {
    "vessel": load_vessel, "settings": load_settings, "fleet": read_fleet, "day": load_day,
    "mapping": read_mapping, "fmu": lambda file: load_fmu(str(file)),
}  # fmt: skip


def written(folder: Path, text: str) -> Path:
    file = folder / "a.toml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("text", [f"{BOMB} = 1", f"[{BOMB}]", f"[[{BOMB}]]", f"x = {{{BOMB} = 1}}"])
@pytest.mark.parametrize("reader", READERS)
def test_a_key_of_many_parts_is_refused_at_once(tmp_path: Path, reader: str, text: str) -> None:
    began = time.monotonic()
    with pytest.raises(BadInput, match=rf"^\S*a\.toml: not .*: a key has more than {DEEP} parts"):
        READERS[reader](written(tmp_path, text))
    assert time.monotonic() - began < SOON_S


@pytest.mark.parametrize("part", ["a", '"a"', "'a'", r'"a\"."', '"a.b"', "ä-1"])
@pytest.mark.parametrize("dot", [".", " . ", "\t."])
def test_parts_are_counted_however_they_are_written(tmp_path: Path, part: str, dot: str) -> None:
    key = dot.join([part] * (DEEP + 1))
    with pytest.raises(BadInput, match="a key has more than"):
        read_toml(written(tmp_path, f"s = '''x'''\n[{key}]"), "it")


@pytest.mark.parametrize(
    "text",
    [
        "a" + ".a" * (DEEP - 1) + " = 1",
        f"# {BOMB}",
        f"a = '{BOMB}'",
        f'a = "\\"{BOMB}"',
        f'a = """\n{BOMB}"""',
        f"a = '''\n{BOMB}''\n'''",
        "a = [1.5, 2.5, " + "1.5, " * 100 + "]",
    ],
)
def test_what_only_looks_like_a_long_key_is_read(tmp_path: Path, text: str) -> None:
    assert "a" in read_toml(written(tmp_path, f"{text}\n[b]"), "it") or text[0] == "#"


@pytest.mark.parametrize(
    "piece", ["a", '"', "'", '\\"', '"""\\', "'''a", "a ", '"."', "a.", " x", "["]
)
def test_looking_takes_no_time_whatever_there_is(tmp_path: Path, piece: str) -> None:
    most = (MAX_BYTES - 10) // len(piece)
    began = time.monotonic()
    with pytest.raises(BadInput):
        read_toml(written(tmp_path, f"[x]\n{piece * most}"), "it")
    assert time.monotonic() - began < SOON_S


def test_tables_nest_as_deep_as_that(tmp_path: Path) -> None:
    def nested(count: int) -> str:
        return f"a = {'[' * (count - 1)}{']' * (count - 1)}"

    assert read_toml(written(tmp_path, nested(MAX_NESTING)), "it")
    with pytest.raises(BadInput, match="nest too deeply"):
        read_toml(written(tmp_path, nested(MAX_NESTING + 1)), "it")
