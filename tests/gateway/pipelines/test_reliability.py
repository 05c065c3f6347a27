"""Each fault at the real boundary: the shadow goes on or says why not, little is lost, it recovers.

The gateway is a program of its own; the rows that are noted here make the table of
docs/reliability.md (`python -m benchmarks.reliability`).
"""

import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from gateway.recording.reader import Recording
from gateway.recording.repair import repair
from gateway.simulated_boat import Faults, Reboot
from gateway.simulated_boat.play import playing
from tests.conftest import ROOT
from tests.gateway.pipelines.running import Program, boat, free_port, program, subscribed, wait
from tests.gateway.pipelines.test_live_process import WATCHER
from tests.gateway.reliability import Row, note

pytestmark = pytest.mark.alone
SETTLED_S = 4.0  # of undisturbed shadow before a fault
Send = Callable[[bytes], Any]


class Pump(threading.Thread):
    """A boat in real time whose frames go wherever `send` says at the moment; nowhere if None."""

    def __init__(self, send: Send | None, **settings: Any) -> None:
        super().__init__(daemon=True)
        self.send, self._boat, self._stop_it = send, boat(**settings), threading.Event()

    def __enter__(self) -> "Pump":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_it.set()
        self.join()

    def run(self) -> None:
        state, begun = self._boat.start(), time.monotonic()
        while not self._stop_it.wait(0.005):
            state, frames = self._boat.advance(state, time.monotonic() - begun)
            for frame in frames:
                send = self.send
                if send is not None:
                    with suppress(OSError):
                        send(frame.data)


def fresh_s(paths: list[Path]) -> Any:
    """Receipts of the rows that rest on measurements [s], of all parts."""
    columns = [Recording.open(path).columns("measured")["receive_time_ns"] for path in paths]
    return np.concatenate(columns) * 1e-9


def back_after(paths: list[Path], ended_s: float) -> float:
    """From a moment to the first row after it that rests on measurements [s]."""
    times = fresh_s(paths)
    after = times[times > ended_s]
    assert len(after) > 20
    return float(after[0] - ended_s)


def silent_after(paths: list[Path], began_s: float) -> float:
    """From a moment to the end of the longest silence after it [s]."""
    times = fresh_s(paths)
    after = times[times > began_s]
    longest = int(np.argmax(np.diff(after)))
    assert after[longest + 1] - after[longest] > 1.0
    return float(after[longest + 1] - began_s)


def whole(live: Program) -> None:
    """Ends it, in order: nothing of what came may be missing in its recordings."""
    live.end(signal.SIGTERM)
    assert live.process.returncode == 0
    for path in live.recordings:
        assert Recording.open(path).finished
        assert int(Recording.open(path).columns("health")["recorder_drops"].max()) == 0


def told(live: Program, word: str) -> str:
    """The end of the line that it printed with that word."""
    (line, *_) = [line for line in live.told if word in line]
    return line[line.index(word) :]


def test_half_open_tcp(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        endpoint = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        with program(tmp_path, endpoint) as live, Pump(None) as pump:
            first, _ = server.accept()
            pump.send = first.sendall
            wait(lambda: live.says("recording:"))
            time.sleep(SETTLED_S)
            pump.send, began = None, time.time()  # neither bytes nor an end of the stream
            second, _ = server.accept()
            pump.send = second.sendall
            time.sleep(2.0)
            whole(live)
            first.close()
            second.close()
    note(Row("half-open TCP", "a server that sends nothing more and closes nothing",
             "runs on the model, joins again", told(live, "nothing came for"), 0.0,
             silent_after(live.recordings, began)))  # fmt: skip


def test_serial_unplugged(tmp_path: Path) -> None:
    device = tmp_path / "tty"

    def plug() -> int:
        near, far = os.openpty()
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(far))
        ends.append(far)
        return near

    ends: list[int] = []
    near = plug()
    with program(tmp_path, f"serial:{device}:115200") as live, Pump(None) as pump:
        pump.send = lambda data: os.write(near, data)
        wait(lambda: live.says("recording:"))
        time.sleep(SETTLED_S)
        pump.send = None
        device.unlink()
        os.close(ends.pop())
        os.close(near)
        wait(lambda: live.says("trying again"))
        time.sleep(1.5)
        other, plugged = plug(), time.time()
        pump.send = lambda data: os.write(other, data)
        time.sleep(5.0)
        pump.send = None
        whole(live)
        os.close(other)
    note(Row("serial unplugged", "a pseudo-terminal that is closed, and another in its place",
             "runs on the model, opens it again", told(live, "trying again"), 0.0,
             back_after(live.recordings, plugged)))  # fmt: skip


def test_a_link_at_30_percent_loss_with_duplicates_and_reordering(tmp_path: Path) -> None:
    bad = Faults(loss=0.3, duplicates=0.2, reordered=0.2)
    with (
        program(tmp_path) as live,
        playing([boat(faults=bad)], f"udpout:127.0.0.1:{live.port}"),
    ):
        wait(lambda: live.says("recording:"))
        time.sleep(2.0 * SETTLED_S)
        whole(live)
    times = fresh_s(live.recordings)
    assert np.diff(times).max() < 1.0
    loss = float(Recording.open(live.recordings[0]).columns("health")["loss"].max())
    assert loss > 0.15
    note(Row("30 % loss, duplicates, reordering", "a boat behind such a link (UDP)", "goes on",
             f"`health`: loss {100 * loss:.0f} %", 0.0, float(np.diff(times).max())))  # fmt: skip


CLOCK = """
import time
_real, _file = time.time_ns, {path!r}
def _ns():
    import os
    return _real() - (3_600_000_000_000 if os.path.exists(_file) else 0)
time.time_ns, time.time = _ns, lambda: _ns() * 1e-9
"""


def test_the_clock_goes_back_by_an_hour(tmp_path: Path) -> None:
    mark = tmp_path / "set-back"
    with (
        program(tmp_path, before=CLOCK.format(path=str(mark))) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
        subscribed(live.endpoint) as came,
    ):
        wait(lambda: came("measured"))
        time.sleep(SETTLED_S)
        mark.touch()
        began = time.time_ns()
        hour_ago = began - 3_500_000_000_000
        wait(lambda: came("measured")[-1]["receive_time_ns"] < hour_ago)
        back = (time.time_ns() - began) * 1e-9
        count = len(came("measured"))
        time.sleep(2.0)
        assert len(came("measured")) > count + 40
        assert came("health")[-1]["receive_time_ns"] < hour_ago
        whole(live)
    note(Row("clock back by an hour", "the program's own clock", "goes on with the new time",
             "nothing: time stamps of receipt are the new ones", 0.0, back))  # fmt: skip


def test_the_disk_is_full_and_has_room_again(tmp_path: Path) -> None:
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (400000, -1));"
    with (
        program(tmp_path, before=limit) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
        subscribed(live.endpoint) as came,
    ):
        wait(lambda: any(e["kind"] == "recording_failed" for e in came("event")))
        count = len(came("shadow"))
        resource.prlimit(live.process.pid, resource.RLIMIT_FSIZE, (-1, -1))
        room = time.time()
        wait(lambda: any(e["kind"] == "recording_again" for e in came("event")))
        assert len(came("shadow")) > count + 50
        time.sleep(1.5)
        live.end(signal.SIGTERM)
    first, *_, last = live.recordings
    assert Recording.open(last).finished
    known = float(Recording.open(first).raw().receive_time_ns[-1] * 1e-9)
    lost = first.stat().st_mtime - known  # the write that failed got its beginning in
    begun = [float(Recording.open(p).raw().receive_time_ns[0]) * 1e-9 for p in live.recordings]
    assert begun[-1] > room - 0.5
    note(Row("disk full", "a limit on the size of files, lifted later", "goes on",
             "recording_failed: no room; recording_again: where", max(lost, 0.0),
             max(begun[-1] - room, 0.0)))  # fmt: skip


SLOW = """
import gateway.recording.recorder as recorder, os, time
_open = recorder.open_new
class Slow:
    def __init__(self, stream): self._stream = stream
    def write(self, data):
        {wait}
        return self._stream.write(data)
    def __getattr__(self, name): return getattr(self._stream, name)
recorder.open_new = lambda path: Slow(_open(path))
recorder.Recorder.__init__.__kwdefaults__["opener"] = recorder.open_new
"""


def test_the_disk_is_slow(tmp_path: Path) -> None:
    slow = SLOW.format(wait="time.sleep(2.0 if os.path.exists('%s') else 0.0)" % (tmp_path / "on"))
    with (
        program(tmp_path, before=slow) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
        subscribed(live.endpoint) as came,
    ):
        wait(lambda: live.says("recording:"))
        (tmp_path / "on").touch()
        time.sleep(2.0)
        count = len(came("shadow"))
        time.sleep(SETTLED_S)
        assert len(came("shadow")) > count + 40 * SETTLED_S
        (tmp_path / "on").unlink()
        slow_until = time.time()
        wait(lambda: came("health")[-1]["recorder_backlog"] < 500)
        back = time.time() - slow_until
        late = max(h["loop_lateness_s"] for h in came("health")[3:])
        whole(live)
    assert late < 1.0
    raw = np.concatenate([Recording.open(p).raw().receive_time_ns for p in live.recordings]) * 1e-9
    note(Row("disk slow", "2 s for each write", "goes on", "`health`: recorder_backlog",
             max(float(np.diff(raw).max()) - 0.5, 0.0), back))  # fmt: skip


def test_the_recorder_thread_is_stuck(tmp_path: Path) -> None:
    mark = tmp_path / "stuck"
    stuck = SLOW.format(wait=f"\n        while os.path.exists({str(mark)!r}): time.sleep(0.05)")
    with (
        program(tmp_path, before=stuck) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
        subscribed(live.endpoint) as came,
    ):
        wait(lambda: live.says("recording:"))
        time.sleep(1.0)
        mark.touch()
        wait(lambda: any(e["kind"] == "recording_stalled" for e in came("event")))
        count = len(came("shadow"))
        time.sleep(1.0)
        assert len(came("shadow")) > count + 35
        mark.unlink()
        let_go = time.time()
        wait(lambda: sum(e["kind"] == "recording_stalled" for e in came("event")) == 2)
        back = time.time() - let_go
        whole(live)
    assert "the disk takes what is recorded again" in "".join(live.told)
    raw = np.concatenate([Recording.open(p).raw().receive_time_ns for p in live.recordings]) * 1e-9
    note(Row("recorder thread stuck", "a write that does not return", "goes on",
             told(live, "the disk has taken nothing"), max(float(np.diff(raw).max()) - 0.5, 0.0),
             back))  # fmt: skip


def test_the_process_is_killed(tmp_path: Path) -> None:
    with program(tmp_path) as live, playing([boat()], f"udpout:127.0.0.1:{live.port}"):
        wait(lambda: live.says("recording:"))
        time.sleep(SETTLED_S)
        killed = time.time()
        live.end(signal.SIGKILL)
    (path,) = live.recordings
    repair(path, now=lambda: time.time() + 60.0)
    begun = time.monotonic()
    assert Recording.open(path).finished
    lost = killed - float(Recording.open(path).raw().receive_time_ns[-1]) * 1e-9
    note(Row("process killed", "SIGKILL", "ends", "nothing; `shadow repair` makes the file whole",
             max(lost, 0.0), time.monotonic() - begun))  # fmt: skip


def router(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    return zenoh.open(config)


def test_a_router_goes_and_comes_back(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    first = router(endpoint)
    with (
        program(tmp_path, endpoint=endpoint) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
    ):
        with subscribed(endpoint) as came:
            wait(lambda: came("shadow"))
        first.close()
        time.sleep(1.5)
        second, begun = router(endpoint), time.monotonic()
        with subscribed(endpoint) as came:
            wait(lambda: came("shadow"))
            back = time.monotonic() - begun
            wait(lambda: len(came("shadow")) > 50)
        second.close()
        whole(live)
    assert np.diff(fresh_s(live.recordings)).max() < 1.0
    note(Row("zenoh router gone and back", "a router that is closed and started again",
             "goes on, publishes again", "nothing: it is joined again", 0.0, back))  # fmt: skip


def test_a_subscriber_never_reads(tmp_path: Path) -> None:
    with program(tmp_path) as live, playing([boat()], f"udpout:127.0.0.1:{live.port}"):
        wait(lambda: live.says("recording:"))
        with (
            subscribed(live.endpoint) as came,
            subprocess.Popen(
                [sys.executable, "-c", WATCHER, live.endpoint], cwd=ROOT, stdout=subprocess.PIPE
            ) as slow,
        ):
            try:
                assert slow.stdout is not None
                slow.stdout.readline()
                os.kill(slow.pid, signal.SIGSTOP)
                before = len(came("health"))
                wait(lambda: len(came("health")) > before + 6)
                late = max(h["loop_lateness_s"] for h in came("health")[before:])
            finally:
                slow.kill()
        whole(live)
    assert np.diff(fresh_s(live.recordings)).max() < 1.0
    note(Row("subscriber that never reads", "a stopped process (SIGSTOP)", "goes on",
             "nothing: it loses samples", 0.0, late))  # fmt: skip


def test_two_gateways_on_one_boat(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with (
        program(tmp_path / "a") as first,
        program(tmp_path / "b", endpoint=first.endpoint) as second,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line,
        Pump(None) as pump,
    ):
        pump.send = lambda data: line.sendto(data, ("127.0.0.1", first.port))
        wait(lambda: first.says("recording:"))

        def both(data: bytes) -> None:
            line.sendto(data, ("127.0.0.1", first.port))
            line.sendto(data, ("127.0.0.1", second.port))

        pump.send, begun = both, time.time()
        wait(lambda: second.says("recording:"))
        time.sleep(SETTLED_S)
        whole(first)
        whole(second)
    assert second.says("another gateway publishes under that name too")
    assert not first.says("another gateway publishes")
    for live in (first, second):
        assert np.diff(fresh_s(live.recordings)).max() < 1.0
    note(Row("two gateways on one boat", "two programs, one boat, one name on zenoh",
             "both go on, both record", told(second, "another gateway publishes").partition(":")[0],
             0.0, back_after(second.recordings, begun)))  # fmt: skip


def test_the_gateway_that_holds_the_port_of_zenoh_is_killed(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with (
        program(tmp_path / "a", "--name", "one") as first,
        program(tmp_path / "b", "--name", "two", endpoint=first.endpoint) as second,
        playing([boat()], f"udpout:127.0.0.1:{first.port}"),
        playing([boat()], f"udpout:127.0.0.1:{second.port}"),
    ):
        with subscribed(first.endpoint, "shadow/two/**") as came:
            wait(lambda: came("shadow"))
        first.end(signal.SIGKILL)
        begun = time.monotonic()
        back = wait(lambda: heard(second.endpoint, "shadow/two/**") and time.monotonic() - begun)
        whole(second)
    assert np.diff(fresh_s(second.recordings)).max() < 1.0
    note(Row("the gateway is killed that holds zenoh's port", "SIGKILL; another one had joined it",
             "the other one goes on and listens there", "nothing: it is found there again", 0.0,
             back))  # fmt: skip


def heard(endpoint: str, keys: str) -> bool:
    """Whether a new watcher hears of a shadow there within a second."""
    try:
        with subscribed(endpoint, keys) as came:
            time.sleep(1.0)
            return bool(came("shadow"))
    except zenoh.ZError:  # nobody listens
        return False


def test_the_boat_reboots_in_the_middle_of_a_chunk(tmp_path: Path) -> None:
    rebooting = Faults(reboots=(Reboot(SETTLED_S + 3.3, 1.5),))
    with (
        program(tmp_path) as live,
        playing([boat(faults=rebooting)], f"udpout:127.0.0.1:{live.port}"),
        subscribed(live.endpoint) as came,
    ):
        wait(lambda: any(e["kind"] == "reboot" for e in came("event")))
        rebooted = next(e for e in came("event") if e["kind"] == "reboot")
        time.sleep(4.0)
        whole(live)
    back = back_after(live.recordings, rebooted["receive_time_ns"] * 1e-9)
    note(Row("boat rebooted", "an autopilot whose clock, numbers and frame start anew",
             "runs on the model, then follows again", rebooted["says"], 0.0, back))  # fmt: skip


@pytest.mark.parametrize(("lost", "back"), [(1.2, 0.0), (0.0, 5.5)])
def test_a_row_beyond_the_limits_is_no_row(lost: float, back: float) -> None:
    with pytest.raises(AssertionError):
        note(Row("made up", "", "", "", lost, back))
