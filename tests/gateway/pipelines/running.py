"""A gateway that really runs: on a thread with real sockets, or as a program of its own."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import orjson
import zenoh

from gateway.live.boats import BoatPlan
from gateway.live.gateway import Gateway, LiveOptions
from gateway.simulated_boat import FAST, SimulatedBoatSettings
from gateway.simulated_boat.boat import SimulatedBoat
from gateway.vessel_file import dump_vessel
from tests.conftest import ROOT
from tests.gateway.pipelines.aboard import SETTINGS, Heard, Listener
from tests.sim.vessels import WAMV

PATIENCE_S = 60.0  # the first start ever compiles
LIVE = "from gateway.cli import run; run()"


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait(condition: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """The first true value of a condition that another thread or process brings about."""
    end = time.monotonic() + patience_s
    while not (value := condition()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.01)
    return value


def boat(**settings: Any) -> SimulatedBoat:
    """One to play in real time, fast from the start."""
    return SimulatedBoat(
        WAMV, SimulatedBoatSettings(**{"rates": FAST, "unix_s": time.time(), **settings})
    )


@contextmanager
def running(
    *endpoints: str, out: Path | None = None, silent: bool = False
) -> Iterator[tuple[Gateway, Callable[[], Heard], list[str]]]:
    """A gateway on a thread: itself, what it publishes of system 1, and what it tells."""
    told: list[str] = []
    failed: list[BaseException] = []
    stop, listener = threading.Event(), Listener()
    options = LiveOptions(endpoints, out, silent=silent, settings=SETTINGS)
    gateway = Gateway([BoatPlan(WAMV)], options, told.append, strict=True)
    found = gateway.fleet._found

    def meet(boat: Any, plan: BoatPlan) -> None:
        found(boat, plan)
        gateway.outputs[boat.boat.system].bus = listener  # type: ignore[assignment]

    def run() -> None:
        try:
            gateway.run(stop)
        except BaseException as error:
            failed.append(error)

    gateway.fleet._found = meet
    with gateway:
        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield gateway, lambda: listener.heard, told
        finally:
            stop.set()
            thread.join()
    if failed:
        raise failed[0]


@dataclass
class Program:
    """`shadow live` as a process."""

    process: subprocess.Popen[str]
    port: int
    endpoint: str  # of zenoh
    out: Path
    told: list[str] = field(default_factory=list)

    @property
    def recordings(self) -> list[Path]:
        """In the order in which they were begun."""
        return sorted(self.out.glob("*.mcap"), key=lambda path: (len(path.name), path.name))

    def says(self, word: str) -> bool:
        """Has it told that?"""
        return any(word in line for line in self.told)

    def end(self, number: int) -> float:
        """Send a signal and wait for the end -> seconds."""
        begun = time.monotonic()
        self.process.send_signal(number)
        self.process.wait(PATIENCE_S)
        return time.monotonic() - begun


@contextmanager
def program(
    folder: Path, *more: str, config: str = "", before: str = "", endpoint: str = ""
) -> Iterator[Program]:
    """Runs while inside; inside begins when it listens."""
    port = free_port()
    endpoint = endpoint or f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    (folder / "boat.toml").write_text(dump_vessel(WAMV))
    recording = 'topics = "all"\n'  # what is published is compared with what is recorded
    recording += "" if "minimum_free_bytes" in config else "minimum_free_bytes = 1\n"
    (folder / "gateway.toml").write_text(
        f'[zenoh]\nendpoint = "{endpoint}"\n[recording]\n{recording}{config}'
    )
    command = [
        "live", f"udpin:127.0.0.1:{port}", "--vessel", str(folder / "boat.toml"),
        "--config", str(folder / "gateway.toml"), "--out", str(folder / "out"), *more,
    ]  # fmt: skip
    process = subprocess.Popen(
        [sys.executable, "-c", before + LIVE, *command],
        cwd=ROOT, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    running = Program(process, port, endpoint, folder / "out")
    reader = threading.Thread(target=_read, args=(running,))
    reader.start()
    try:
        wait(lambda: running.says("listening on") or process.poll() is not None)
        assert process.poll() is None, running.told
        yield running
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        process.wait()
        reader.join()
        assert process.stderr is not None
        process.stderr.close()


def _read(running: Program) -> None:
    assert running.process.stderr is not None
    for line in running.process.stderr:
        running.told.append(line.rstrip())


@contextmanager
def subscribed(endpoint: str, keys: str = "shadow/**") -> Iterator[Callable[[str], list[Any]]]:
    """Joined to a gateway: what came so far of a topic, as objects."""
    came: list[tuple[str, bytes]] = []

    def note(sample: zenoh.Sample) -> None:
        came.append((str(sample.key_expr), sample.payload.to_bytes()))

    def of(topic: str) -> list[Any]:
        return [orjson.loads(raw) for key, raw in list(came) if key.endswith(f"/{topic}")]

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session, session.declare_subscriber(keys, note):
        yield of
