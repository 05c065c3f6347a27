"""What cannot be used is one line and an exit status, and leaves nothing behind."""

import resource
import signal
import subprocess
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gateway.command_line import READERS, SHADOW, Done, Run, command, one_line
from tests.gateway.ingest.scripted import heartbeat
from tests.gateway.pipelines.sailing import parameters, tlog, voyage


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


@pytest.mark.parametrize(
    "name", ["info", "replay", pytest.param("compare", marks=pytest.mark.slow)]
)
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


def test_a_program_without_a_place_to_play_it_is_told(run: Run, boat: Path) -> None:
    done = run("simulate", "circles", "-v", boat)
    assert done.status == 2
    assert "circles is what a played boat does: say where, --live ENDPOINT or --log" in done.err


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
    "--horizon 1e9": ("compare", "--horizon: horizon 1e+09 s is too long: at most 3600 s"),
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


NEEDS_A_BOAT = {
    "init": ["--out", "new.toml"], "replay": ["-v", "boat.toml", "--no-record"],
    "compare": ["-v", "boat.toml"], "identify": ["-v", "boat.toml"],
    "diagnose": ["-v", "boat.toml"], "report": ["-v", "boat.toml"], "plan": ["-v", "boat.toml"],
}  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow if n == "report" else ()) for n in NEEDS_A_BOAT],
)
def test_a_copters_log_is_said_to_be_one(
    run: Run, tmp_path: Path, boat: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    copter = heartbeat(type_=dialect.MAV_TYPE_QUADROTOR)
    tlog(Path("copter.tlog"), [(0.0, copter), *parameters(), *voyage(10.0), (11.0, copter)])
    words = [name, "copter.tlog", *NEEDS_A_BOAT[name]]
    one_line(run(*words), 2, "says that it is a quadrotor: no model of a boat", "--anyway")
    assert "quadrotor" not in run(*words, "--anyway").err


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
    one_line(done, 2, str(out), "nothing can be written there")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "boat.toml", "file", "sticks.csv", "voyage.tlog",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "name", ["init", *(pytest.param(n, marks=pytest.mark.slow) for n in ("replay", "compare"))]
)
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


@pytest.mark.alone
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


def test_a_line_break_in_a_name_does_not_break_the_line(run: Run, tmp_path: Path) -> None:
    one_line(run("info", tmp_path / "two\nlines.tlog"), 2, "there is no such file")


@pytest.mark.parametrize("name", ["compare", "identify", "diagnose", "report"])
@pytest.mark.parametrize("under", ["its name", "a link", "a copy"])
def test_a_recording_given_twice_is_one_line(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str, under: str
) -> None:
    again = {"its name": log, "a link": tmp_path / "link.tlog", "a copy": tmp_path / "b.tlog"}[
        under
    ]
    if under == "a link":
        again.symlink_to(log)
    elif under == "a copy":
        again.write_bytes(log.read_bytes())
    one_line(run(name, log, again, "-v", boat), 2, f"{again}: is the same recording as {log}")


@pytest.mark.parametrize(
    "words", [["identify", "--by-recording"], ["report"], ["identify", "--validate"]]
)
def test_no_way_of_reading_several_takes_one_twice(
    run: Run, boat: Path, log: Path, words: list[str]
) -> None:
    name, *option = words
    vessel = [] if name == "report" else ["-v", boat]
    one_line(run(name, log, *option, log, *vessel), 2, "is the same recording as")
