"""`shadow monitor` as a user and as a program sees it, beside a bus in another process."""

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from gateway.bus import Bus, BusSettings
from gateway.topics import TOPICS
from tests.conftest import ROOT
from tests.gateway.command_line import Run, one_line
from tests.gateway.monitor.statuses import free_endpoint
from tests.gateway.test_schemas import some_message

# A program that a script starts in its background inherits that interrupts are ignored: these tests
# send them wherever they run.
SHADOW = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from gateway.cli import main
main()
"""
PATIENCE_S = 30.0


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


def publish_all(bus: Bus) -> None:
    for topic in TOPICS:
        bus.publish(topic, some_message(topic))


def run(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", SHADOW, "monitor", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S)


def test_once_shows_last_values_that_nobody_heard(endpoint: str) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        publish_all(bus)
        seen = run("--connect", endpoint, "--once")
    assert (seen.returncode, seen.stderr) == (0, "")
    for words in ("otter", "diverges", "missing force", "text"):  # as its health says
        assert words in seen.stdout


@pytest.mark.alone
def test_once_as_json_is_a_line_per_vessel(endpoint: str) -> None:
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        Bus("heron", settings=BusSettings(endpoint)) as other,
    ):
        publish_all(bus)
        publish_all(other)
        seen = run("--connect", endpoint, "--once", "--json")
        one = run("heron", "--connect", endpoint, "--once", "--json")
    lines = [json.loads(line) for line in seen.stdout.splitlines()]
    assert [line["vessel"] for line in lines] == ["heron", "otter"]
    assert [json.loads(line)["vessel"] for line in one.stdout.splitlines()] == ["heron"]
    for line in lines:
        assert line["alive"]
        assert set(line["latest"]) == set(TOPICS)
        assert line["latest"]["measured"] == json.loads(some_message("measured"))
        assert len(line["events"]) == 1


@pytest.mark.parametrize(
    ("words", "status", "says"),
    [
        (("--connect", "tcp/127.0.0.1:1", "--once"), 1, "nobody answers"),
        (("--connect", "harbour", "--once"), 2, "expected tcp/HOST:PORT"),
        (("a/b", "--connect", "tcp/127.0.0.1:1", "--once"), 2, "no name of a vessel"),
        (("--config", "none.json5", "--once"), 2, "no such zenoh configuration file"),
        (("--connect", "tcp/127.0.0.1:1"), 2, "no terminal"),
    ],
)
def test_what_cannot_be_shown_is_one_line(
    run: Run, words: tuple[str, ...], status: int, says: str
) -> None:
    one_line(run("monitor", *words), status, says)


def test_a_gateway_without_the_vessel_is_told_apart_from_none(endpoint: str) -> None:
    with Bus("otter", settings=BusSettings(endpoint)):
        seen = run("heron", "--connect", endpoint, "--once")
    assert seen.returncode == 1
    assert "no vessel heron is there" in seen.stderr


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-c", SHADOW, "monitor", *words]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as running:
        try:
            yield running
        finally:
            running.kill()


@pytest.mark.alone
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_lines_wait_for_the_gateway_and_end_cleanly(endpoint: str, ending: signal.Signals) -> None:
    with started("--connect", endpoint, "--json") as running:
        assert running.stdout is not None
        assert running.stderr is not None
        assert b"nobody answers yet" in running.stderr.readline()
        with Bus("otter", settings=BusSettings(endpoint)) as bus:
            publish_all(bus)
            assert json.loads(running.stdout.readline())["vessel"] == "otter"
            running.send_signal(ending)
            assert running.wait(PATIENCE_S) == 0
        assert running.stderr.read() == b""


def read_until(
    terminal: int, *wanted: bytes, meanwhile: Callable[[], None] = lambda: None
) -> bytes:
    """What is written to a terminal until all that is wanted was there."""
    seen, until = b"", time.monotonic() + PATIENCE_S
    while not all(words in seen for words in wanted):
        assert time.monotonic() < until, f"only {seen[-500:]!r} came"
        meanwhile()
        if select.select([terminal], [], [], 0.5)[0]:
            seen += os.read(terminal, 65536)
    return seen


@pytest.mark.alone
def test_in_a_terminal_it_draws_and_leaves_the_terminal_in_order(endpoint: str) -> None:
    master, slave = pty.openpty()
    command = [sys.executable, "-c", SHADOW, "monitor", "--connect", endpoint]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80", "LINES": "24"}
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        subprocess.Popen(
            command, cwd=ROOT, stdin=slave, stdout=slave, stderr=slave, env=environment
        ) as running,
    ):
        os.close(slave)
        try:
            # again and again: a monitor that takes long to start finds the first values gone stale
            screen = read_until(master, b"missing force", meanwhile=lambda: publish_all(bus))
            running.send_signal(signal.SIGINT)
            screen += read_until(master, b"\x1b[?25h", b"\x1b[?1049l")  # cursor, ordinary screen
            assert running.wait(PATIENCE_S) == 0
        finally:
            running.kill()  # it may be waiting for a terminal that nobody reads any more
    os.close(master)
    assert b"Traceback" not in screen
