"""`shadow compare LOG --with-hil RECORDING` on a mission that was really sailed in the loop."""

import json
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.hil_demo import MissionTask, StandInAutopilot
from gateway.offline.beside_loop import beside_loop, loop_passages
from gateway.offline.trials import DEFAULT_TRIALS
from gateway.vessel_file import load_vessel
from sim.hil.day import Day, Moment

pytestmark = pytest.mark.slow  # two missions are sailed
MISSION = MissionTask(((20.0, 0.0), (20.0, 20.0), (0.0, 20.0)), 0.5, 1.0)


@pytest.fixture(scope="module")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """A log and recordings: of a whole boat, and of one whose port motor weakens at 20 s."""
    otter, folder = load_vessel("otter"), tmp_path_factory.mktemp("sailed")
    weak = Day(moments=(Moment(20.0, thruster="left", gain=0.4),))
    autopilot = StandInAutopilot(otter)
    runs = [
        autopilot.sail(MISSION, otter, day, folder / name, 1)
        for name, day in (("whole", Day()), ("weak", weak))
    ]
    return runs[0].log, [run.recording for run in runs]


def test_the_loop_of_the_same_boat_does_not_part(sailed):
    log, (whole, weak) = sailed
    same = beside_loop(log, whole, load_vessel("otter")).missions
    assert same.partings == ()
    assert abs(same.lag).max() < 1.5
    slower = beside_loop(log, weak, load_vessel("otter")).missions
    assert slower.lag[-1] > 10.0
    assert abs(slower.lag[slower.along < 8.0]).max() < 2.0, "it is whole for so long"
    assert slower.mean_pulses()[1][1] > slower.mean_pulses()[1][0] + 20.0


def test_the_log_of_the_autopilot_serves_as_well(sailed):
    log, _ = sailed
    found = beside_loop(log, log, load_vessel("otter")).missions
    assert abs(found.gap).max() < 1e-6


def test_what_holds_no_track_is_one_line(sailed, tmp_path):
    log, _ = sailed
    (tmp_path / "x.mcap").write_bytes(b"no recording")
    with pytest.raises(BadInput, match=r"x\.mcap"):
        beside_loop(log, tmp_path / "x.mcap", load_vessel("otter"))


def test_a_restart_begins_another_track(sailed):
    _, (whole, _) = sailed
    assert len(loop_passages(whole, DEFAULT_TRIALS)) == 1


def test_the_command_tells_draws_and_prints_json(sailed, tmp_path, run):
    log, (_, weak) = sailed
    words = ["compare", log, "-v", "otter", "--with-hil", weak]
    done = run(*words, "--pictures", tmp_path)
    assert "The mission beside the loop" in done.out
    assert "s later" in done.out
    drawn = {file.name for file in tmp_path.glob("whole-*.png")}
    assert {"whole-beside-the-loop.png", "whole-gap-and-lag.png"} <= drawn
    found = json.loads(run(*words, "--json").out)["with_hil"]
    assert found["lag_s"][-1] > 10.0
    assert "with_hil" not in json.loads(run(*words[:4], "--json").out)
    assert "one LOG" in run("compare", log, *words[1:]).err
