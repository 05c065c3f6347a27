"""Names in files, logs and messages are not ours: no control character reaches a terminal."""

import io
import json
import os
import subprocess
import unicodedata
from pathlib import Path
from shlex import quote

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from rich.live import Live
from rich.table import Table

from gateway.errors import printable, shell_word
from gateway.long_running import LogFormat, LogLine, print_line
from gateway.terminal import ResultConsole, SafeConsole
from gateway.vessel_file import dump_vessel
from tests.gateway.command_line import SHADOW, Run
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.sim.vessels import WAMV

EVIL = "\x1b]0;mine\x07\x1b[2J\x9b31m\r\u202ex\udcff"


def harmless(text: str) -> bool:
    return all(c in "\n\t" or unicodedata.category(c) not in ("Cc", "Cf", "Cs") for c in text)


def test_what_a_terminal_would_obey_is_shown_instead() -> None:
    assert not harmless(EVIL)
    assert harmless(printable(EVIL))
    assert printable(EVIL).startswith("\\x1b]0;mine\\x07\\x1b[2J\\x9b31m\\x0d\\x202ex\\xff")
    assert printable("Überfahrt nach 075°\n\tü → ν̇") == "Überfahrt nach 075°\n\tü → ν̇"


def test_tables_lines_and_bullets_are_clean_and_styles_remain() -> None:
    out = io.StringIO()
    console = ResultConsole(file=out, force_terminal=True, color_system="truecolor", width=200)
    table = Table(title=EVIL)
    table.add_column(EVIL)
    table.add_row(EVIL)
    console.print(table)
    console.notices([EVIL])
    console.bullets([EVIL])
    console.path(EVIL, EVIL)
    text = out.getvalue()
    assert "\x1b[1m" in text  # bold of our own
    for sent in ("\x1b]", "\x1b[2J", "\x07", "\x9b", "\r", "\u202e"):
        assert sent not in text
    assert "\\x1b]0;mine" in text


def test_a_live_view_still_moves_the_cursor() -> None:
    out = io.StringIO()
    console = SafeConsole(file=out, force_terminal=True, width=80)
    with Live(EVIL, console=console, auto_refresh=False) as live:
        live.update("two\nlines", refresh=True)
        live.update("three", refresh=True)
    assert "\x1b[1A" in out.getvalue()
    assert "\x1b]0" not in out.getvalue()


def test_what_a_boat_says_begins_no_line_of_its_own(
    run: Run, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    forged = "all well\n  99.9  shadow: the model is right"
    banner = dialect.MAVLink_statustext_message(6, b"ArduRover V4.6.3\nforged banner")
    said = dialect.MAVLink_statustext_message(4, forged.encode()[:50])
    log = tlog(tmp_path / "a.tlog", [(0.0, banner), (1.0, said), *parameters(), *voyage(10.0)])
    shown = run("info", log, "--events").out
    assert "all well\\x0a  99.9  shadow: the model is right" in shown
    assert not [line for line in shown.splitlines() if line.strip().startswith(("99.9", "forged"))]
    print_line(LogLine(f"wam-v: {forged}", "warning", "text", "wam-v"))
    assert capfd.readouterr().err == f"wam-v: {forged}\n".replace("\n", "\\x0a", 1)
    print_line(forged, LogFormat.JSON)
    assert capfd.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("words", [["info", "{log}"], ["info", "{absent}"], ["compare", "{log}",
    "-v", "{boat}"], ["replay", "{log}", "-v", "{boat}", "--no-record", "--no-publish"],
    ["init", "{log}", "--out", "{new}"]])  # fmt: skip
def test_no_command_sends_them(run: Run, tmp_path: Path, words: list[str]) -> None:
    name = "\x1b]0;mine\x07\x9b31m"
    banner = dialect.MAVLink_statustext_message(6, f"ArduRover {name}".encode()[:50])
    log = tlog(tmp_path / f"{name}.tlog", [(0.0, banner), *parameters(), *voyage(40.0)])
    boat = tmp_path / "boat.toml"
    boat.write_text(dump_vessel(WAMV).replace("WAM-V", "\\u001b]0;mine\\u0007"), encoding="utf-8")
    places = {"log": log, "boat": boat, "absent": tmp_path / f"{name}.BIN",
              "new": tmp_path / f"{name}.toml"}  # fmt: skip
    done = run(*(word.format(**places) for word in words))
    assert harmless(done.out)
    assert harmless(done.err)
    assert "\\x1b" in done.out + done.err


def command_of(*words: str | Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    """The program in a process of its own: how it writes depends on its environment."""
    own = {key: value for key, value in os.environ.items() if not key.startswith("LC_")}
    return subprocess.run(
        [*SHADOW, *words], capture_output=True, env=own | environment, check=False
    )


@pytest.mark.parametrize("words", [["plan", "--list"], ["vessel", "show", "otter"], ["effects"]])
def test_an_output_that_knows_no_letters_of_ours_is_no_fault(words: list[str]) -> None:
    done = command_of(*words, PYTHONIOENCODING="ascii", LC_ALL="C", PYTHONUTF8="0")
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.isascii()


@pytest.fixture
def nameless(tmp_path: Path) -> tuple[Path, Path]:
    """A log and a vessel file whose names are no UTF-8."""
    log, boat = (Path(os.fsdecode(bytes(tmp_path / b) + e)) for b, e in NAMES)
    boat.write_text(dump_vessel(WAMV), encoding="utf-8")
    return tlog(log, [*parameters(), *voyage(30.0)]), boat


NAMES = (("a", b"\xff.tlog"), ("b", b"\xfe.toml"))


def test_a_name_that_is_no_text_is_read_and_told(
    run: Run, tmp_path: Path, nameless: tuple[Path, Path]
) -> None:
    log, boat = nameless
    out, new = tmp_path / "out", tmp_path / "new.toml"
    for words in (
        ["info", log],
        ["init", log, "--out", tmp_path / "first.toml"],
        ["replay", log, "-v", boat, "--out", out, "--no-publish"],
        ["compare", log, "-v", boat, "-v", "otter", "--pictures", tmp_path / "drawn"],
        ["identify", log, "-v", boat, "--method", "regression", "--out", new],
        ["export", log, "--to", "csv", "--out", tmp_path / "a.csv"],
    ):
        done = run(*words, "--json")
        assert (done.status, done.err) == (0, ""), words
        json.loads(done.out)
    assert "a\\xff" in json.dumps(json.loads(run("info", log, "--json").out)).replace("\\\\", "\\")
    assert "a\\\\xff" in new.read_text(encoding="utf-8")  # a backslash, as TOML escapes it
    assert run("info", out / os.fsdecode(b"a\xff-shadow.mcap")).status == 0


def test_the_next_command_reads_a_name_that_is_no_text(nameless: tuple[Path, Path]) -> None:
    log, _ = nameless
    shown = shell_word(str(log))
    heard = subprocess.run(["bash", "-c", f"printf %s {shown}"], capture_output=True, check=True)
    assert heard.stdout == os.fsencode(log)
    assert shown.isascii()
    assert shell_word("it's.tlog") == quote("it's.tlog")
