"""The commands: one line and an exit status for what is wrong, JSON alone where it is asked for."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import typer

from gateway import cli
from gateway.config import Settings, as_tables, load_settings
from gateway.ingest.csv.mapping_file import QUANTITIES
from gateway.recording.reader import Recording
from gateway.vessel_file import dump_vessel, load_vessel
from tests.conftest import ROOT
from tests.gateway.pipelines.sailing import parameters, tlog, voyage
from tests.gateway.test_effect_files import FILE
from tests.sim.vessels import IACQUABOT, WAMV

SHADOW = [sys.executable, "-c", "from gateway.cli import main; main()"]


class Done(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str


Run = Callable[..., Done]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """`shadow` with some words behind it, by its entry point."""

    def shadow(*words: str | Path) -> Done:
        monkeypatch.setattr(sys, "argv", ["shadow", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        status = ended.value.code
        return Done(status if isinstance(status, int) else 0, *capfd.readouterr())

    return shadow


def strictly(text: str) -> Any:
    """JSON as other languages read it: no NaN, no Infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def one_line(done: Done, status: int, *expected: str) -> str:
    """One line on standard error, nothing on standard output, and that status."""
    assert done.out == ""
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith("error: ")
    for part in expected:
        assert part in done.err
    assert done.status == status
    return done.err


@pytest.fixture
def boat(tmp_path: Path) -> Path:
    path = tmp_path / "boat.toml"
    path.write_text(dump_vessel(WAMV), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A log of forty seconds with the boat's parameters."""
    path = tmp_path_factory.mktemp("sailed") / "a.tlog"
    return tlog(path, [*parameters(), *voyage(40.0)]).read_bytes()


@pytest.fixture
def log(tmp_path: Path, sailed: bytes) -> Path:
    path = tmp_path / "voyage.tlog"
    path.write_bytes(sailed)
    return path


def command(name: str, source: Path, boat: Path, out: Path) -> list[str | Path]:
    """A command that reads a log, with all that it needs."""
    return {
        "info": ["info", source],
        "init": ["init", source, "--out", out],
        "replay": ["replay", source, "-v", boat, "--out", out, "--no-publish"],
        "compare": ["compare", source, "-v", boat, "--pictures", out],
    }[name]


READERS = ("info", "init", "replay", "compare")


def write_nothing(path: Path) -> None:
    path.touch()


def write_folder(path: Path) -> None:
    path.mkdir()


def write_text(path: Path) -> None:
    path.write_text("Dear diary, today the sea was calm.\n" * 200)


def write_noise(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 40)


def write_stub(path: Path) -> None:
    path.write_bytes(bytes.fromhex("0005f5e100000000fd1c"))  # ends within the first frame


def write_half_recording(path: Path) -> None:
    path.write_bytes(b"\x89MCAP0\r\n\x01\x05")


def write_half_dataflash(path: Path) -> None:
    path.write_bytes(b"\xa3\x95\x80\x80")


BAD_LOGS = {
    "empty": (write_nothing, "is empty"),
    "folder": (write_folder, "is a directory"),
    "text": (write_text, "text file"),
    "noise": (write_noise, "MAVLink frame"),
    "stub": (write_stub, "MAVLink frame"),
    "half MCAP": (write_half_recording, "no MAVLink frames"),
    "half BIN": (write_half_dataflash, ""),
    "absent": (lambda path: None, "no such file"),
}


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("bad", BAD_LOGS)
def test_a_log_that_is_none_is_one_line_and_leaves_nothing(
    run: Run, tmp_path: Path, boat: Path, bad: str, name: str
) -> None:
    write, expected = BAD_LOGS[bad]
    source, out = tmp_path / "bad.tlog", tmp_path / "out"
    write(source)
    one_line(run(*command(name, source, boat, out)), 2, str(source), expected)
    assert not out.exists()


@pytest.mark.parametrize("name", READERS)
def test_a_system_that_is_not_there_is_one_line(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str
) -> None:
    words = command(name, log, boat, tmp_path / "out")
    one_line(run(*words, "--system", "7"), 2, "no boat with system id 7; present: system 1")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["info", "replay", "compare"])
def test_a_log_that_is_cut_off_is_read_to_where_it_ends(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str
) -> None:
    log.write_bytes(log.read_bytes()[:-7])
    done = run(*command(name, log, boat, tmp_path / "out"))
    assert (done.status, done.err) == (0, "")
    if name != "compare":
        assert "cut" in done.out


VESSEL_TYPO = "error: {}: unknown key dynamics.X_uuu; missing key dynamics.X_uu\n"


@pytest.mark.parametrize("name", ["replay", "compare", "simulate", "plant", "follow"])
def test_a_typo_in_a_vessel_file_is_one_line(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str
) -> None:
    wrong, out = tmp_path / "typo.toml", tmp_path / "out"
    wrong.write_text(boat.read_text().replace("X_uu =", "X_uuu ="))
    sticks = tmp_path / "sticks.csv"
    sticks.write_text("time,left\n0,0\n1,0\n")
    done = run(
        *{
            "replay": ["replay", log, "-v", wrong, "--out", out],
            "compare": ["compare", log, "-v", boat, "-v", wrong, "--pictures", out],
            "simulate": ["simulate", sticks, "-v", wrong, "--out", out],
            "plant": ["replay", log, "-v", boat, "--plant", wrong, "--out", out],
            "follow": ["simulate", sticks, "-v", boat, "--follow", wrong, "--out", out],
        }[name]
    )
    assert (done.status, done.err) == (2, VESSEL_TYPO.format(wrong))
    assert not out.exists()


OPTIONS = {
    "--speed 3": ("replay", "--speed 3: expected 1 or max"),
    "--reference both": ("replay", "--reference both: expected measured, model, auto"),
    "--name a/b": ("replay", "vessel name 'a/b': must not"),
    "--config absent.toml": ("replay", "absent.toml: cannot read the configuration"),
    "--effects absent.py": ("replay", "absent.py: cannot read the effect file"),
    "--system one": ("replay", "'--system'"),
    "--plant absent.toml": ("replay", "absent.toml: cannot read the vessel file"),
    "--wrong": ("replay", "No such option: --wrong"),
    "--horizon 0": ("compare", "--horizon: horizon must be longer than 0 s"),
    "--horizon nan": ("compare", "--horizon: "),
    "--horizon long": ("compare", "'--horizon'"),
    "--mass -3": ("init", "--mass -3.0: expected a positive number"),
    "--thrust much": ("init", "'--thrust'"),
}


@pytest.mark.parametrize("option", OPTIONS)
def test_an_option_that_cannot_be_used_is_one_line(
    run: Run, tmp_path: Path, boat: Path, log: Path, option: str
) -> None:
    name, expected = OPTIONS[option]
    words = command(name, log, boat, tmp_path / "out")
    words = [word for word in words if word != "--no-publish"]
    heard = ["--publish"] if name == "replay" else []
    one_line(run(*words, *heard, *option.split()), 2, expected)
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize("words", [["replay"], ["compare", "a.tlog"], ["nothing"], ["info"]])
def test_what_is_missing_on_the_command_line_is_one_line(run: Run, words: list[str]) -> None:
    one_line(run(*words), 2, "--help")


@pytest.mark.parametrize("name", ["replay", "simulate", "init", "compare", "demo"])
@pytest.mark.parametrize("place", ["file", "proc"])
def test_where_nothing_can_be_written_is_one_line(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str, place: str
) -> None:
    (tmp_path / "file").touch()
    out = {"file": tmp_path / "file" / "out", "proc": Path("/proc/shadow-out")}[place]
    sticks = tmp_path / "sticks.csv"
    sticks.write_text("time,left\n0,0\n1,0\n")
    extra: dict[str, list[str | Path]] = {
        "simulate": ["simulate", sticks, "-v", boat, "--out", out],
        "demo": ["demo", "--out", out],
    }
    words = extra[name] if name in extra else command(name, log, boat, out)
    done = run(*words)
    line = done.err if name == "demo" else one_line(done, 1, str(out))
    assert line.count("\n") == 1
    assert done.status in (1, 2)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "boat.toml", "file", "sticks.csv", "voyage.tlog",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["replay", "init", "compare"])
def test_a_disk_that_fills_up_is_one_line_and_leaves_nothing(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str
) -> None:
    assert run(*command(name, log, boat, tmp_path / "warm")).status == 0  # compiled by now
    out = tmp_path / "out"
    room = 100 if name == "init" else 4000

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    words = [*SHADOW, *map(str, command(name, log, boat, out))]
    done = subprocess.run(words, capture_output=True, text=True, preexec_fn=limit, check=False)
    one_line(Done(done.returncode, done.stdout, done.stderr), 1, "File too large")
    assert not list(tmp_path.glob("out*/*"))
    assert not list(tmp_path.glob("*.part"))
    assert not out.is_file()


def hears_interrupts() -> None:
    """Whatever runs in the background of a script inherits that they are ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_an_interrupted_replay_leaves_nothing(tmp_path: Path, boat: Path, log: Path) -> None:
    out = tmp_path / "out"
    words = [*SHADOW, *map(str, command("replay", log, boat, out)), "--speed", "1"]
    with subprocess.Popen(
        words, stderr=subprocess.PIPE, text=True, preexec_fn=hears_interrupts
    ) as process:
        end = time.monotonic() + 60.0
        while not list(out.glob("*.part")) and time.monotonic() < end:
            time.sleep(0.05)
        assert [p.name for p in out.iterdir()] == ["voyage-shadow.mcap.part"]
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert list(out.iterdir()) == []


def test_live_listens_where_the_configuration_says(run: Run, tmp_path: Path, boat: Path) -> None:
    one_line(run("live", "--vessel", boat, "--no-record"), 2, "nowhere to listen")
    one_line(run("live", "udpin:127.0.0.1:0"), 2, "no model of the boat: give --vessel FILE")
    one_line(run("live", "udpin:127.0.0.1:0", "--name", "x"), 2, "go with --vessel")
    config = tmp_path / "gateway.toml"
    config.write_text('[links]\nendpoints = ["pigeon:loft"]\n')
    done = run("live", "--vessel", boat, "--no-record", "--config", config)
    assert 'endpoint "pigeon:loft"' in done.err
    assert done.status == 2


def test_whoever_stops_reading_gets_no_complaint(log: Path) -> None:
    words = [*SHADOW, "info", str(log), "--json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        err = process.stderr.read()
    assert err == b""


# ---- what comes out


@pytest.mark.parametrize("name", ["info", "replay", "compare"])
def test_json_stands_alone_on_standard_output(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str
) -> None:
    done = run(*command(name, log, boat, tmp_path / "out"), "--json")
    assert (done.status, done.err) == (0, "")
    assert strictly(done.out)


def test_the_json_of_a_replay_tells_where_everything_is(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    again = tmp_path / "again" / log.name
    again.parent.mkdir()
    again.write_bytes(log.read_bytes())
    words = command("replay", log, boat, tmp_path / "out")
    done = run(*words, again, "--json")
    first, second = strictly(done.out)["replays"]
    assert first["seconds"] == pytest.approx(40.0, abs=0.2)
    assert set(first["following_rmse"]) == {"x", "y", "psi", "u", "v", "r"}
    files = [Path(path) for one in (first, second) for path in one["recordings"]]
    assert [file.name for file in files] == ["voyage-shadow.mcap", "voyage-2-shadow.mcap"]
    assert all(Recording.open(file).finished for file in files)


def test_the_json_of_a_comparison_has_its_documented_members(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    other = tmp_path / "other.toml"
    other.write_text(dump_vessel(IACQUABOT), encoding="utf-8")
    done = run("compare", log, "-v", boat, "-v", other, "--horizon", "5", "--json")
    trials = strictly(done.out)["trials"]
    assert [trial["vessel"] for trial in trials] == ["WAM-V", "IAcquaBot"]
    for trial in trials:
        assert trial["horizon_s"] == 5.0
        assert {"log", "seconds", "cut_short", "rmse", "mae", "r2", "fit_percent"} <= set(trial)
        assert {"nrmse", "noise_floor_nrmse", "free_run", "where"} <= set(trial)
    assert trials[0]["nrmse"] < trials[1]["nrmse"]


def test_people_get_words_and_the_place_of_the_files(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    out = tmp_path / "out"
    replayed = run(*command("replay", log, boat, out)).out
    assert f"recorded: {out / 'voyage-shadow.mcap'}" in replayed
    assert "missing force" in replayed
    compared = run("compare", log, "-v", boat, "--pictures", out / "pictures").out
    assert "floor" in compared
    assert len(list((out / "pictures").glob("*.png"))) > 2


def test_init_then_replay_then_compare_is_a_way_to_begin(
    run: Run, tmp_path: Path, log: Path
) -> None:
    made = tmp_path / "made.toml"
    done = run("init", log, "--out", made, "--length", "4.9", "--beam", "2.3", "--mass", "180")
    assert done.status == 0
    assert "written" in done.out
    assert load_vessel(made).hull.mass == 180.0
    one_line(run("init", log, "--out", made), 2, "there is such a file: give another name, or")
    assert run("replay", log, "-v", made, "--no-record", "--no-publish").status == 0
    assert run("compare", log, "-v", made).status == 0


def test_simulate_makes_a_recording(run: Run, tmp_path: Path, boat: Path) -> None:
    sticks = tmp_path / "sticks.csv"
    sticks.write_text("time,left,right\n0,0.5,0.4\n20,0,0\n")
    other = tmp_path / "other.toml"
    other.write_text(dump_vessel(IACQUABOT), encoding="utf-8")
    done = run("simulate", sticks, "-v", boat, "--follow", other, "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert "follower − vessel" in done.out
    assert Recording.open(tmp_path / "out" / "sticks-simulated.mcap").counts()["shadow"] == 1000


def test_effects_are_listed_and_explained(run: Run, tmp_path: Path) -> None:
    own = tmp_path / "line.py"
    own.write_text(FILE.replace("FACTOR", "1"))
    assert "steady_current" in run("effects").out
    explained = run("effects", "steady_current").out
    assert 'type = "steady_current"' in explained
    assert "direction" in explained
    assert "line_drag" in run("effects", "--effects", own).out
    one_line(run("effects", "ghost"), 2, "no effect named 'ghost': there are")
    own.write_text("def (:")
    one_line(run("effects", "--effects", own), 2, str(own), "SyntaxError")


def test_an_effect_of_ones_own_takes_part_in_every_command(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    own = tmp_path / "line.py"
    own.write_text(FILE.replace("FACTOR", "1"))
    boat.write_text(boat.read_text() + '\n[[effects]]\ntype = "line_drag"\nk = 20.0\n')
    words = command("replay", log, boat, tmp_path / "out")
    one_line(run(*words), 2, "effects[0].type = 'line_drag': expected one of")
    (done,) = strictly(run(*words, "--effects", own, "--json").out)["replays"]
    assert done["missing_force_rms"]["X"] > 10.0  # a drag that the voyage did not have
    assert run("compare", log, "-v", boat, "--effects", own).status == 0


def test_the_configuration_that_is_shown_is_one_that_can_be_read(run: Run, tmp_path: Path) -> None:
    given = tmp_path / "gateway.toml"
    given.write_text('[following]\nrate_hz = 20.0\n[recording]\ncompression = "lz4"\n')
    shown = tmp_path / "shown.toml"
    shown.write_text(run("config", "--config", given).out, encoding="utf-8")
    assert load_settings(shown) == load_settings(given) != Settings()
    assert strictly(run("config", "--config", given, "--json").out) == json.loads(
        json.dumps(as_tables(load_settings(given)))
    )
    assert tomllib.loads(run("config").out) == as_tables(Settings())


def test_a_flag_goes_over_the_file_and_the_file_over_the_default(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    given = tmp_path / "gateway.toml"
    given.write_text('[following]\nreference = "model"\n[zenoh]\npublish = false\n')
    out = tmp_path / "out"

    def used(*flags: str | Path) -> dict[str, Any]:
        assert run("replay", log, "-v", boat, "--out", out, *flags).status == 0
        (file,) = out.iterdir()
        found: dict[str, Any] = json.loads(Recording.open(file).attachments["config.json"].data)
        return found

    assert used("--no-publish")["following"]["reference"] == Settings().following.reference
    assert used("--config", given)["following"]["reference"] == "model"
    over = used("--config", given, "--reference", "auto")
    assert over["following"]["reference"] == "auto"
    assert over["zenoh"]["publish"] is False


def test_repair_says_what_it_found(run: Run, tmp_path: Path, boat: Path, log: Path) -> None:
    run(*command("replay", log, boat, tmp_path / "out"))
    file = tmp_path / "out" / "voyage-shadow.mcap"
    assert "was whole already" in run("repair", file).out
    file.write_bytes(file.read_bytes()[:-2000])
    os.utime(file, (1.0, 1.0))
    assert "made whole" in run("repair", file).out
    assert Recording.open(file).finished
    one_line(run("repair", tmp_path / "absent.mcap"), 2, "absent.mcap")


# ---- tables


def test_the_example_of_the_docs_is_read(run: Run, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "csv.md").read_text(encoding="utf-8")
    blocks = dict(re.findall(r"```(csv|toml)\n(.*?)```", page, re.DOTALL))
    for kind, text in blocks.items():
        (tmp_path / f"run.{kind}").write_text(text, encoding="utf-8")
    found = strictly(run("info", tmp_path / "run.csv", "--json").out)
    (boat,) = found["boats"]
    assert {"yaw", "yaw rate", "velocity", "position", "commands", "voltage"} <= set(
        boat["sources"]
    )


def test_the_docs_name_every_quantity_of_a_table_and_its_units() -> None:
    page = (ROOT / "docs" / "csv.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    for name, (_, _, units) in QUANTITIES.items():
        told = [row for row in rows if f"`{name}`" in row.split("|")[1]]
        if name.startswith("channel_"):
            told = [row for row in rows if "channel_1" in row]
        assert len(told) == 1, name
        assert all(f"`{unit}`" in told[0] for unit in units), name


def test_a_table_can_be_replayed(run: Run, tmp_path: Path, boat: Path) -> None:
    rows = [f"{t:.1f},{0.05 * t},{1.5},0,0.05,1600,1560" for t in np.arange(0.0, 30.0, 0.1)]
    (tmp_path / "run.csv").write_text("t,psi,u,v,r,a,b\n" + "\n".join(rows), encoding="utf-8")
    names = tmp_path / "names.toml"
    names.write_text(
        'time = { column = "t", unit = "s" }\n[columns]\n'
        'yaw = { column = "psi", unit = "rad" }\nsurge = { column = "u", unit = "m/s" }\n'
        'sway = { column = "v", unit = "m/s" }\nyaw_rate = { column = "r", unit = "rad/s" }\n'
        'channel_1 = { column = "a", unit = "us" }\nchannel_2 = { column = "b", unit = "us" }\n'
    )
    words = command("replay", tmp_path / "run.csv", boat, tmp_path / "out")
    one_line(run(*words), 2, "needs a mapping file")
    (done,) = strictly(run(*words, "--mapping", names, "--json").out)["replays"]
    assert done["seconds"] == pytest.approx(29.9, abs=0.2)
    assert done["following_rmse"]["u"] < 0.1


# ---- help


COMMANDS = [
    c.name or (c.callback.__name__ if c.callback else "") for c in cli.app.registered_commands
]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_says_what_it_does_and_every_option_what_it_is_for(
    run: Run, name: str
) -> None:
    done = run(name, "--help")
    assert (done.status, done.err) == (0, "")
    group = typer.main.get_group(cli.app)
    found = group.commands[name]
    assert found.help
    assert " ".join(found.help.split())[:30] in " ".join(done.out.split())
    assert all(getattr(parameter, "help", None) for parameter in found.params), [
        p.name for p in found.params if not getattr(p, "help", None)
    ]


def test_without_any_word_the_help_is_shown(run: Run) -> None:
    done = run()
    assert (done.status, done.err) == (0, "")
    assert all(name in done.out for name in COMMANDS)


def test_the_version_is_told(run: Run) -> None:
    assert run("--version").out.startswith("shadow-gateway ")


def test_a_line_break_in_a_name_does_not_break_the_line(run: Run, tmp_path: Path) -> None:
    one_line(run("info", tmp_path / "two\nlines.tlog"), 2, "there is no such file")
