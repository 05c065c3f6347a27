"""`shadow hil` as a user runs it, in a process of its own."""

import json
import signal
import subprocess
import time

import pytest

from gateway.recording.reader import Recording
from tests.gateway.command_line import SHADOW, one_line
from tests.gateway.hil.firmware import StandIn, free_port


@pytest.mark.alone
def test_it_plays_until_ctrl_c_and_leaves_a_whole_recording(tmp_path):
    port = free_port()
    endpoint = f"json:127.0.0.1:{port}"
    command = [*SHADOW, "hil", endpoint, "-v", "ferry=otter", "--out", tmp_path, "--json"]
    pipe = subprocess.PIPE
    with subprocess.Popen([*map(str, command)], stdout=pipe, stderr=pipe, text=True) as process:
        assert "waiting for an autopilot" in process.stderr.readline()
        firmware = StandIn(port)
        assert firmware.sail({1: 1800, 3: 1800}, 2.0)["velocity"][0] > 0.3
        firmware.close()
        process.send_signal(signal.SIGINT)
        result, said = process.communicate(timeout=30.0)
    assert process.returncode == 0
    assert "ferry: 2 s in 800 frames" in said
    (path,) = tmp_path.glob("ferry-hil-*.mcap")
    recording = Recording.open(path)
    assert recording.finished
    assert f"recorded to {path}" in said
    assert recording.counts()["truth/ferry"] == pytest.approx(100, abs=2)
    (boat,) = json.loads(result)["boats"]
    assert (boat["name"], boat["endpoint"], boat["frames"]) == ("ferry", endpoint, 800)
    assert boat["recordings"] == [str(path)]
    assert 0.0 < boat["latency_us"]["p50"] <= boat["latency_us"]["p99"]


@pytest.mark.alone
def test_a_kill_loses_no_more_than_the_last_second(tmp_path):
    port = free_port()
    command = [*SHADOW, "hil", f"json:127.0.0.1:{port}", "-v", "ferry=otter", "--out", tmp_path]
    with subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, text=True) as process:
        process.stderr.readline()
        firmware = StandIn(port, rate=50)
        end = time.monotonic() + 3.0
        while time.monotonic() < end:
            firmware.frame({1: 1800, 3: 1800})
            time.sleep(0.005)
        sailed = firmware.count / firmware.rate
        firmware.close()
        process.kill()
    (path,) = tmp_path.glob("*.mcap")
    recording = Recording.open(path)
    assert not recording.finished
    rows = recording.counts()["truth/ferry"]
    per_second_of_wall = sailed / 3.0
    assert rows / 50.0 > sailed - 1.0 * per_second_of_wall - 1.0


@pytest.mark.parametrize(
    ("words", "wrong"),
    [
        ([], "no model of the boat: give --vessel FILE"),
        (["-v", "nowhere"], "cannot read the vessel file"),
        (["-v", "../up=otter"], "--vessel ../up=otter: the name '../up': must not be empty nor"),
        (["json:127.0.0.1:1", "tcp:x:2", "-v", "a=otter", "-v", "b=otter"], 'endpoint "tcp:x:2"'),
        (["-v", "otter", "--script", "nowhere.toml"], "nowhere.toml: cannot read the day"),
        (["-v", "otter", "--publish", "keelson"], "--publish keelson: expected zenoh or off"),
        (["json:127.0.0.1:1", "-v", "otter", "--no-record", "--connect", "sea"], "--connect sea"),
    ],
)
def test_bad_input_is_one_line(run, words, wrong):
    one_line(run("hil", *words, "--no-record"), 2, wrong)


def test_a_day_that_the_vessel_cannot_have_is_one_line(run, tmp_path):
    day = tmp_path / "day.toml"
    day.write_text('[[moments]]\nat = 1.0\nthruster = "middle"\ngain = 0.0\n')
    line = one_line(run("hil", "-v", "otter", "--no-record", "--script", day), 2)
    assert "no thruster 'middle': there are left, right" in line
