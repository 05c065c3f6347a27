"""The bus as another process sees it: topics, last values, model, status, a life sign."""

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh import ext

from gateway.bus import Bus, BusSettings, open_session
from gateway.errors import BadInput, ShadowError
from gateway.topics import TOPICS
from tests.conftest import ROOT
from tests.gateway.voyages import event, rows_of

PAYLOAD = rows_of("measured", 1).payloads[0]
PATIENCE_S = 20.0


@pytest.fixture
def endpoint() -> str:
    """An endpoint on a port that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def client(endpoint: str) -> Iterator[Callable[[], zenoh.Session]]:
    """Opens sessions that join the endpoint; all are closed at the end."""
    sessions = []

    def join() -> zenoh.Session:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        sessions.append(zenoh.open(config))
        return sessions[-1]

    yield join
    for session in sessions:
        session.close()


def wait(condition: Callable[[], Any]) -> Any:
    """The first true value of a condition that another process or thread brings about."""
    end = time.monotonic() + PATIENCE_S
    while not (value := condition()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.01)
    return value


def ask(session: zenoh.Session, key: str) -> dict[str, tuple[bytes, str]]:
    """Answers to a query: key -> payload, encoding."""
    samples = [reply.ok for reply in session.get(key, timeout=5.0)]
    return {
        str(sample.key_expr): (sample.payload.to_bytes(), str(sample.encoding))
        for sample in samples
        if sample is not None
    }


SUBSCRIBER = """
import json, sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
with zenoh.open(config) as session:
    with session.declare_subscriber("shadow/**") as subscriber:
        print("ready", flush=True)
        for _ in range(int(sys.argv[2])):
            sample = subscriber.recv()
            print(json.dumps({
                "key": str(sample.key_expr), "encoding": str(sample.encoding),
                "payload": sample.payload.to_string(), "stamped": sample.timestamp is not None,
                "drop": sample.congestion_control == zenoh.CongestionControl.DROP,
            }), flush=True)
"""


def test_another_process_receives_every_topic(endpoint: str) -> None:
    payloads = {"event": event().payloads[0], "control": rows_of("control", 1).payloads[0]}
    payloads["measured"] = PAYLOAD
    command = [sys.executable, "-c", SUBSCRIBER, endpoint, str(len(payloads))]
    with (
        Bus("otter", settings=BusSettings(endpoint)) as bus,
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE) as subscriber,
    ):
        assert subscriber.stdout is not None
        assert subscriber.stdout.readline() == b"ready\n"
        wait(lambda: all(bus.wants(topic) for topic in payloads))
        for topic, payload in payloads.items():
            bus.publish(topic, payload)
        received = [json.loads(line) for line in subscriber.stdout]
    assert {sample["key"].split("/")[-1]: sample["payload"].encode() for sample in received} == (
        payloads
    )
    for sample in received:
        topic = TOPICS[sample["key"].removeprefix("shadow/otter/")]
        assert sample["encoding"] == f"application/json;{topic.schema}"
        assert sample["stamped"]
        assert sample["drop"]


def test_who_asks_gets_the_last_value_though_nobody_listened(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        bus.publish("measured", b"first")
        bus.publish("measured", PAYLOAD)
        answers = ask(client(), "shadow/otter/*")
    encoding = TOPICS["measured"].encoding
    assert answers["shadow/otter/measured"] == (PAYLOAD, encoding)
    assert "shadow/otter/shadow" not in answers  # nothing yet: withheld, not empty


def test_the_first_subscriber_gets_the_last_value_at_once(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        bus.publish("event", b"old")
        bus.publish("event", b"last")
        subscriber = client().declare_subscriber("shadow/otter/event")
        assert wait(subscriber.try_recv).payload.to_bytes() == b"last"


def test_a_later_subscriber_gets_the_last_value_as_history(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        first = client().declare_subscriber("shadow/**")
        wait(lambda: bus.wants("event"))
        bus.publish("event", b"old")
        bus.publish("event", b"last")
        wait(first.try_recv)
        history = ext.HistoryConfig(max_samples=1, detect_late_publishers=True)
        late = ext.declare_advanced_subscriber(client(), "shadow/otter/event", history=history)
        assert wait(late.try_recv).payload.to_bytes() == b"last"


def test_nothing_is_encoded_while_nobody_listens(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    encoded = []

    def message(number: int) -> Callable[[], bytes]:
        def encode() -> bytes:
            encoded.append(number)
            return b"%d" % number

        return encode

    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        assert not bus.wants("measured")
        for number in range(5):
            bus.publish("measured", message(number))
        assert encoded == []
        session = client()
        for _ in range(2):
            assert ask(session, "shadow/otter/measured")["shadow/otter/measured"][0] == b"4"
        assert encoded == [4]


def test_wants_follows_those_who_listen(endpoint: str, client: Callable[[], zenoh.Session]) -> None:
    with Bus("otter", settings=BusSettings(endpoint)) as bus:
        assert not bus.wants("control")
        subscriber = client().declare_subscriber("shadow/*/control")
        wait(lambda: bus.wants("control"))
        assert not bus.wants("measured")
        subscriber.undeclare()
        wait(lambda: not bus.wants("control"))


def test_model_status_and_life_sign(endpoint: str, client: Callable[[], zenoh.Session]) -> None:
    bus = Bus(
        "otter", model=b'name = "otter"', status=lambda: b"{}", settings=BusSettings(endpoint)
    )
    with bus:
        session = client()
        alive = session.liveliness().declare_subscriber("shadow/*/alive", history=True)
        assert ask(session, "shadow/otter/model") == {
            "shadow/otter/model": (b'name = "otter"', "application/toml")
        }
        assert ask(session, "shadow/*/status")["shadow/otter/status"][0] == b"{}"
        sample = wait(alive.try_recv)
        assert (str(sample.key_expr), sample.kind) == ("shadow/otter/alive", zenoh.SampleKind.PUT)
    assert wait(alive.try_recv).kind == zenoh.SampleKind.DELETE


def test_a_second_gateway_joins_the_first(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    with (
        Bus("a", settings=BusSettings(endpoint)) as first,
        Bus("b", settings=BusSettings(endpoint)) as second,
    ):
        subscriber = client().declare_subscriber("shadow/*/control")
        wait(lambda: first.wants("control") and second.wants("control"))
        first.publish("control", b"1")
        second.publish("control", b"2")
        found = {str(wait(subscriber.try_recv).key_expr) for _ in range(2)}
    assert found == {"shadow/a/control", "shadow/b/control"}


def test_a_router_that_holds_the_port_is_joined(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    with zenoh.open(config), Bus("otter", settings=BusSettings(endpoint)) as bus:
        subscriber = client().declare_subscriber("shadow/**")
        wait(lambda: bus.wants("measured"))
        bus.publish("measured", PAYLOAD)
        assert wait(subscriber.try_recv).payload.to_bytes() == PAYLOAD


def test_the_last_gateway_takes_over_the_port_of_those_that_are_gone(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    def alive(asker: zenoh.Session) -> set[str]:
        return {str(reply.ok.key_expr) for reply in asker.liveliness().get("shadow/*/alive")}

    buses = [Bus(name, settings=BusSettings(endpoint)) for name in ("one", "two", "three")]
    for bus in buses:
        bus.__enter__()
    watcher, left = client(), ["one", "two", "three"]
    for bus in buses[:2]:
        wait(lambda: alive(watcher) == {f"shadow/{name}/alive" for name in left})
        bus.__exit__(None, None, None)
        left.pop(0)
        began = time.monotonic()
        wait(lambda: alive(watcher) == {f"shadow/{name}/alive" for name in left})
        assert time.monotonic() - began < 5.0
        assert alive(client()) == {f"shadow/{name}/alive" for name in left}
    buses[2].__exit__(None, None, None)


def test_a_routers_port_is_left_to_the_router(endpoint: str) -> None:
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    router = zenoh.open(config)
    with Bus("otter", settings=BusSettings(endpoint)):
        router.close()
        time.sleep(3.0)  # an heir would have listened by now
        zenoh.open(config).close()


def test_several_vessels_share_a_session(
    endpoint: str, client: Callable[[], zenoh.Session]
) -> None:
    with (
        open_session(BusSettings(endpoint)) as session,
        Bus("a", session=session) as a,
        Bus("b", session=session) as b,
    ):
        a.publish("control", b"1")
        b.publish("control", b"2")
        answers = ask(client(), "shadow/*/control")
    assert {key: payload for key, (payload, _) in answers.items()} == {
        "shadow/a/control": b"1",
        "shadow/b/control": b"2",
    }


def test_a_zenoh_configuration_file_is_passed_through(
    endpoint: str, client: Callable[[], zenoh.Session], tmp_path: Path
) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(
        f'{{mode: "peer", listen: {{endpoints: ["{endpoint}"]}}, '
        "scouting: {multicast: {enabled: false}}}"
    )
    with Bus("otter", settings=BusSettings(config_file=file)) as bus:
        bus.publish("control", b"1")
        assert ask(client(), "shadow/otter/control")


def test_the_port_is_free_again_after_closing(endpoint: str) -> None:
    for _ in range(2):
        with Bus("otter", settings=BusSettings(endpoint)):
            pass
    host, port = endpoint.removeprefix("tcp/").split(":")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((host, int(port)))


def test_a_port_held_by_another_program_is_one_clear_line() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))  # taken, but nobody accepts
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ShadowError, match="can neither listen nor join") as caught:
            Bus("otter", settings=BusSettings(endpoint)).__enter__()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["{", '{mode: "dinghy"}', "{unknown: 1}"])
def test_a_bad_configuration_file_is_one_clear_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(text)
    with pytest.raises(BadInput, match=r"zenoh\.json5: not a zenoh configuration: ") as caught:
        Bus("otter", settings=BusSettings(config_file=file)).__enter__()
    assert "\n" not in str(caught.value)


def test_a_missing_configuration_file_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such zenoh configuration file"):
        Bus("otter", settings=BusSettings(config_file=tmp_path / "none")).__enter__()


@pytest.mark.parametrize("name", ["", "a/b", "*", "a?b"])
def test_a_name_that_is_no_part_of_a_key_is_refused(name: str, endpoint: str) -> None:
    with pytest.raises(BadInput, match="vessel name"):
        Bus(name, settings=BusSettings(endpoint)).__enter__()
