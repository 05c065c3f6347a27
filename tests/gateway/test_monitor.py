"""`shadow monitor` as a user and as a program sees it, beside a bus in another process."""

import io
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from rich.console import Console

from gateway.bus import Bus, BusSettings, open_session
from gateway.monitor.vessel_view import Latest, VesselPicture, decode
from gateway.monitor.watcher import Watcher, join
from gateway.terminal.monitor import monitor_view
from gateway.topics import TOPICS
from tests.conftest import ROOT
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
SECOND = 1_000_000_000


def message(topic: str, **values: Any) -> dict[str, Any]:
    """A message with all of its fields."""
    return {**json.loads(some_message(topic)), **values}


def picture(name: str = "otter", **changed: dict[str, Any]) -> VesselPicture:
    """A vessel of which everything is known."""
    latest = {topic: Latest(message(topic, **changed.get(topic, {})), 0.1) for topic in TOPICS}
    events = tuple(
        message("event", says=f"event {i}", receive_time_ns=i * SECOND) for i in range(9)
    )
    return VesselPicture(name, True, latest, 50.0, events, 9)


def shown(*pictures: VesselPicture, width: int = 80, height: int | None = None) -> str:
    out = Console(file=io.StringIO(), width=width, height=height or 50, color_system=None)
    out.print(monitor_view(pictures, width, height))
    assert isinstance(out.file, io.StringIO)
    return out.file.getvalue()


@pytest.mark.parametrize("width", [80, 120])
def test_the_picture_tells_state_residual_errors_health_and_events(width: int) -> None:
    text = shown(
        picture(
            measured={"surge_mps": 1.5, "sway_mps": 0.0, "yaw_rate_radps": 0.1, "yaw_rad": -1.5708},
            shadow={"surge_mps": 1.25, "sway_mps": 0.0, "yaw_rate_radps": 0.1},
            residual={"missing_surge_n": -42.5, "missing_surge_n_std": 3.25,
                      "error_surge_mps_10s": -0.77},
            health={"link_age_s": 7.25, "loss": 0.125, "nis": 1.37, "rate_attitude_hz": 31.0},
        ),
        width=width,
    )  # fmt: skip
    told = " ".join(text.replace("│", " ").split())
    for words in (
        "otter", "alive", "50 Hz", "2.92 kn", "heading 270.0°", "boat 1.50 ±0.50", "5.7 ±28.6",
        "shadow 1.25", "boat − shadow 0.25", "error at 10 s -0.77", "missing force -42.5 ±3.2",
        "silent for 7.2 s", "loss 12.5 %", "NIS 1.37", "attitude 31", "event 8", "event 5",
    ):  # fmt: skip
        assert words in told
    assert "event 4" not in told
    assert "…" not in text


@pytest.mark.parametrize("width", [80, 120])
def test_no_line_is_wider_than_the_terminal_and_one_vessel_fits(width: int) -> None:
    lines = shown(picture("a-vessel-with-quite-a-long-name"), width=width).splitlines()
    assert max(len(line) for line in lines) <= width
    assert len(lines) <= 24


def test_many_vessels_get_a_line_each_where_full_pictures_do_not_fit() -> None:
    fleet = [picture(f"boat-{i}") for i in range(5)]
    lines = shown(*fleet, height=24).splitlines()
    assert len(lines) <= 24
    assert sum(line.startswith("boat-") for line in lines) == 5
    assert len(shown(*fleet).splitlines()) > 24


def test_a_vessel_that_is_gone_or_silent_says_so() -> None:
    last = {topic: Latest(message(topic), 12.0) for topic in TOPICS}
    assert "gone" in shown(VesselPicture("otter", False, last, 0.0))
    assert "nothing new for 12 s" in shown(VesselPicture("otter", True, last, 0.0))
    assert "no estimate yet" in shown(VesselPicture("otter", True, {}, 0.0))


def test_a_silent_boat_is_not_compared_with_its_shadow() -> None:
    text = shown(picture(measured={"vehicle_time_ns": 0, "surge_mps": 3.0}))
    (line,) = (line for line in text.splitlines() if "boat − shadow" in line)
    assert "·" in line


@pytest.mark.parametrize("wild", [1e300, -1e300, float("inf"), 1e-300])
def test_absurd_values_stay_in_their_columns(wild: float) -> None:
    fields = [f.name for f in TOPICS["measured"].fields if f.name != "source"]
    changed = dict.fromkeys(fields, wild)
    health = {"receive_time_ns": 2**63 - 1, "nis": wild, "loss": wild}
    text = shown(picture(measured=changed, health=health, event={"receive_time_ns": 2**63 - 1}))
    assert max(len(line) for line in text.splitlines()) <= 80


@pytest.mark.parametrize(
    "payload",
    [
        b"", b"{", b"[]", b"null", b"{}", b'"text"', b"\xff\xfe",
        some_message("event").replace(b'"text"', b"7", 1),
        some_message("measured"),
    ],
)  # fmt: skip
def test_what_is_no_message_is_not_believed(payload: bytes) -> None:
    assert decode("event", payload) is None


def test_numbers_are_numbers() -> None:
    assert decode("measured", some_message("measured")) is not None
    for wrong in ("true", "null", '"1"'):
        text = some_message("measured").replace(b'"surge_mps":0.5', f'"surge_mps":{wrong}'.encode())
        assert decode("measured", text) is None


def test_text_of_others_cannot_command_the_terminal() -> None:
    payload = json.dumps(message("event", says="\x1b[2Jgone\n[red]x")).encode()
    event = decode("event", payload)
    assert event is not None
    assert event["says"] == "?[2Jgone?[red]x"
    assert "[red]x" in shown(VesselPicture("o", True, {}, 0.0, (event,), 1))


def test_events_are_told_once_in_lines_for_programs() -> None:
    now = picture()
    assert [event["says"] for event in now.as_dict(7)["events"]] == ["event 7", "event 8"]
    assert now.as_dict(9)["events"] == ()
    assert len(now.as_dict()["events"]) == 9


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def wait(condition: Callable[[], Any]) -> Any:
    end = time.monotonic() + PATIENCE_S
    while not (value := condition()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.02)
    return value


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
    for words in ("otter", "alive", "missing force", "text"):
        assert words in seen.stdout


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
def test_what_cannot_be_shown_is_one_line(words: tuple[str, ...], status: int, says: str) -> None:
    seen = run(*words)
    assert (seen.returncode, seen.stdout) == (status, "")
    assert says in seen.stderr
    assert len(seen.stderr.splitlines()) == 1


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


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
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


def test_a_watcher_survives_what_others_publish_under_its_keys(endpoint: str) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        session = wait(lambda: join(endpoint, None))
        with session, Watcher(session) as watcher:
            wait(lambda: bus.wants("event"))
            bus.publish("event", b"\xff no json")
            session.put("shadow/otter/unknown", b"{}")
            session.put("shadow/\x1b[2J/event", some_message("event"))
            bus.publish("event", some_message("event"))
            wait(lambda: sum(len(p.events) for p in watcher.pictures()) == 2)
            names = {p.name for p in watcher.pictures()}
    assert names == {"otter", "?[2J"}


def test_a_vessel_that_only_answers_is_asked(endpoint: str) -> None:
    key, payload = "shadow/otter/measured", some_message("measured")
    with open_session(BusSettings(endpoint)) as quiet:
        answer = quiet.declare_queryable(key, lambda query: query.reply(key, payload))
        alive = quiet.liveliness().declare_token("shadow/otter/alive")
        session = wait(lambda: join(endpoint, None))
        with session, Watcher(session) as watcher:
            found = wait(lambda: [p for p in watcher.pictures() if p.latest])
        alive.undeclare()
        answer.undeclare()
    assert found[0].alive
    assert found[0].message("measured") == json.loads(payload)
    assert found[0].age_s() is None


def test_the_example_in_twenty_lines_works(endpoint: str) -> None:
    example = ROOT / "examples" / "subscribe.py"
    text = example.read_text("utf-8")
    assert len(text.splitlines()) <= 20
    assert text in (ROOT / "docs" / "live.md").read_text("utf-8"), "docs/live.md shows another one"
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        subprocess.Popen(
            [sys.executable, str(example), endpoint], stdout=subprocess.PIPE
        ) as running,
    ):
        bus.publish("residual", some_message("residual"))
        assert running.stdout is not None
        says = running.stdout.readline().decode()
        running.kill()
    assert says == "otter: the model lacks 0.5 ± 0.5 N ahead\n"
