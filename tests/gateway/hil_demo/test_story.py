"""The story as a user runs it: whole with the stand-in, with firmware where it is at hand."""

import os
import subprocess
from pathlib import Path

import pytest

from gateway.hil_demo import MissionTask
from gateway.hil_demo.ardurover import ArduRover
from gateway.offline.compare import compare_logs
from gateway.recording.reader import Recording
from gateway.vessel_file import load_vessel
from sim.hil.day import Day
from tests.gateway.command_line import SHADOW, one_line

FIRMWARE = os.environ.get("SHADOW_ARDUROVER", "")


def test_what_cannot_be_told_is_one_line(run, tmp_path):
    (tmp_path / "calm.toml").write_text("[wind]\nspeed = 1.0\ndirection = 0.0\n")
    (tmp_path / "text").write_text("no program")
    for words, expected in (
        (("--autopilot", tmp_path / "text"), "text: no program: expected ardurover"),
        (("--autopilot", tmp_path), "no program: expected ardurover"),
        (("--script", tmp_path / "calm.toml"), "the day has no [[effects]]"),
        (("-v", "steered", "--autopilot", "/bin/true"), "has rudders"),
    ):
        done = run("hil-demo", "--out", tmp_path / "out", *words)
        one_line(done, 2, expected)
        assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_whole_story_with_the_stand_in(tmp_path):
    words = [*SHADOW, "hil-demo", "--out", str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "that is what was hidden, thruster_imbalance (port_gain 0.75)" in done.stdout
    assert "the error of a mission that it never saw falls" in done.stdout
    assert "the error of the free predictions falls" in done.stdout
    added = load_vessel(tmp_path / "better.toml").effects
    assert [a.effect.name for a in added] == ["thruster_imbalance"]
    assert added[0].values["port_gain"] == pytest.approx(0.75, abs=0.02)
    (recording,) = (tmp_path / "5-mission").glob("*.mcap")
    assert Recording.open(recording).finished


@pytest.mark.slow
@pytest.mark.skipif(not FIRMWARE, reason="SHADOW_ARDUROVER names no ardurover built for SITL")
def test_real_firmware_sails_a_mission(tmp_path):
    otter = load_vessel("otter")
    task = MissionTask(((20.0, 0.0), (20.0, 20.0)), 0.5, 1.5)
    done = ArduRover.of(Path(FIRMWARE), otter).sail(task, otter, Day(), tmp_path / "a", 1)
    assert done.remarks == ()
    (found,) = compare_logs([done.log], [otter])
    assert found.nrmse < found.ruler.noise_floor
    truth = Recording.open(done.recording).columns("truth/a")
    assert abs(truth["north_m"][-1] - 20.0) < 5.0
