"""Replay of an hour at 50 Hz: how many times faster than the boat lived it, and where time goes.

    python -m benchmarks.replay [HOURS]

CPU time (`process_time`), compiled code warm, the file in the disk cache. Targets of what is
recorded by default: 400 × real time, at most a tenth of the time, at most 1.5 times the room of the
log. That is made first, in half a minute: ATTITUDE, LOCAL_POSITION_NED and SERVO_OUTPUT_RAW at
50 Hz each, 540 000 messages.
"""

import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.config import Settings, ZenohSettings
from gateway.ingest.open import open_log
from gateway.offline.replay import ReplayInput, ReplayOptions, replay, replay_input_of
from gateway.recording.recorder import TopicsKept
from gateway.shadow import filter_inputs_of
from gateway.shadow.events import EventDetector
from gateway.shadow.health import LogHealth
from gateway.shadow.model_monitor import ModelMonitor
from gateway.shadow.path import ShadowPath
from gateway.shadow.topic_rows import event_rows, topic_rows
from gateway.vessel_file import load_vessel
from sim.following.follower import Reference, ReferenceMode, VesselFollower
from sim.model import Model

VESSEL = Path(__file__).resolve().parent.parent / "configs" / "vessels" / "wam-v.toml"
RATE_HZ, HOUR_S = 50.0, 3600.0
START_US = 1_700_000_000_000_000
CHUNK = 5000  # facts
TRIES = 2  # the better one counts
TIMES_REAL, SHARE, ROOM = 400.0, 0.1, 1.5  # targets


def voyage(folder: Path, hours: float) -> Path:
    """The log of a voyage of so many hours."""
    path = folder / f"voyage-{hours:g}h.tlog"
    path.write_bytes(b"".join(frames(hours * HOUR_S)))
    return path


def frames(seconds: float) -> Iterator[bytes]:
    """Frames of a simulated voyage, each behind its time of receipt."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    for time_us, message in messages(seconds):
        yield struct.pack(">Q", START_US + time_us) + message.pack(mav)
        mav.seq = (mav.seq + 1) % 256


def messages(seconds: float) -> Iterator[tuple[int, Any]]:
    """µs after the start, message: motion of the simulated vessel with an autopilot's noise."""
    vessel, rng = load_vessel(VESSEL), np.random.default_rng(1)
    times = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    turn = 0.3 * np.sin(0.3 * times) * np.sin(0.01 * times)
    sticks = 0.5 + 0.2 * np.sin(0.05 * times)[:, None] + turn[:, None] * [1.0, -1.0]
    states, _ = Model.of(vessel).simulate(sticks, 1.0 / RATE_HZ)
    channels, pulses = vessel.pulses(sticks)
    noise = rng.normal(size=(len(times), 6)) * [0.02, 0.02, 0.001, 0.01, 0.01, 0.002]
    for k, row in enumerate((states[0, :-1, :6] + noise).tolist()):
        boot, at = round(times[k] * 1e3), round(times[k] * 1e6)
        north, east, yaw, u, v, r = row
        c, s = np.cos(yaw), np.sin(yaw)
        heading = (yaw + np.pi) % (2.0 * np.pi) - np.pi
        outputs = [0] * 8
        for channel, pulse in zip(channels, pulses[k], strict=True):
            outputs[channel - 1] = round(float(pulse))
        yield at, dialect.MAVLink_attitude_message(boot, 0.0, 0.0, heading, 0.0, 0.0, r)
        yield (
            at,
            dialect.MAVLink_local_position_ned_message(
                boot, north, east, 0.0, c * u - s * v, s * u + c * v, 0.0
            ),
        )
        yield at, dialect.MAVLink_servo_output_raw_message(at % 2**32, 0, *outputs)
        if k % int(RATE_HZ) == 0:
            yield at, dialect.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3)


class Stopwatch:
    """CPU seconds by stage."""

    def __init__(self) -> None:
        self.spent: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Adds what the block takes."""
        begun = time.process_time()
        yield
        self.spent[name] = self.spent.get(name, 0.0) + time.process_time() - begun


def stages(log: Path) -> dict[str, float]:
    """CPU seconds of each stage of a replay that goes nowhere."""
    watch, options = Stopwatch(), quiet(None)
    with watch.stage("read"):
        opened = open_log(log)
    with watch.stage("decode"):
        given = replay_input_of(opened, settings=options.settings)
    with watch.stage("feed (of decode)"):
        refeed(given, options)
    path = path_of()
    state, watchman, monitor = path.start(), EventDetector(), ModelMonitor.of(path.model)
    with watch.stage("count for health"):
        meter = LogHealth.of(given.log, given.decoded)
    for begin in range(0, len(given.feed), CHUNK):
        chunk = given.feed[begin : begin + CHUNK]
        with watch.stage("estimate (of path)"):
            path.estimator.advance(state.filter, chunk.events, covariance=True)
        with watch.stage("path"):
            state, out, filtered = path.advance(state, chunk)
        with watch.stage("hold against the model"):
            monitor, _, _ = monitor.observe(out)
        with watch.stage("encode"):
            watchman, happened = watchman.observe(chunk, filtered, out)
            for rows in topic_rows(out, given.origin):
                len(rows.payloads)
            event_rows(happened)
            meter.advance(chunk.receive_time_ns, filtered, out)
    return watch.spent


def refeed(given: ReplayInput, options: ReplayOptions) -> None:
    """The feed once more, by itself."""
    from gateway.ingest.sources import choose

    choices = choose(given.decoded.samples)
    filter_inputs_of(given.decoded, choices, given.origin, options.settings.filter)


def path_of() -> ShadowPath:
    """The path that a replay takes by default."""
    model = Model.of(load_vessel(VESSEL))
    return ShadowPath(model, Reference(model, ReferenceMode.MEASURED), VesselFollower.of(model))


def quiet(out: Path | None, topics: TopicsKept = TopicsKept.THINNED) -> ReplayOptions:
    """Options of a replay that nobody listens to."""
    recording = replace(Settings().recording, topics=topics)
    zenoh = ZenohSettings(publish=False)
    return ReplayOptions(out, settings=replace(Settings(), zenoh=zenoh, recording=recording))


def cpu(work: Callable[[], Any]) -> float:
    """CPU seconds."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def measure(hours: float, folder: Path) -> None:
    """Make the log, replay it with each way of recording, print."""
    log, vessel, seconds = voyage(folder, hours), load_vessel(VESSEL), hours * HOUR_S
    replay(voyage(folder, 0.01), vessel, None, quiet(folder / "warm"))
    bare = min(cpu(lambda: replay(log, vessel, None, quiet(None))) for _ in range(TRIES))
    print(f"{'not recorded':16} {bare:6.1f} s  {seconds / bare:6.0f} × real time")
    for topics in TopicsKept:
        options = quiet(folder / topics.value, topics)
        spent = min(cpu(partial(replay, log, vessel, None, options)) for _ in range(TRIES))
        size = sum(file.stat().st_size for file in (folder / topics.value).iterdir())
        speed, share, room = seconds / spent, 1.0 - bare / spent, size / log.stat().st_size
        text = f"{spent:6.1f} s  {speed:6.0f} × real time, {share:4.0%} of it, {room:.2f} × the log"
        if topics is TopicsKept.THINNED:
            reached = speed >= TIMES_REAL and share <= SHARE and room <= ROOM
            text += ": reached" if reached else ": MISSED"
        print(f"{'topics: ' + topics.value:16} {text}")
    print(f"log {log.stat().st_size / 1e6:.0f} MB; stage by stage:")
    for name, taken in stages(log).items():
        print(f"  {name:24} {taken:6.2f} s")


def main() -> None:
    """The command line."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    with tempfile.TemporaryDirectory() as folder:
        measure(hours, Path(folder))


if __name__ == "__main__":
    main()
