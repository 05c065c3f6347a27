"""Subscribers that vanish, return or do not keep up: the publisher never waits for them."""

import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pytest

from gateway.bus import Bus, BusSettings
from gateway.monitor import VesselStatus, VesselSubscriber, join_bus
from gateway.topics import TOPICS
from tests.conftest import ROOT
from tests.gateway.monitor.statuses import free_endpoint
from tests.gateway.monitor.statuses import wait as wait_s
from tests.gateway.test_schemas import some_message

PATIENCE_S = 60.0  # of a test; zenoh itself looks for a peer that went every four seconds
MESSAGES = {topic: some_message(topic) for topic in TOPICS}
BURST = 20_000  # messages: tens of times what sockets and queues between two processes hold

SUBSCRIBER = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))

def heard(sample):
    print(len(sample.payload), flush=True)
    if "slow" in sys.argv:
        time.sleep(3600.0)

with zenoh.open(config) as session, session.declare_subscriber("shadow/**", heard):
    while True:
        if "asks" in sys.argv:
            session.get("shadow/otter/*", lambda reply: None, timeout=3600.0)
        time.sleep(0.05)
"""

GATEWAY = """
import sys, time
from gateway.bus import Bus, BusSettings
from tests.gateway.monitor.statuses import free_endpoint
from tests.gateway.monitor.statuses import wait as wait_s
from tests.gateway.test_schemas import some_message
with Bus("otter", settings=BusSettings(sys.argv[1])) as bus:
    while True:
        bus.publish("control", some_message("control"))
        time.sleep(0.02)
"""


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@contextmanager
def process(code: str, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python program beside us, gone at the end however it stands."""
    command = [sys.executable, "-c", code, *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as running:
        try:
            yield running
        finally:
            running.kill()


def wait(condition: Callable[[], Any]) -> Any:
    return wait_s(condition, PATIENCE_S)


def published_in_time(bus: Bus, count: int) -> bool:
    """Publish on a thread of its own; zenoh drops a link that blocks after 5 s, so: within 4 s."""
    done = threading.Thread(target=lambda: _publish(bus, count), daemon=True)
    done.start()
    done.join(4.0)
    return not done.is_alive()


def _publish(bus: Bus, count: int) -> None:
    for _ in range(count // len(MESSAGES)):
        for topic, payload in MESSAGES.items():
            bus.publish(topic, payload)


def first_line(subscriber: subprocess.Popen[bytes], bus: Bus) -> None:
    """Publish until the subscriber has heard something: another may have made the bus want it."""
    out = subscriber.stdout
    assert out is not None
    said = MESSAGES["measured"]
    wait(lambda: bus.publish("measured", said) or select.select([out], [], [], 0)[0])
    assert out.readline()


def lines_of(running: subprocess.Popen[bytes]) -> list[bytes]:
    """What a process prints from now on, as it prints it."""
    lines: list[bytes] = []
    out = running.stdout
    assert out is not None

    def read() -> None:
        with suppress(ValueError):  # the pipe is closed below it when the test ends
            lines.extend(out)

    threading.Thread(target=read, daemon=True).start()
    return lines


def test_a_subscriber_that_is_stopped_holds_nobody_up(endpoint: str) -> None:
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        process(SUBSCRIBER, endpoint) as subscriber,
    ):
        first_line(subscriber, bus)
        subscriber.send_signal(signal.SIGSTOP)
        assert published_in_time(bus, BURST)
        assert bus.wants("measured")
        subscriber.send_signal(signal.SIGCONT)


def test_a_subscriber_whose_callback_hangs_holds_nobody_up(endpoint: str) -> None:
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        process(SUBSCRIBER, endpoint, "slow") as subscriber,
    ):
        first_line(subscriber, bus)
        assert published_in_time(bus, BURST)


def test_others_hear_what_is_new_while_one_is_stopped(endpoint: str) -> None:
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        process(SUBSCRIBER, endpoint) as stopped,
        process(SUBSCRIBER, endpoint) as other,
    ):
        for subscriber in (stopped, other):
            first_line(subscriber, bus)
        stopped.send_signal(signal.SIGSTOP)
        assert published_in_time(bus, BURST)
        lines = lines_of(other)
        wait(lambda: bus.publish("event", b"fresh") or b"5\n" in lines)
        stopped.send_signal(signal.SIGCONT)


def test_a_subscriber_that_asks_but_does_not_read_holds_nobody_up(endpoint: str) -> None:
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        process(SUBSCRIBER, endpoint, "slow", "asks") as subscriber,
    ):
        first_line(subscriber, bus)
        assert published_in_time(bus, BURST)
        assert all(published_in_time(bus, len(MESSAGES)) for _ in range(50))


@pytest.mark.alone
def test_a_watcher_sees_a_gateway_killed_and_back(endpoint: str) -> None:
    with process(GATEWAY, endpoint) as gateway:
        session = wait(lambda: join_bus(endpoint, None))
        with session, VesselSubscriber(session) as watcher:
            wait(lambda: heard(watcher) and only(watcher).alive)
            gateway.kill()
            wait(lambda: not only(watcher).alive)
            with process(GATEWAY, endpoint):
                wait(lambda: only(watcher).alive and only(watcher).latest["control"].age_s < 1.0)


def test_a_watcher_gone_and_back_holds_nobody_up(endpoint: str) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        for _ in range(2):
            with process(SUBSCRIBER, endpoint) as subscriber:
                first_line(subscriber, bus)
                subscriber.kill()
                assert published_in_time(bus, BURST)
            wait(lambda: not bus.wants("measured"))


def heard(watcher: VesselSubscriber) -> bool:
    return any("control" in status.latest for status in watcher.statuses())


def only(watcher: VesselSubscriber) -> VesselStatus:
    (status,) = watcher.statuses()
    return status
