"""`shadow info` suggests only commands that work on the log, as a shell takes them."""

import shlex
from dataclasses import replace
from pathlib import Path

from gateway.commands.recordings import info
from gateway.errors import shell_path
from gateway.ingest.log import Boat
from gateway.ingest.open import open_log
from gateway.ingest.survey import Survey, survey
from gateway.offline.vessel import init_vessel
from gateway.terminal.recordings import next_step
from tests.conftest import ROOT
from tests.gateway.command_line import Run, one_line
from tests.gateway.offline.test_replay import TABLE_COLUMNS

COMMANDED = TABLE_COLUMNS + 'channel_1 = { column = "left", unit = "us" }\n'


def table(folder: Path, mapping: str) -> Survey:
    """A table in a folder whose name has a space."""
    (folder / "my lake").mkdir()
    path = folder / "my lake" / "run 1.csv"
    path.write_text("t,yaw,u,v,left\n" + "".join(f"{k / 10},0,1,0,1600\n" for k in range(100)))
    file = folder / "columns of mine.toml"
    file.write_text(mapping)
    return survey(open_log(path, file))


def test_init_is_suggested_where_parameters_name_the_motors_and_it_works(tmp_path: Path) -> None:
    log = ROOT / "recordings" / "voyage_1.tlog"
    words = shlex.split(next_step(survey(open_log(log))))
    assert words == ["shadow", "init", str(log), "--out", "boat.toml"]
    assert init_vessel(log, tmp_path / "boat.toml", None, {}).thrusters


def test_a_table_is_compared_with_its_mapping_and_its_path_is_quoted(tmp_path: Path) -> None:
    found, mapping = table(tmp_path, COMMANDED), tmp_path / "columns of mine.toml"
    text = next_step(found, mapping)
    assert "shadow init" not in text
    words = shlex.split(text[text.index("shadow compare") :])
    assert words == ["shadow", "compare", found.path, "--mapping", str(mapping),
                     "--vessel", "boat.toml"]  # fmt: skip


def test_init_takes_the_mapping_that_a_table_asks_for(run: Run, tmp_path: Path) -> None:
    path, out = table(tmp_path, COMMANDED).path, tmp_path / "boat.toml"
    one_line(run("init", path, "--out", out), 2, "needs a mapping file", "or give --mapping FILE")
    words = ["init", path, "--mapping", tmp_path / "columns of mine.toml", "--out", out]
    one_line(run(*words), 2, "a table holds no parameters", "configs/vessels")
    assert not out.exists()


def test_what_is_missing_is_said_where_nothing_works(tmp_path: Path) -> None:
    assert next_step(table(tmp_path, TABLE_COLUMNS)).startswith("nothing: no commands in it")


def test_a_name_that_begins_with_a_dash_is_no_option(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-dash.tlog").write_bytes((ROOT / "recordings/voyage_1.tlog").read_bytes())
    line = next_step(survey(open_log("-dash.tlog")))
    assert line == "shadow init ./-dash.tlog --out boat.toml"
    assert open_log(shlex.split(line)[2]).counts()
    assert shell_path("my -dash.tlog") == "'my -dash.tlog'"
    assert shell_path(Path("-my dash.tlog")) == "'./-my dash.tlog'"


def test_options_that_a_log_needs_are_there(tmp_path: Path) -> None:
    found = table(tmp_path, COMMANDED)
    copter = replace(found.boats[0], boat=Boat(7, 1, "ArduPilot", "quadrotor"), seconds=99.0)
    text = next_step(replace(found, boats=(*found.boats, copter)))
    assert "--system 7 --anyway" in text


def test_info_shows_it(tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    found = table(tmp_path, COMMANDED)
    info(Path(found.path), mapping=tmp_path / "columns of mine.toml")
    assert shlex.quote(found.path) in capsys.readouterr().out
