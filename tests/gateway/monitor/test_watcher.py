"""Subscribing to vessels: odd publishers, vessels that only answer, and the example for users."""

import json
import subprocess
import sys

import pytest

from gateway.bus import Bus, BusSettings, open_session
from gateway.monitor import VesselSubscriber, join_bus
from tests.conftest import ROOT
from tests.gateway.monitor.statuses import free_endpoint, wait
from tests.gateway.test_schemas import some_message


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


def test_a_subscriber_survives_what_others_publish_under_its_keys(endpoint: str) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        session = wait(lambda: join_bus(endpoint, None))
        with session, VesselSubscriber(session) as subscriber:
            wait(lambda: bus.wants("event"))
            bus.publish("event", b"\xff no json")
            session.put("shadow/otter/unknown", b"{}")
            session.put("shadow/\x1b[2J/event", some_message("event"))
            bus.publish("event", some_message("event"))
            wait(lambda: sum(len(p.events) for p in subscriber.statuses()) == 2)
            names = {p.name for p in subscriber.statuses()}
    assert names == {"otter", "?[2J"}


def test_a_vessel_that_only_answers_is_asked(endpoint: str) -> None:
    key, payload = "shadow/otter/measured", some_message("measured")
    with open_session(BusSettings(endpoint)) as quiet:
        answer = quiet.declare_queryable(key, lambda query: query.reply(key, payload))
        alive = quiet.liveliness().declare_token("shadow/otter/alive")
        session = wait(lambda: join_bus(endpoint, None))
        with session, VesselSubscriber(session) as subscriber:
            found = wait(lambda: [p for p in subscriber.statuses() if p.latest])
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
        line = running.stdout.readline().decode()
        running.kill()
    assert line == "otter: the model lacks 0.5 ± 0.5 N ahead\n"
