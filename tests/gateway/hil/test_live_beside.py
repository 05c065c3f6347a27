"""`shadow live` beside `shadow hil` on one machine: a boat in the loop has a shadow."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from gateway.recording.reader import Recording
from tests.gateway.command_line import SHADOW
from tests.gateway.hil.firmware import free_port

SAILS_S = 25.0


def process(*words: object) -> subprocess.Popen[str]:
    return subprocess.Popen([*map(str, words)], stderr=subprocess.PIPE, text=True)


def wait_for_line(started: subprocess.Popen[str], text: str) -> None:
    assert started.stderr is not None
    for line in started.stderr:
        if text in line:
            return
    raise AssertionError(f"{started.args}: ended without saying {text!r}")


@pytest.mark.alone
def test_the_shadow_lies_where_the_boat_in_the_loop_truly_is(tmp_path: Path) -> None:
    sensors, radio = free_port(), free_port()
    out = {name: tmp_path / name for name in ("hil", "live")}
    running = [
        process(*SHADOW, "hil", f"json:127.0.0.1:{sensors}", "-v", "ferry=otter",
                "--out", out["hil"]),
        process(*SHADOW, "live", f"udpin:127.0.0.1:{radio}", "-v", "otter", "--name", "ferry",
                "--out", out["live"], "--no-publish", "--topics", "all"),
    ]  # fmt: skip
    try:
        wait_for_line(running[0], "waiting for an autopilot")
        wait_for_line(running[1], "listening on")
        running.append(
            process(sys.executable, "-m", "gateway.stand_in", "--vessel", "otter", "--excitation",
                    "circles", "--sensors", f"127.0.0.1:{sensors}", "--mavlink",
                    f"udpout:127.0.0.1:{radio}")
        )  # fmt: skip
        wait_for_line(running[1], "recording: ")
        time.sleep(SAILS_S)
    finally:
        for each in reversed(running):
            each.send_signal(signal.SIGINT)
            said = each.communicate(timeout=60.0)[1]
            assert each.returncode == 0, said
    (hil,), (live,) = (sorted(folder.glob("*.mcap")) for folder in out.values())
    truth, shadow = (
        Recording.open(hil).columns("truth/ferry"),
        Recording.open(live).columns("shadow"),
    )
    true = np.column_stack([truth["north_m"], truth["east_m"]])
    track = np.column_stack([shadow["north_m"], shadow["east_m"]])
    sailed = np.hypot(*np.diff(true, axis=0).T).sum()
    assert sailed > 5.0
    assert len(track) > 10.0 * SAILS_S
    away = np.array(
        [np.hypot(*(true - place).T).min() for place in track[:: max(len(track) // 200, 1)]]
    )
    assert np.median(away) < 1.5, "errors of a receiver, no more"
    assert np.hypot(*np.diff(track, axis=0).T).sum() > 0.5 * sailed, "it sails along"
