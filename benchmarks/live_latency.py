"""How late is the shadow: datagram in → zenoh sample in another process, beside a bare relay.

    python -m benchmarks.live_latency [--boats 1] [--seconds 30] [--runs 3]

`shadow live` runs as a program of its own, recording on. This process plays the boats on UDP and
subscribes to the gateway; in the same run it sends the same datagrams to a relay that does nothing
but `session.put(socket.recv())`, the least that any Python program between UDP and zenoh can do.
Each boat says ATTITUDE at 50 Hz, LOCAL_POSITION_NED and SERVO_OUTPUT_RAW at 25 Hz, HEARTBEAT at
1 Hz. Counted is `shadow/<vessel>/shadow` for one datagram of ATTITUDE, all other topics being
subscribed to as well. Targets: p50 within 1 ms of the relay's, p99 within 2 ms (one boat, 50 Hz);
p99 within 5 ms (five boats), within 10 ms (twenty). Runs are repeated and their median is shown:
the machine may be busy. Each boat is a `[[boats]]` of the configuration: `--vessel` alone is the
model of the first boat that speaks and of no other.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zenoh
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.live.boats import MAX_BOATS

ROOT = Path(__file__).resolve().parent.parent
VESSEL = ROOT / "configs" / "vessels" / "wam-v.toml"
RATE_HZ = 50.0
TARGETS_P99_MS = ((1, 2.0), (5, 5.0), (MAX_BOATS, 10.0))  # up to so many boats, beyond the relay
FIRST_MS, AGREE = 10_000, 5  # time in the first frame; samples that make an offset
SETTLE_S = 3.0  # left out: the first words, requests, files being opened
LIVE = "from gateway.cli import run; run()"
RELAY = """
import socket, sys, zenoh
from gateway.bus import BusSettings, open_session
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.bind(("127.0.0.1", int(sys.argv[1])))
with open_session(BusSettings(sys.argv[2])) as session:
    out = session.declare_publisher("relay", congestion_control=zenoh.CongestionControl.DROP)
    print("ready", file=sys.stderr, flush=True)
    while True:
        out.put(line.recv(2048))
"""


class Percentiles(NamedTuple):
    """Of one run [ms]; how many samples never came."""

    p50: float
    p99: float
    worst: float
    lost: int
    rate: float  # that came, per second


def main() -> None:
    """Run and print."""
    options = _options()
    shares: list[float] = []
    runs = [one_run(options.boats, options.seconds, shares) for _ in range(options.runs)]
    print(
        f"{options.boats} boat(s), {options.runs} runs of {options.seconds:.0f} s, medians of runs"
    )
    print(f"{'':8}{'p50':>9}{'p99':>9}{'worst':>9}  ms   lost")
    for name, rows in zip(("relay", "shadow"), zip(*runs, strict=True), strict=True):
        p50, p99, worst, lost, _ = np.median(np.array(rows), axis=0).tolist()
        print(f"{name:8}{p50:9.2f}{p99:9.2f}{worst:9.2f}      {lost:.0f}")
    beyond = np.median([[s.p50 - r.p50, s.p99 - r.p99] for r, s in runs], axis=0).tolist()
    limit = next(limit for most, limit in TARGETS_P99_MS if options.boats <= most)
    kept = beyond[0] <= 1.0 and beyond[1] <= limit
    print(
        f"beyond the relay: p50 {beyond[0]:+.2f} ms (target 1), p99 {beyond[1]:+.2f} ms "
        f"(target {limit:.0f}): {'kept' if kept else 'MISSED'}"
    )
    print(f"the gateway used {np.median(shares):.0%} of a core")
    print(f"load of the machine, last minute: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boats", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--runs", type=int, default=3)
    return parser.parse_args()


def one_run(
    boats: int, seconds: float, shares: list[float] | None = None
) -> tuple[Percentiles, Percentiles]:
    """One run -> relay, shadow; what the gateway used of a core is added to `shares`."""
    with ExitStack() as scope:
        folder = Path(scope.enter_context(tempfile.TemporaryDirectory()))
        ports = [free_port(socket.SOCK_DGRAM) for _ in range(2)]
        endpoints = [f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}" for _ in range(2)]
        config = folder / "gateway.toml"
        config.write_text(f'[zenoh]\nendpoint = "{endpoints[0]}"\n{fleet_tables(boats)}')
        live = ["live", f"udpin:127.0.0.1:{ports[0]}", "--silent"]
        live += ["--out", str(folder), "--config", str(config)]
        gateway = scope.enter_context(program([LIVE, *live], "listening on"))
        scope.enter_context(program([RELAY, str(ports[1]), endpoints[0]], "ready"))
        ears = Ears(scope.enter_context(joined(endpoints[0])))
        cpu, begun = cpu_s(gateway.pid), time.monotonic()
        sent = _speak(boats, seconds, ports)
        if shares is not None:
            shares.append((cpu_s(gateway.pid) - cpu) / (time.monotonic() - begun))
        time.sleep(1.0)
        return ears.relayed(sent), ears.shadowed(sent)


def fleet_tables(boats: int) -> str:
    """A `[[boats]]` of the configuration for each: no plan is for others than it names."""
    return "".join(
        f'[[boats]]\nvessel = "{VESSEL}"\nsystem_id = {1 + boat}\nname = "{_name(boat)}"\n'
        for boat in range(boats)
    )


def _name(boat: int) -> str:
    return f"boat-{boat}"


class Sent(NamedTuple):
    """Datagrams of ATTITUDE: time in the frame [ms], boat, moment of sending [ns], to each."""

    boot_ms: NDArray[np.int64]
    boat: NDArray[np.int64]
    shadow_ns: NDArray[np.int64]
    relay_ns: NDArray[np.int64]


def _speak(boats: int, seconds: float, ports: Sequence[int]) -> Sent:
    """Play all boats in real time, each at its own moment of the 20 ms."""
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    shadow, relay = (("127.0.0.1", port) for port in ports)
    voices = [dialect.MAVLink(None, 1 + k, 1) for k in range(boats)]
    rows, begun = [], time.monotonic_ns() + 50_000_000
    for at, k, boat, kind in schedule(boats, seconds):
        boot_ms = FIRST_MS + round(at * 1000.0)
        wait_until(begun + round(at * 1e9))
        for frame in frames_at(voices[boat], at, k, kind):
            moments = [0, 0]
            order = (0, 1) if k % 2 else (1, 0)  # neither is always the first
            for to in order:
                moments[to] = time.monotonic_ns()
                line.sendto(frame, (shadow, relay)[to])
        if kind == 0:
            rows.append((boot_ms, boat, *moments))
    line.close()
    return Sent(*np.array(rows, np.int64).T)


def schedule(boats: int, seconds: float) -> list[tuple[float, int, int, int]]:
    """Moment [s], number of the turn of 20 ms, boat and kind of each message, in order."""
    return sorted(
        (k / RATE_HZ + boat / boats / RATE_HZ + shift, k, boat, kind)
        for k in range(int(seconds * RATE_HZ))
        for boat in range(boats)
        for kind, shift in enumerate((0.0, 0.004, 0.008))
        if kind == 0 or k % 2 == kind - 1 or k == 0
    )


def frames_at(voice: Any, at: float, k: int, kind: int) -> list[bytes]:
    """What a boat says at an entry of the schedule, a datagram each."""
    frames = [pack(voice, _message(kind, FIRST_MS + round(at * 1000.0), at))]
    if kind == 2 and k % 50 <= 1:
        frames.append(pack(voice, dialect.MAVLink_heartbeat_message(11, 3, 128, 0, 4, 3)))
    return frames


def _message(kind: int, boot_ms: int, t: float) -> Any:
    if kind == 0:
        yaw, rate = 0.1 * np.sin(t), 0.1 * np.cos(t)
        return dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, rate)
    if kind == 1:
        # it varies: a velocity that stands still is a frozen sensor, and no model is judged by it
        u, v = 1.0 + 0.1 * np.sin(0.5 * t), 0.1 * np.cos(0.5 * t)
        return dialect.MAVLink_local_position_ned_message(boot_ms, t, 0.0, 0.0, u, v, 0.0)
    return dialect.MAVLink_servo_output_raw_message(boot_ms * 1000, 0, *([1550] * 8))


class Ears:
    """Subscribes to everything; notes when samples came, looks into them later."""

    def __init__(self, session: Any) -> None:
        self._relay: list[tuple[int, bytes]] = []
        self._shadow: list[tuple[int, str, bytes]] = []
        self._scope = [
            session.declare_subscriber("relay", self._relayed),
            session.declare_subscriber("shadow/*/shadow", self._shadowed),
            session.declare_subscriber("shadow/**", zenoh.handlers.RingChannel(1)),
        ]

    def _relayed(self, sample: zenoh.Sample) -> None:
        self._relay.append((time.monotonic_ns(), sample.payload.to_bytes()))

    def _shadowed(self, sample: zenoh.Sample) -> None:
        now = time.monotonic_ns()
        self._shadow.append((now, str(sample.key_expr), sample.payload.to_bytes()))

    def relayed(self, sent: Sent) -> Percentiles:
        """Latencies of the relay."""
        found: dict[tuple[int, int], int] = {}
        decoder = dialect.MAVLink(None)
        for now, raw in self._relay:
            m = decoder.decode(bytearray(raw))
            if m.get_type() == "ATTITUDE":
                found[m.time_boot_ms, m.get_srcSystem() - 1] = now
        return _percentiles(sent, sent.relay_ns, found)

    def shadowed(self, sent: Sent) -> Percentiles:
        """Latencies of the shadow."""
        arrived = [(now, key, json.loads(raw)) for now, key, raw in self._shadow]
        found: dict[tuple[int, int], int] = {}
        for boat in set(sent.boat.tolist()):
            key = f"/{_name(boat)}/"
            mine = [(now, m["vehicle_time_ns"]) for now, heard, m in arrived if key in heard]
            for now, boot_ms in _boot_times(mine, sent, boat):
                found[boot_ms, boat] = now
        return _percentiles(sent, sent.shadow_ns, found)


def _boot_times(arrived: list[tuple[int, int]], sent: Sent, boat: int) -> list[tuple[int, int]]:
    """Samples on the gateway's time -> on the boat's.

    Between the two lies one offset: of those that several samples agree on the one that makes the
    shadow the least late. A gateway that does not keep up repeats others, whole periods off.
    """
    mine = sent.boat == boat
    order, boot = sent.shadow_ns[mine], sent.boot_ms[mine]
    times = np.array([now for now, _ in arrived if now > order[0]], np.int64)
    vehicle = np.array([v for now, v in arrived if now > order[0]], np.int64)
    if not len(times):
        return []
    before = boot[np.searchsorted(order, times) - 1]
    epochs, counts = np.unique(vehicle - before * 1_000_000, return_counts=True)
    epoch = epochs[counts >= min(AGREE, counts.max())][-1]
    boot_ms = np.round((vehicle - epoch) / 1e6).astype(np.int64)
    return list(zip(times.tolist(), boot_ms.tolist(), strict=True))


def _percentiles(
    sent: Sent, moments: NDArray[np.int64], found: dict[tuple[int, int], int]
) -> Percentiles:
    settled = sent.boot_ms > FIRST_MS + SETTLE_S * 1000.0
    sent, moments = Sent(*(column[settled] for column in sent)), moments[settled]
    keys = list(zip(sent.boot_ms.tolist(), sent.boat.tolist(), strict=True))
    late = [
        (found[key] - at) / 1e6
        for key, at in zip(keys, moments.tolist(), strict=True)
        if key in found
    ]
    lost = len(keys) - len(late)
    seconds = (moments[-1] - moments[0]) * 1e-9
    if not late:
        return Percentiles(np.nan, np.nan, np.nan, lost, 0.0)
    p50, p99, worst = np.percentile(late, [50, 99, 100]).tolist()
    return Percentiles(p50, p99, worst, lost, len(late) / seconds)


def joined(endpoint: str) -> zenoh.Session:
    """A session that joins a gateway or router."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    return zenoh.open(config)


def pack(voice: Any, message: Any) -> bytes:
    """One frame; numbers count on."""
    raw: bytes = message.pack(voice)
    voice.seq = (voice.seq + 1) % 256
    return raw


def wait_until(moment_ns: int) -> None:
    """On the clock that never steps."""
    while (left := moment_ns - time.monotonic_ns()) > 0:
        time.sleep(left * 1e-9)


@contextmanager
def program(
    code: Sequence[str], ready: str, heard: list[str] | None = None
) -> Iterator["subprocess.Popen[str]"]:
    """A Python program that runs while inside; inside begins when it says that it is ready.

    What it says from then on goes to `heard`.
    """
    with subprocess.Popen(
        [sys.executable, "-c", *code], cwd=ROOT, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if heard is not None:
                heard.append(line)
            if ready in line:
                break
        else:
            raise SystemExit("it ended before it was ready")
        said: list[str] = [] if heard is None else heard
        drain = threading.Thread(target=said.extend, args=(process.stderr,))
        drain.start()
        try:
            yield process
        finally:
            process.terminate()
            drain.join()


def cpu_s(pid: int) -> float:
    """CPU that a process has used so far [s], without that of its children."""
    stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def free_port(kind: socket.SocketKind) -> int:
    """A port of this machine that nobody uses."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main()
