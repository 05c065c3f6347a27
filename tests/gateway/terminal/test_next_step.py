"""`shadow info` suggests only commands that work on the log, as a shell takes them."""

import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.writer import Writer

from gateway.commands.recordings import info
from gateway.errors import shell_path
from gateway.ingest.log import Boat
from gateway.ingest.open import open_log
from gateway.ingest.survey import Survey, survey
from gateway.offline.trials import why_unusable
from gateway.offline.vessel import init_vessel
from gateway.terminal.next_step import after_info, after_init, log_words
from gateway.vessel_file import load_vessel
from tests.conftest import ROOT
from tests.gateway.command_line import Run, one_line
from tests.gateway.ingest.scripted import heartbeat
from tests.gateway.ingest.ulog_writer import as_ulog
from tests.gateway.offline.test_replay import TABLE_COLUMNS
from tests.gateway.pipelines.aboard import Deck, datagrams, played
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.sim.vessels import WAMV

PIECE = ROOT / "recordings" / "otter_piece.tlog"
COMMANDED = TABLE_COLUMNS + 'channel_1 = { column = "left", unit = "us" }\n'


def table(folder: Path, mapping: str) -> Survey:
    """A table in a folder whose name has a space."""
    (folder / "my lake").mkdir()
    path = folder / "my lake" / "run 1.csv"
    path.write_text("t,yaw,u,v,left\n" + "".join(f"{k / 10},0,1,0,1600\n" for k in range(100)))
    file = folder / "columns of mine.toml"
    file.write_text(mapping)
    return survey(open_log(path, file))


def next_step(found: Survey, mapping: Path | None = None) -> str:
    """What `info` suggests; the log's own time is looked at."""
    unusable = why_unusable(open_log(found.path, mapping), found.boats[0].boat.system)
    return after_info(found, unusable, mapping)


@pytest.fixture(autouse=True)
def _nothing_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No vessel file is there before one is written."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")


def test_init_is_suggested_where_parameters_name_the_motors_and_it_works(tmp_path: Path) -> None:
    log = ROOT / "recordings" / "voyage_1.tlog"
    words = shlex.split(next_step(survey(open_log(log))))
    assert words == ["shadow", "init", str(log), "--out", "boat.toml"]
    assert init_vessel(open_log(log), tmp_path / "boat.toml", None, {}).thrusters


def test_a_table_is_compared_with_its_mapping_and_its_path_is_quoted(tmp_path: Path) -> None:
    found, mapping = table(tmp_path, COMMANDED), tmp_path / "columns of mine.toml"
    text = next_step(found, mapping)
    assert "shadow init" not in text
    prose, command = text.split("\n")
    assert "shadow" not in prose
    words = shlex.split(command)
    assert words == ["shadow", "compare", found.path, "--mapping", str(mapping),
                     "--vessel", "boat.toml"]  # fmt: skip


def test_init_takes_the_mapping_that_a_table_asks_for(run: Run, tmp_path: Path) -> None:
    path, out = table(tmp_path, COMMANDED).path, tmp_path / "boat.toml"
    one_line(run("init", path, "--out", out), 2, "needs a mapping file", "or give --mapping FILE")
    words = ["init", path, "--mapping", tmp_path / "columns of mine.toml", "--out", out]
    one_line(run(*words), 2, "a table holds no parameters", "configs/vessels")
    assert not out.exists()


def test_what_is_missing_is_said_where_nothing_works(tmp_path: Path) -> None:
    found = table(tmp_path, TABLE_COLUMNS)
    text = next_step(found, tmp_path / "columns of mine.toml")
    assert text.startswith("nothing can be compared in it: no servo outputs in it")
    assert "shadow " not in text


def px4_boat(folder: Path, **settings: float) -> Path:
    """A ULog of a boat under way, with these parameters."""
    written, path = as_ulog(PIECE), folder / "px4.ulg"
    written.head = []
    for name, value in settings.items():
        written.parameter(name, value)
    path.write_bytes(written.bytes())
    return path


def test_motors_that_px4_names_are_told_and_not_denied(run: Run, tmp_path: Path) -> None:
    path = px4_boat(tmp_path, PWM_MAIN_FUNC1=101, PWM_MAIN_FUNC3=102, UAVCAN_SV_FUNC2=201)
    named = (
        "PX4 names motor 1 on output 1 of PWM_MAIN, motor 2 on output 3 of PWM_MAIN, servo 1 on "
        "output 2 of UAVCAN_SV, but not where on the boat they are"
    )
    text = next_step(survey(open_log(path)))
    assert f"with this boat's channels ({named})" in text
    one_line(run("init", path, "--out", tmp_path / "b.toml"), 2, named, "[[thrusters]] by hand")
    told = run("info", path).out
    assert "by PX4's parameters: motor 1 on output 1 of PWM_MAIN" in told.replace("\n", " ")


def test_where_no_parameter_names_a_motor_that_is_told(tmp_path: Path) -> None:
    path = px4_boat(tmp_path, MAV_TYPE=11, PWM_MAIN_FUNC1=0, PWM_MAIN_FUNC2=400)  # a camera
    assert "no parameter in the log names the motors" in next_step(survey(open_log(path)))


def disarmed(folder: Path) -> Path:
    """A log of a boat that is never armed, with its parameters."""
    still = [
        (t, heartbeat(armed=False) if message.get_type() == "HEARTBEAT" else message)
        for t, message in voyage(30.0)
    ]
    return tlog(folder / "bench.tlog", [*parameters(), *still])


def test_a_log_that_was_never_armed_is_not_compared_and_its_parameters_are_of_use(
    run: Run, tmp_path: Path
) -> None:
    log = disarmed(tmp_path)
    out = run("info", log).out
    assert "next: nothing can be compared in it: disarmed" in out
    assert "shadow compare" not in out
    init = out.split("vessel file:\n")[1].splitlines()[0]
    done = run(*shlex.split(init)[1:])
    assert done.status == 0
    assert "nothing can be in this one: disarmed" in done.out
    assert "shadow compare" not in done.out


def test_a_vessel_file_that_is_there_is_not_to_be_replaced(run: Run) -> None:
    log = ROOT / "recordings" / "voyage_1.tlog"
    Path("boat.toml").write_text("# mine")
    lines = next_step(survey(open_log(log))).splitlines()
    assert lines[0] == "if boat.toml is this boat's:"
    assert shlex.split(lines[1])[:2] == ["shadow", "compare"]
    assert lines[2] == "else:"
    assert lines[3] == f"  shadow init {log} --out boat_2.toml"
    assert run(*shlex.split(lines[3])[1:]).status == 0
    assert next_step(survey(open_log(log))).endswith("--out boat_3.toml")


def test_what_init_suggests_can_be_pasted(run: Run) -> None:
    log = ROOT / "recordings" / "voyage_1.tlog"
    out = run("init", log, "--anyway", "--out", "my boat.toml").out
    command = out.split("by hand, then:\n")[1].strip()
    expected = ["shadow", "compare", str(log), "--anyway", "--vessel", "my boat.toml"]
    assert shlex.split(command) == expected
    assert run(*expected[1:]).status == 0


def test_a_name_that_begins_with_a_dash_is_no_option(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "-dash.tlog").write_bytes((ROOT / "recordings/voyage_1.tlog").read_bytes())
    line = next_step(survey(open_log("-dash.tlog")))
    assert line == "shadow init ./-dash.tlog --out boat.toml"
    assert open_log(shlex.split(line)[2]).counts()
    assert shlex.split(after_init(Path("-b.toml"), line, "").splitlines()[1])[-1] == "./-b.toml"
    assert shell_path("my -dash.tlog") == "'my -dash.tlog'"
    assert shell_path(Path("-my dash.tlog")) == "'./-my dash.tlog'"


def test_options_that_a_log_needs_are_there(tmp_path: Path) -> None:
    found = table(tmp_path, COMMANDED)
    copter = replace(found.boats[0], boat=Boat(7, 1, "ArduPilot", "quadrotor"), seconds=99.0)
    text = after_info(replace(found, boats=(*found.boats, copter)))
    assert "--system 7 --anyway" in text
    assert "--system 9" in after_info(found, system=9)  # it was chosen
    assert log_words("a b.tlog", 3, True) == "'a b.tlog' --system 3 --anyway"


def test_a_recording_of_the_gateway_is_compared_with_the_vessel_that_it_holds(
    run: Run, tmp_path: Path
) -> None:
    """ "write boat.toml" was said of one that `shadow live` had made with a vessel file."""
    with Deck(out=tmp_path / "my lake") as deck:
        deck.hear(datagrams(played(40.0)))
    (path,) = (tmp_path / "my lake").glob("*.mcap")
    out = run("info", path).out
    assert "boat.toml" not in out
    command = out.split("or with a better one:\n")[1].splitlines()[0]
    words = shlex.split(command)
    assert words == ["shadow", "compare", str(path), "--vessel", str(path)]
    assert run(*words[1:]).status == 0
    assert load_vessel(path).dynamics == WAMV.dynamics


def test_a_recording_without_a_vessel_is_none(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "empty.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    done = run("compare", ROOT / "recordings" / "voyage_1.tlog", "--vessel", path)
    one_line(done, 2, "this recording holds no vessel file: give one (TOML)")


def test_info_shows_it(tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    found = table(tmp_path, COMMANDED)
    info(Path(found.path), mapping=tmp_path / "columns of mine.toml")
    assert shlex.quote(found.path) in capsys.readouterr().out
