"""The table of log formats: one line each, asked in order, open to plug-ins."""

from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.ingest import LogFormat
from gateway.ingest import open as opening
from tests.gateway.ingest.scripted import Script, attitude, heartbeat

FOLDER = Path(opening.__file__).parent
MADE = LogFormat(
    "a made-up log",
    (".made",),
    lambda head, path: head.startswith(b"MADE"),
    lambda path, raw, mapping: Script([], bytearray(raw[4:])).log(),
)


def test_every_folder_with_a_format_is_in_the_table() -> None:
    declaring = {
        path.parent.name
        for path in FOLDER.glob("*/__init__.py")
        if "FORMAT = LogFormat(" in path.read_text(encoding="utf-8")
    }
    assert declaring == {"mavlink", "dataflash", "ulog", "csv", "mcap", "parquet"}
    assert len(opening.FORMATS) == len(declaring)
    assert opening.suffixes() >= {".tlog", ".bin", ".ulg", ".csv", ".mcap", ".parquet"}


def test_formats_are_told_with_the_most_usual_first() -> None:
    assert opening.names_of(opening.FORMATS) == (
        "a .tlog, an MCAP recording, a DataFlash .BIN, a PX4 .ulg, a .parquet table or a .csv table"
    )


def test_a_text_is_told_what_a_recording_is(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("we sailed all day\n")
    with pytest.raises(BadInput, match=r"is a text file: a recording is a \.tlog, an MCAP rec"):
        opening.open_log(path)


def test_a_plug_in_brings_a_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = EntryPoint("made", f"{__name__}:MADE", "shadow.log_formats")
    monkeypatch.setattr(EntryPoint, "load", lambda self: MADE)
    monkeypatch.setattr(opening, "entry_points", lambda group: [found])
    opening.known_formats.cache_clear()
    try:
        assert opening.known_formats()[-2:] == (MADE, opening.FORMATS[-1])
        script = Script()
        script.send(0.0, heartbeat())
        script.send(0.1, attitude(1.0))
        path = tmp_path / "voyage.made"
        path.write_bytes(b"MADE" + script.raw)
        assert opening.open_log(path).counts() == {"ATTITUDE": 1, "HEARTBEAT": 1}
    finally:
        opening.known_formats.cache_clear()


def test_a_format_is_declared_without_loading_what_reads_it() -> None:
    """The table is read by every command's help."""
    import subprocess
    import sys

    code = (
        "import sys, gateway.ingest.open; "
        "sys.exit(bool({'pyulog', 'mcap', 'pymavlink', 'numba'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False)
    assert done.returncode == 0
