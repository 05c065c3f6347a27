"""The gateway on real sockets and as a program: signals, kill -9, strangers, watchers, disks."""

import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.links.rate_requests import RADIO_HZ
from gateway.links.transmitter import SET_RATE, Identity
from gateway.live.boats import BoatPlan, Fleet
from gateway.live.rerun import fleet_of, rerun
from gateway.recording.reader import Recording
from gateway.recording.repair import repair
from gateway.simulated_boat import Faults, Reboot, Silence
from gateway.simulated_boat.play import playing
from tests.conftest import ROOT
from tests.gateway.pipelines.aboard import SETTINGS, Heard
from tests.gateway.pipelines.running import (
    boat,
    free_port,
    program,
    running,
    subscribed,
    wait,
)
from tests.sim.vessels import WAMV

COMPARED = ("measured", "reference", "shadow", "control", "residual", "position")


def sane(heard: Heard) -> None:
    """Finite by being JSON; and slow, near and calm as a boat is."""
    limits = {"surge_mps": 4.0, "sway_mps": 2.0, "north_m": 100.0, "east_m": 100.0}
    for name, most in limits.items():
        assert np.abs(heard.column("shadow", name)).max() < most


def recorded(*paths: Path) -> dict[str, list[bytes]]:
    return {
        topic: [
            payload
            for path in paths
            for rows in Recording.open(path).rows(topic)
            for payload in rows.payloads
        ]
        for topic in COMPARED
    }


def again(*paths: Path) -> dict[str, list[bytes]]:
    """What the same inputs give."""
    fleet: Fleet = fleet_of(Recording.open(paths[0]), BoatPlan(WAMV), SETTINGS)
    heard = Heard()
    for path in paths:
        for moment in rerun(fleet, path):
            heard.add(moment.rows)
    return {topic: heard.payloads[topic] for topic in COMPARED}


@pytest.mark.alone
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_cleanly_and_soon_and_what_ran_runs_again(
    tmp_path: Path, number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = Faults(silences=(Silence(3.0, 4.5),), loss=0.05)
    with program(tmp_path) as live, playing([boat(faults=faults)], f"udpout:127.0.0.1:{live.port}"):
        wait(lambda: live.says("recording:"))
        time.sleep(8.0)
        seconds = live.end(number)
    with capsys.disabled():
        print(f"\n{number.name}: ended after {seconds:.3f} s")
    assert seconds < 2.0
    assert live.process.returncode == 0
    assert live.told[-1] == "finished"
    (path,) = live.recordings
    assert f"recorded: {path}" in live.told
    assert Recording.open(path).finished
    live_rows, relived_rows = recorded(path), again(path)
    for topic in COMPARED:
        assert relived_rows[topic] == live_rows[topic]
    assert len(live_rows["shadow"]) > 200


IN_A_WINDOW = """
import os, sys
os.setsid()
window, pipe = os.fdopen(os.open({terminal!r}, os.O_RDWR), "w"), sys.stderr
class Both:
    def write(self, text):
        pipe.write(text)
        window.write(text)
    def flush(self):
        pipe.flush()
        window.flush()
sys.stderr = Both()
"""


@pytest.mark.alone
def test_a_window_that_is_closed_leaves_a_finished_recording(tmp_path: Path) -> None:
    window, terminal = os.openpty()
    before = IN_A_WINDOW.format(terminal=os.ttyname(terminal))
    with (
        program(tmp_path, before=before) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
    ):
        os.close(terminal)
        wait(lambda: live.recordings and live.recordings[0].stat().st_size > 30_000)
        os.close(window)
        assert live.process.wait(10.0) == 0
    assert live.told[-1] == "finished"
    assert Recording.open(live.recordings[0]).finished


@pytest.mark.alone
def test_kill_9_loses_at_most_a_second_and_repair_makes_the_recording_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with program(tmp_path) as live, playing([boat()], f"udpout:127.0.0.1:{live.port}"):
        wait(lambda: live.says("recording:"))
        time.sleep(5.3)
        killed_ns = time.time_ns()
        live.end(signal.SIGKILL)
    (path,) = live.recordings
    assert not Recording.open(path).finished
    before = recorded(path)
    done = repair(path, now=lambda: time.time() + 60.0)
    assert not done.was_finished
    assert Recording.open(path).finished
    assert recorded(path) == before
    whole = Recording.open(path)
    last = whole.raw().receive_time_ns[-1], whole.columns("shadow")["receive_time_ns"][-1]
    lost_s = [(killed_ns - int(moment)) * 1e-9 for moment in last]
    with capsys.disabled():
        print(f"\nkill -9 lost {lost_s[0]:.2f} s of frames, {lost_s[1]:.2f} s of the shadow")
    assert max(lost_s) < 1.0
    with path.open("rb") as stream:
        messages = list(make_reader(stream, validate_crcs=True).iter_messages())
    assert len(messages) == done.messages
    same = again(path)
    for topic in COMPARED:
        assert same[topic][: len(before[topic])] == before[topic]


@pytest.mark.alone
def test_parts_of_a_recording_that_rotates_are_whole_and_run_again_as_one(tmp_path: Path) -> None:
    with (
        program(tmp_path, config="rotate_seconds = 2.0\n") as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
    ):
        wait(lambda: len(live.recordings) == 4)
        live.end(signal.SIGTERM)
    paths = live.recordings
    assert all(Recording.open(path).finished for path in paths)
    live_rows, relived_rows = recorded(*paths), again(*paths)
    for topic in COMPARED:
        assert relived_rows[topic] == live_rows[topic]


@pytest.mark.alone
def test_a_disk_that_takes_no_more_is_an_event_and_the_shadow_runs_on(tmp_path: Path) -> None:
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (150000, 150000));"
    with (
        program(tmp_path, before=limit) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
        subscribed(live.endpoint) as came,
    ):
        wait(lambda: any(e["kind"] == "recording_failed" for e in came("event")))
        told = [e for e in came("event") if e["kind"] == "recording_failed"]
        count = len(came("shadow"))
        wait(lambda: len(came("shadow")) > count + 100)
        wait(lambda: came("health")[-1]["recorder_drops"] > 0)
        seconds = live.end(signal.SIGTERM)
    assert "cannot record" in told[0]["says"]
    assert seconds < 2.0
    assert not Recording.open(live.recordings[0]).finished


def heard_by_the_boat(silent: bool, seconds: float = 3.0) -> list[Any]:
    """All frames that a boat gets which says what boats say."""
    decoder, mav, port = dialect.MAVLink(None), dialect.MAVLink(None, 1, 1), free_port()
    got: list[Any] = []
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line,
        running(f"udpin:127.0.0.1:{port}", silent=silent) as (gateway, _, _),
    ):
        line.settimeout(0.05)
        begun = time.monotonic()
        while time.monotonic() < begun + seconds:
            ms = 1000 + round((time.monotonic() - begun) * 1000)
            for said in (
                dialect.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3),
                dialect.MAVLink_attitude_message(ms, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0),
                dialect.MAVLink_local_position_ned_message(ms, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0),
            ):
                line.sendto(said.pack(mav), ("127.0.0.1", port))
                mav.seq = (mav.seq + 1) % 256
            try:
                got += decoder.parse_buffer(line.recv(4096)) or []
            except TimeoutError:
                continue
        assert gateway.fleet.boats
    return got


def test_silent_means_that_nothing_at_all_is_sent() -> None:
    assert heard_by_the_boat(silent=True) == []


def test_else_only_heartbeats_and_requests_are_sent_under_an_id_of_our_own() -> None:
    got = heard_by_the_boat(silent=False)
    assert {m.get_type() for m in got} - {"PARAM_REQUEST_READ"} == {"HEARTBEAT", "COMMAND_LONG"}
    assert {m.get_srcSystem() for m in got} == {Identity().system}
    assert {m.command for m in got if m.get_type() == "COMMAND_LONG"} == {SET_RATE}
    assert {m.autopilot for m in got if m.get_type() == "HEARTBEAT"} == {8}


@pytest.mark.alone
def test_requests_are_made_again_after_a_reboot() -> None:
    port = free_port()
    with (
        running(f"udpin:127.0.0.1:{port}") as (_, heard, told),
        playing([boat(faults=Faults(reboots=(Reboot(4.0, 1.0),)))], f"udpout:127.0.0.1:{port}"),
    ):
        wait(lambda: sum("ATTITUDE at 50 Hz: accepted" in says for says in told) == 2)
        wait(lambda: "reboot" in heard().events())
    sane(heard())


@pytest.mark.alone
def test_a_boat_is_asked_for_the_rates_of_the_configuration(tmp_path: Path) -> None:
    rates = '[links.rates]\npreset = "radio"\nRAW_IMU = 2\nSYSTEM_TIME = 0\n'
    asked = {name: hz for name, hz in RADIO_HZ.items() if hz > 0} | {"RAW_IMU": 2}
    del asked["SYSTEM_TIME"]
    with (
        program(tmp_path, config=rates) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
    ):
        answers = wait(
            lambda: len(got := [s for s in live.told if " Hz: " in s]) == len(asked) and got
        )
    assert answers == [f"system 1: {name} at {hz:g} Hz: accepted" for name, hz in asked.items()]


@pytest.mark.alone
def test_hostile_datagrams_do_no_harm() -> None:
    dice, port = random.Random(4), free_port()
    with (
        running(f"udpin:127.0.0.1:{port}") as (gateway, heard, _),
        playing([boat()], f"udpout:127.0.0.1:{port}"),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line,
    ):
        wait(lambda: heard().payloads["shadow"])
        for _ in range(1500):
            magic = bytes([dice.choice((0xFD, 0xFE, 0x55))])
            line.sendto(magic + dice.randbytes(dice.randrange(1, 1400)), ("127.0.0.1", port))
            time.sleep(0.002)
        count = len(heard().payloads["shadow"])
        wait(lambda: len(heard().payloads["shadow"]) > count + 50)
        counts = gateway.links[0].counts()
    assert counts.junk_bytes > 500_000
    assert list(gateway.fleet.boats) == [1]
    assert "telemetry_silent" not in heard().events()
    sane(heard())


def test_of_two_boats_with_one_system_id_one_is_shadowed() -> None:
    port = free_port()
    with (
        running(f"udpin:127.0.0.1:{port}") as (gateway, heard, told),
        playing([boat()], f"udpout:127.0.0.1:{port}"),
        playing([boat(start=(8.0, 5.0, 0.0), boot_s=900.0)], f"udpout:127.0.0.1:{port}"),
    ):
        wait(lambda: "link_shared_id" in heard().events())
        count = len(heard().payloads["shadow"])
        wait(lambda: len(heard().payloads["shadow"]) > count + 100)
        assert gateway.links[0].counts().apart > 100
    assert any("two boats with one id" in says for says in told)
    assert "reboot" not in heard().events()  # the other one's clock is not this boat's
    sane(heard())


WATCHER = """
import json, sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
with zenoh.open(config) as session, session.declare_subscriber("shadow/**") as subscriber:
    for sample in subscriber:
        print(sample.key_expr, flush=True)
"""


@contextmanager
def watcher(endpoint: str) -> Iterator[subprocess.Popen[str]]:
    """Another process that subscribes; killed in the end, hanging or not."""
    with subprocess.Popen(
        [sys.executable, "-c", WATCHER, endpoint], cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def lines(process: subprocess.Popen[str], count: int) -> list[str]:
    assert process.stdout is not None
    return [process.stdout.readline().strip() for _ in range(count)]


@pytest.mark.alone
def test_a_watcher_that_hangs_or_vanishes_delays_nothing_and_comes_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with program(tmp_path) as live, playing([boat()], f"udpout:127.0.0.1:{live.port}"):
        wait(lambda: live.says("recording:"))
        with subscribed(live.endpoint) as came, watcher(live.endpoint) as slow:
            lines(slow, 20)
            os.kill(slow.pid, signal.SIGSTOP)
            with watcher(live.endpoint) as gone:
                lines(gone, 20)
            wait(lambda: len(came("health")) > 1)
            before = len(came("health"))
            wait(lambda: len(came("health")) > before + 10)
            late = [h["loop_lateness_s"] for h in came("health")[before:]]
            count = len(came("shadow"))
            time.sleep(1.0)
            assert len(came("shadow")) - count > 35
            os.kill(slow.pid, signal.SIGCONT)
            lines(slow, 20)
            with watcher(live.endpoint) as back:
                assert set(lines(back, 50)) >= {"shadow/wam-v/shadow", "shadow/wam-v/measured"}
        live.end(signal.SIGTERM)
    with capsys.disabled():
        print(f"\nloop late by at most {max(late) * 1e3:.1f} ms beside a watcher that hangs")
    (path,) = live.recordings
    assert int(Recording.open(path).columns("health")["recorder_drops"].max()) == 0
    assert np.diff(Recording.open(path).columns("shadow")["receive_time_ns"]).max() < 1e9
