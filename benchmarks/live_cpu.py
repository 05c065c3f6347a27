"""What a datagram costs a live gateway: CPU time of its process, whatever else the machine does.

    python -m benchmarks.live_cpu [--boats 20] [--seconds 5] [--runs 5] [--subscribed]

The boats of `benchmarks.live_latency` as datagrams of one frame, through the frame reader and the
gateway's own loop: zenoh open, recording on, on a clock that the datagrams move. No socket, no
second thread that receives. `--subscribed` lets another process subscribe to all topics. Each run
is the same process going on; the least of them is the one that was disturbed least.
"""

import argparse
import socket
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.live_latency import VESSEL, frames_at, free_port, program, schedule
from gateway.config import Settings, ZenohSettings
from gateway.links import Arrival, Datagram, EventReporter, Inbox, LinkCounts
from gateway.links.frame_reader import FrameReader, Peers
from gateway.live.boats import BoatPlan
from gateway.live.gateway import SWITCH_S, Gateway, LiveOptions
from gateway.vessel_file import load_vessel

BEGIN_NS = 1_800_000_000_000_000_000  # the receipt of the first datagram, Unix time
SETTLE_S = 3.0  # left out: keys and files being opened, the first words of all boats
LINK = "replayed"
LISTENER = """
import sys, time
from benchmarks.live_latency import joined
with joined(sys.argv[1]) as session:
    heard = session.declare_subscriber("shadow/**", lambda sample: None)
    print("ready", file=sys.stderr, flush=True)
    while True:
        time.sleep(1.0)
"""


class Cost(NamedTuple):
    """CPU per datagram [µs]: of reading frames, of the loop's thread, of the whole process."""

    reading: float
    loop: float
    process: float


class ReplayedTime:
    """The clock that the gateway reads: as the datagrams say."""

    def __init__(self) -> None:
        self.now_ns = BEGIN_NS

    def __call__(self) -> int:
        return self.now_ns


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boats", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--subscribed", action="store_true")
    options = parser.parse_args()
    sys.setswitchinterval(SWITCH_S)
    costs = measured(options.boats, options.seconds, options.runs, options.subscribed)
    print(f"{options.boats} boats; CPU of a datagram [µs]: reading, loop, whole process")
    for cost in costs:
        print("  ".join(f"{part:7.1f}" for part in cost))
    print("least: " + "  ".join(f"{min(part):.1f}" for part in zip(*costs, strict=True)))


def measured(boats: int, seconds: float, runs: int, subscribed: bool) -> list[Cost]:
    """The cost in each of several runs of one gateway."""
    said = [
        (BEGIN_NS + round(at * 1e9), raw) for at, raw in _said(boats, SETTLE_S + runs * seconds)
    ]
    with ExitStack() as scope:
        folder = Path(scope.enter_context(tempfile.TemporaryDirectory()))
        endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
        clock = ReplayedTime()
        gateway = scope.enter_context(_gateway(boats, folder, endpoint, clock))
        reader = FrameReader(LinkCounts(), Peers(), None, EventReporter(LINK, Inbox()))
        if subscribed:
            scope.enter_context(program([LISTENER, endpoint], "ready"))
        costs = list[Cost]()
        for run in range(-1, runs):
            low = 0.0 if run < 0 else SETTLE_S + run * seconds
            edges = [BEGIN_NS + round(s * 1e9) for s in (low, SETTLE_S + (run + 1) * seconds)]
            part = [item for item in said if edges[0] <= item[0] < edges[1]]
            costs.append(_cost(part, gateway, reader, clock))
            assert not gateway.faults
        return costs[1:]


def _said(boats: int, seconds: float) -> list[tuple[float, bytes]]:
    voices = [dialect.MAVLink(None, 1 + k, 1) for k in range(boats)]
    return [
        (at, raw)
        for at, k, boat, kind in schedule(boats, seconds)
        for raw in frames_at(voices[boat], at, k, kind)
    ]


def _gateway(boats: int, folder: Path, endpoint: str, clock: ReplayedTime) -> Gateway:
    vessel = load_vessel(VESSEL)
    plans = [BoatPlan(vessel, system=1 + k, name=f"boat-{k}") for k in range(boats)]
    settings = Settings(zenoh=ZenohSettings(endpoint=endpoint))
    options = LiveOptions((), folder, silent=True, settings=settings)
    return Gateway(plans, options, clock=clock, steady=clock, strict=True)


def _cost(
    said: list[tuple[int, bytes]], gateway: Gateway, reader: FrameReader, clock: ReplayedTime
) -> Cost:
    """One stretch, as fast as it goes; what reads frames has a thread of its own in the gateway."""
    process, thread = time.process_time(), time.thread_time()
    datagrams = [
        Datagram(LINK, at, reader.read(Arrival(raw, ("127.0.0.1", raw[5]), at))) for at, raw in said
    ]
    read = time.thread_time() - thread
    for datagram in datagrams:
        clock.now_ns = datagram.receive_time_ns
        gateway.turn(datagram)
    gateway.catch_up()
    loop = time.thread_time() - thread - read
    while any(outputs.backlog for outputs in gateway.outputs.values()):
        time.sleep(0.05)
    whole = time.process_time() - process
    return Cost(*(1e6 * part / len(said) for part in (read, loop, whole)))


if __name__ == "__main__":
    main()
