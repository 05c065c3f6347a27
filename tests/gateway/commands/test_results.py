"""What commands print and write: JSON alone where asked, else words and the place of the files."""

import json
import os
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.config import Settings, as_tables, load_settings
from gateway.ingest.csv.log import QUANTITIES
from gateway.ingest.open import open_log
from gateway.recording.reader import Recording
from gateway.vessel_file import dump_vessel, load_vessel
from sim.effects.catalogue import EFFECTS
from tests.conftest import ROOT
from tests.gateway.command_line import Run, command, one_line, strictly
from tests.sim.vessels import IACQUABOT


@pytest.mark.parametrize(
    "name", ["info", "init", "replay", pytest.param("compare", marks=pytest.mark.slow)]
)
def test_json_stands_alone_on_standard_output(
    run: Run, tmp_path: Path, boat: Path, log: Path, name: str
) -> None:
    done = run(*command(name, log, boat, tmp_path / "out"), "--json")
    assert (done.status, done.err) == (0, "")
    assert strictly(done.out)


def test_the_catalogue_as_json_holds_each_effect_with_its_parameters(run: Run) -> None:
    listed = strictly(run("effects", "--json").out)["effects"]
    assert [one["name"] for one in listed] == [effect.name for effect in EFFECTS]
    one = strictly(run("effects", "steady_current", "--json").out)
    assert one == next(e for e in listed if e["name"] == "steady_current")
    assert one["parameters"][0]["unit"] == "m/s"


def test_the_json_of_a_simulation_is_what_its_lines_say(
    run: Run, tmp_path: Path, boat: Path
) -> None:
    (tmp_path / "c.csv").write_text("time,left,right\n0,0.5,0.5\n4,0.5,0.5\n")
    words = ["simulate", tmp_path / "c.csv", "-v", boat, "--out", tmp_path / "out"]
    found = strictly(run(*words, "--json").out)
    lines = " ".join(run(*words, "--force").out.split())
    end = found["at_end"]
    assert f"{end['north_m']:.1f} m north, {end['east_m']:.1f} m east" in lines
    assert f"{end['surge_mps']:.2f} m/s ahead" in lines
    assert Path(found["recording"]).is_file()
    assert found["follower_rmse"] is None


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


def test_a_replay_prints_what_the_shadow_warned_of(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    """It was counted among "2 events", and told only by `info --events` of the recording."""
    wrong, out = tmp_path / "wrong.toml", tmp_path / "out"
    wrong.write_text(boat.read_text().replace("channel = 2", "channel = 9"))
    done = run("replay", log, "-v", wrong, "--out", out)
    assert done.status == 0
    assert "! output 9 (" in done.out
    assert "missing force: not judged" in done.out
    told = strictly(run("replay", log, "-v", wrong, "--out", out, "--json").out)
    (warning,) = told["replays"][0]["warnings"]
    assert warning.startswith("output 9 (")
    assert told["replays"][0]["missing_force_rms"] == {}
    assert "! " not in run("replay", log, "-v", boat, "--out", out).out


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
    assert run("replay", log, "-v", made, "--no-record", "--no-publish").status == 0
    assert run("compare", log, "-v", made).status == 0


def test_simulate_writes_the_log_that_its_radio_would_have_made(
    run: Run, tmp_path: Path, boat: Path
) -> None:
    file = tmp_path / "played.tlog"
    done = run("simulate", "-v", boat, "--log", file, "--seconds", "6")
    assert (done.status, done.out) == (0, "")
    assert f"played into {file}" in " ".join(done.err.split())
    assert open_log(file).counts()["ATTITUDE"] >= 20
    both = run("simulate", "-v", boat, "--log", file, "--live", "udpout:127.0.0.1:1")
    assert (both.status, "give one" in both.err) == (2, True)


def test_simulate_makes_a_recording(run: Run, tmp_path: Path, boat: Path) -> None:
    sticks = tmp_path / "sticks.csv"
    sticks.write_text("time,left,right\n0,0.5,0.4\n20,0,0\n")
    other = tmp_path / "other.toml"
    other.write_text(dump_vessel(IACQUABOT), encoding="utf-8")
    done = run("simulate", sticks, "-v", boat, "--follow", other, "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert "follower − vessel" in done.out
    assert Recording.open(tmp_path / "out" / "sticks-simulated.mcap").counts()["shadow"] == 1000


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
