"""Nothing is lost in a long run: ten minutes at 200 messages a second through `shadow live`.

    python -m benchmarks.live_soak [--minutes 10] [--rate 200]

A boat says ATTITUDE, LOCAL_POSITION_NED, SERVO_OUTPUT_RAW and GLOBAL_POSITION_INT in turn, and
HEARTBEAT once a second. In the end every frame that was sent must stand in the recording, and every
message of the shadow that was recorded must have reached a subscriber in another process. Memory
and lateness are shown beside.
"""

import argparse
import socket
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import zenoh
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.live_latency import LIVE, VESSEL, free_port, joined, pack, program, wait_until
from gateway.recording.reader import Recording


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=200.0)
    options = parser.parse_args()
    with ExitStack() as scope:
        folder = Path(scope.enter_context(tempfile.TemporaryDirectory()))
        sent, heard, memory = _soak(folder, options.minutes * 60.0, options.rate)
        _report(folder, sent, heard, memory)


def _soak(
    folder: Path, seconds: float, rate: float
) -> tuple[int, dict[str, list[bytes]], list[float]]:
    """-> frames sent, payloads heard by topic, resident memory each ten seconds [MB]."""
    port, endpoint = free_port(socket.SOCK_DGRAM), f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    config = folder / "gateway.toml"
    config.write_text(f'[zenoh]\nendpoint = "{endpoint}"\n')
    live = ["live", f"udpin:127.0.0.1:{port}", "--vessel", str(VESSEL), "--silent"]
    live += ["--out", str(folder), "--config", str(config)]
    heard: dict[str, list[bytes]] = {"shadow": [], "health": [], "event": []}

    def note(sample: zenoh.Sample) -> None:
        topic = str(sample.key_expr).rpartition("/")[2]
        if topic in heard:
            heard[topic].append(sample.payload.to_bytes())

    with (
        program([LIVE, *live], "listening on") as process,
        joined(endpoint) as session,
        session.declare_subscriber("shadow/**", note),
    ):
        sent, memory = _speak(seconds, rate, port, process.pid)
        time.sleep(2.0)
    return sent, heard, memory


def _speak(seconds: float, rate: float, port: int, pid: int) -> tuple[int, list[float]]:
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    voice, memory = dialect.MAVLink(None, 1, 1), list[float]()
    line.sendto(pack(voice, dialect.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3)), _home(port))
    time.sleep(1.0)  # the first word opens keys and recording
    count, begun = 1, time.monotonic_ns()
    for k in range(int(seconds * rate)):
        t = k / rate
        wait_until(begun + round(t * 1e9))
        beat = k % round(rate) == 0
        message = dialect.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3) if beat else _said(k, t)
        line.sendto(pack(voice, message), _home(port))
        count += 1
        if k % round(10.0 * rate) == 0:
            memory.append(_resident_mb(pid))
    line.close()
    return count, memory


def _home(port: int) -> tuple[str, int]:
    return "127.0.0.1", port


def _said(k: int, t: float) -> Any:
    """A boat that goes round in circles."""
    ms, yaw, radius = 10_000 + round(t * 1000.0), 0.1 * t, 10.0
    north, east = radius * np.sin(yaw), radius * (1.0 - np.cos(yaw))
    vn, ve = np.cos(yaw), np.sin(yaw)
    turned = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    match k % 4:
        case 0:
            return dialect.MAVLink_attitude_message(ms, 0.0, 0.0, turned, 0.0, 0.0, 0.1)
        case 1:
            return dialect.MAVLink_local_position_ned_message(ms, north, east, 0.0, vn, ve, 0.0)
        case 2:
            return dialect.MAVLink_servo_output_raw_message(ms * 1000, 0, *([1600] * 8))
        case _:
            lat, lon = 634400000 + round(north * 89.7), 104000000 + round(east * 200.0)
            velocity = round(vn * 100.0), round(ve * 100.0)
            return dialect.MAVLink_global_position_int_message(
                ms, lat, lon, 0, 0, *velocity, 0, 65535
            )


def _resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def _report(folder: Path, sent: int, heard: dict[str, list[bytes]], memory: list[float]) -> None:
    (path,) = folder.glob("*.mcap")
    recording = Recording.open(path)
    kept = sum(len(frame) > 0 for frame in recording.raw().frames())  # ticks are empty
    written = [payload for rows in recording.rows("shadow") for payload in rows.payloads]
    health = [orjson.loads(payload) for payload in heard["health"]]
    late = [row["loop_lateness_s"] * 1e3 for row in health]
    kinds = [orjson.loads(payload)["kind"] for payload in heard["event"]]
    print(f"frames: {sent} sent, {kept} recorded: {sent - kept} lost")
    missing = len(set(written) - set(heard["shadow"]))
    print(f"shadow: {len(written)} recorded, {len(heard['shadow'])} heard: {missing} lost")
    print(f"late {health[-1]['late']}, gated {health[-1]['gated']}, events {sorted(set(kinds))}")
    p50, p99 = np.percentile(late, [50, 99]).tolist()
    print(f"worst lateness of each second: p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    print(f"memory: {memory[min(3, len(memory) - 1)]:.0f} MB after warming up, {memory[-1]:.0f} MB")
    print("kept" if sent == kept and not missing else "MISSED")


if __name__ == "__main__":
    main()
