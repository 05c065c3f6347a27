"""Subscribing to vessels: odd publishers, vessels that only answer, and the example for users."""

import json
import subprocess
import sys

import pytest

from gateway.bus import Bus, BusSettings, open_session
from gateway.monitor import JUDGING, Judged, VesselSubscriber, join_bus, judged_in
from sim.monitoring.alarm import ModelEvent
from tests.conftest import ROOT
from tests.gateway.monitor.statuses import SECOND, free_endpoint, message, wait
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


def told(kind: str, second: int) -> bytes:
    """An event of a gateway."""
    return json.dumps(message("event", kind=kind, receive_time_ns=second * SECOND)).encode()


def test_what_was_last_said_of_the_model_is_known_however_late_one_comes(endpoint: str) -> None:
    wrong = json.loads(told("model_explained", 1))
    with Bus(
        "otter",
        status=lambda: json.dumps({"judged": wrong}).encode(),
        settings=BusSettings(endpoint),
    ) as bus:
        for k in range(9):
            bus.publish("event", told("rate_request", 2 + k))
        session = wait(lambda: join_bus(endpoint, None))
        with session, VesselSubscriber(session) as subscriber:
            (late,) = wait(lambda: [s for s in subscriber.statuses() if s.judged])
            wait(lambda: bus.wants("event"))
            assert late.judged == Judged(wrong)
            assert late.to_dict()["judged"] == wrong
            bus.publish("event", told("model_right", 20))
            for k in range(30):
                bus.publish("event", told("rate_request", 21 + k))
            (after,) = wait(lambda: [s for s in subscriber.statuses() if s.event_count > 30])
            bus.publish("event", told("started", 60))
            (anew,) = wait(lambda: [s for s in subscriber.statuses() if s.judged == Judged()])
    assert after.judged is not None
    assert after.judged.event == json.loads(told("model_right", 20))
    assert anew.judged == Judged()


@pytest.mark.parametrize(
    ("answer", "judged"),
    [(b"{}", None), (b"[1]", None), (b"\xff", None), (b'{"judged": {"kind": "model_wrong"}}', None),
     (b'{"judged": null}', Judged())],
)  # fmt: skip
def test_a_status_that_says_nothing_of_the_model_is_none(
    answer: bytes, judged: Judged | None
) -> None:
    assert judged_in(answer) == judged


def test_the_events_that_judge_are_those_of_the_model() -> None:
    assert {event.value for event in ModelEvent} == JUDGING


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
