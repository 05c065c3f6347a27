"""`shadow fleet` at the command line, and everything else without its packages."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.fleet.run import FleetResult
from gateway.fleet.wear import FleetWear
from gateway.terminal.fleet import show_fleet
from tests.gateway.command_line import one_line

BLOCKED = """
import sys
for name in ("distributed", "dask", "pyarrow", "fsspec"):
    sys.modules[name] = None
import importlib.util
real = importlib.util.find_spec
importlib.util.find_spec = lambda n, *a: None if sys.modules.get(n, 0) is None else real(n, *a)
from gateway.cli import main
main()
"""


def without_the_extra(*words):
    command = [sys.executable, "-c", BLOCKED, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_the_program_runs_without_the_extra_and_says_what_is_missing(folder):
    assert without_the_extra("effects").returncode == 0
    assert without_the_extra("fleet", "--help").returncode == 0
    done = without_the_extra("fleet", folder / "logs", "--vessels", folder / "fleet.toml")
    assert (done.returncode, done.stdout) == (2, "")
    assert "pip install 'shadow-gateway[fleet]'" in done.stderr


def test_json_counts_what_came_of_it(run, folder, cluster):
    done = run("fleet", folder / "logs", "--vessels", folder / "fleet.toml", "--out",
               folder / "out", "--steps", "compare", "--scheduler", cluster.scheduler_address,
               "--json")  # fmt: skip
    assert done.status == 0
    told = json.loads(done.out)
    assert told["states"] == {"done": 2, "failed": 2}
    assert told["unused"] == ["otter-1"]
    assert {one["why"] for one in told["failed"]} >= {"no entry of the fleet file names it"}
    assert "4 of 4: " in done.err
    assert "about 0 s left" in done.err
    shown = run("fleet", folder / "logs", "--vessels", folder / "fleet.toml", "--out",
                folder / "out", "--steps", "compare", "--scheduler",
                cluster.scheduler_address)  # fmt: skip
    text = " ".join(shown.out.split())
    assert "4 recordings, 3 of them known already" in text
    assert "│ heron │ 2 of 3 │" in text
    assert "otter-1: no recording fits otter_* (fleet file)" in text
    assert "heron: no recording" not in text


def test_after_a_kill_the_same_command_goes_on(run, folder, cluster):
    words = ["fleet", folder / "logs", "--vessels", folder / "fleet.toml", "--out", folder / "out",
             "--steps", "compare", "--scheduler", cluster.scheduler_address, "--json"]  # fmt: skip
    assert run(*words).status == 0
    with (folder / "out" / "results.jsonl").open("a") as file:
        file.write('{"sha256": "cut off')
    assert json.loads(run(*words).out)["known"] == 3


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "give --vessels fleet.toml"),
        (["--vessels", "nowhere.toml"], "cannot read the fleet file"),
        (["--vessel", "otter", "--steps", "compare,sail"], "--steps sail: expected some of"),
        (["--vessel", "otter", "--prior", "m11"], "--prior m11: expected NAME=SHARE"),
        (["--vessel", "nowhere.toml"], "nowhere.toml: cannot read the vessel file"),
    ],
)
def test_a_mistake_is_one_line_before_any_work(run, folder, words, expected):
    one_line(run("fleet", folder / "logs", "--out", folder / "out", *words), 2, expected)
    assert not (folder / "out").exists()


def test_a_broken_vessel_file_is_found_before_any_work(run, folder):
    (folder / "boat.toml").write_text('name = "heron"\n', encoding="utf-8")
    words = ["--vessels", folder / "fleet.toml", "--out", folder / "out"]
    one_line(run("fleet", folder / "logs", *words), 2, "boat.toml: missing key")
    assert not (folder / "out").exists()


def test_where_every_recording_failed_the_exit_status_says_so(run, folder, cluster):
    words = ["fleet", folder / "logs" / "short.tlog", "--vessels", folder / "fleet.toml",
             "--out", folder / "out", "--steps", "compare", "--scheduler",
             cluster.scheduler_address]  # fmt: skip
    for _ in range(2):  # worked out, and known
        done = run(*words)
        assert done.status == 1
        assert done.err.endswith("error: every recording failed (1): the table says why\n")
        assert "1 recording, " in done.out
        assert "1 recordings" not in done.out


def test_a_run_over_another_list_says_what_the_table_has_no_more(run, folder, cluster):
    def fleet(*logs):
        return run("fleet", *logs, "--vessels", folder / "fleet.toml", "--out", folder / "out",
                   "--steps", "compare", "--scheduler", cluster.scheduler_address)  # fmt: skip

    heron = folder / "logs" / "heron"
    monday, tuesday = heron / "monday.tlog", heron / "tuesday.tlog"
    assert "not named now" not in fleet(monday).out
    assert "not named now" not in fleet(monday, tuesday).out  # the list has grown
    text = " ".join(fleet(tuesday).out.split())
    assert (
        "1 recording of the table before not named now, so not in it any more (monday.tlog)" in text
    )
    back = fleet(monday, tuesday).out
    assert "2 recordings, 2 of them known already" in " ".join(back.split())
    assert "not named now" not in back


def test_a_boat_of_which_no_recording_has_a_date_has_none(capsys):
    row = {"boat": "heron", "state": "done", "usable_s": 60.0, "nrmse": None}
    days = {"a.csv": None, "b.csv": None, "c.tlog": "2026-05-01T09:00:00+00:00"}
    rows = {name: row | {"recording": name, "started": day} for name, day in days.items()}
    show_fleet(FleetResult(Path("out"), rows), FleetWear((), {}, {}, {}))
    assert capsys.readouterr().out.count("2026-05-01") == 2  # from, to
    del rows["c.tlog"]
    show_fleet(FleetResult(Path("out"), rows), FleetWear((), {}, {}, {}))
    assert "–" in capsys.readouterr().out


def test_recordings_of_one_reason_are_one_line(capsys):
    why = "{}: the vehicle says that it is a submarine"
    rows = {
        name: {"recording": name, "boat": "heron", "state": "failed", "why": why.format(name)}
        for name in ("/logs/a.tlog", "/logs/b.tlog", "/logs/c.tlog", "/logs/d.tlog")
    }
    rows["/logs/e.BIN"] = rows["/logs/a.tlog"] | {"recording": "/logs/e.BIN", "why": "cut off"}
    show_fleet(FleetResult(Path("out"), rows), FleetWear((), {}, {}, {}))
    text = " ".join(capsys.readouterr().out.split())
    assert (
        "4 recordings failed: the vehicle says that it is a submarine (a.tlog, b.tlog, c.tlog, …)"
    ) in text
    assert "/logs/e.BIN: failed: cut off" in text
    assert text.count("•") == 2
