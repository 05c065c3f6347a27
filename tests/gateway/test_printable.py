"""Names in files, logs and messages are not ours: no control character reaches a terminal."""

import io
import unicodedata
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from rich.live import Live
from rich.table import Table

from gateway.errors import printable
from gateway.long_running import LogFormat, LogLine, print_line
from gateway.terminal import ResultConsole, SafeConsole
from gateway.vessel_file import dump_vessel
from tests.gateway.command_line import Run
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.sim.vessels import WAMV

EVIL = "\x1b]0;mine\x07\x1b[2J\x9b31m\r\u202ex\udcff"


def harmless(text: str) -> bool:
    return all(c in "\n\t" or unicodedata.category(c) not in ("Cc", "Cf", "Cs") for c in text)


def test_what_a_terminal_would_obey_is_shown_instead() -> None:
    assert not harmless(EVIL)
    assert harmless(printable(EVIL))
    assert printable(EVIL).startswith("\\x1b]0;mine\\x07\\x1b[2J\\x9b31m\\x0d\\x202ex\\xdcff")
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
