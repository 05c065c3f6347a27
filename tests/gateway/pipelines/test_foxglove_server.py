"""The live WebSocket: a client gets what is recorded, nobody costs nothing, trouble is one line."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader

from gateway.config import FoxgloveSettings
from gateway.errors import BadInput, ShadowError
from gateway.json_rows import TopicRows
from gateway.links import LinkEvent, LinkEventKind
from gateway.live.boats import BoatPlan
from gateway.recording import foxglove
from gateway.recording.foxglove_server import STOP_S, BoatView, FoxgloveServer, parse_address
from gateway.recording.recorder import RAW
from gateway.simulated_boat import THIN
from gateway.simulated_boat.play import playing
from gateway.topics import TOPICS
from gateway.vessel_file import dump_vessel
from tests.conftest import ROOT
from tests.gateway.pipelines.aboard import LINK, SETTINGS, Deck, at_ns, datagrams, played
from tests.gateway.pipelines.running import LIVE, PATIENCE_S, boat, free_port, program, wait
from tests.gateway.player import HANGING, Player, player
from tests.gateway.test_layout import paths, topics_of
from tests.sim.vessels import WAMV

SERVED = replace(SETTINGS, foxglove=FoxgloveSettings("0"))  # at any free port
BEGIN_S, SECONDS = 1.5, 36.0  # until the slowest topic speaks
STEP_NS = round(1e9 / SETTINGS.recording.foxglove_hz)


def port_of(deck: Deck) -> int:
    server = deck.gateway._foxglove
    assert server is not None
    return server.port


@dataclass
class Voyage:
    """Two boats, as a player heard them and as the first one was recorded, by topic."""

    heard: Player
    from_ns: int  # from here on the player had subscribed
    schemas: dict[str, tuple[str, str]]  # name, text
    recorded: dict[str, list[tuple[int, bytes]]]

    def since(self, rows: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
        return [row for row in rows if row[0] >= self.from_ns]


def subscribed(view: BoatView) -> bool:
    """Does somebody listen to each topic?"""
    return all(channel.has_sinks() for channel in (*view._topics.values(), *view._known.values()))


def sail(deck: Deck, heard: Player) -> int:
    """Both boats play while the player listens -> the time from which it had subscribed [ns]."""
    # the second speaks first: what is on the command line decides, not who comes first
    boats = [played(SECONDS, rates=THIN, system_id=system) for system in (2, 1)]
    frames = datagrams(*boats)
    begun, from_ns = at_ns(BEGIN_S), 0
    deck.hear(item for item in frames if item.receive_time_ns < begun)
    views = [outlet.view for outlet in deck.gateway.outputs.values()]
    assert len(views) == 2
    wait(lambda: all(view and subscribed(view) for view in views))
    from_ns = (deck.now_ns // STEP_NS + 1) * STEP_NS
    deck.gateway.turn(LinkEvent(LINK, from_ns, LinkEventKind.LOST, "something happened"))
    for second in range(int(SECONDS) + 1):
        since, until = at_ns(BEGIN_S + second), at_ns(BEGIN_S + second + 1)
        deck.hear(item for item in frames if since <= item.receive_time_ns < until)
        newest = deck.heard().payloads["health"][-1]
        wait(lambda newest=newest: newest in [raw for _, raw in heard.messages["health"][-9:]])
    return from_ns


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Voyage:
    out = tmp_path_factory.mktemp("voyage")
    plans = [BoatPlan(WAMV, system=1, name="first"), BoatPlan(WAMV, system=2, name="second")]
    with Deck(plans, out, SERVED) as deck, player(port_of(deck)) as heard:
        from_ns = sail(deck, heard)
    schemas, recorded = {}, defaultdict(list)
    (path,) = out.glob("first-*.mcap")
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if schema is not None and channel.topic != RAW:  # frames are not served
                schemas[channel.topic] = (schema.name, schema.data.decode())
                recorded[channel.topic].append((message.log_time, message.data))
    return Voyage(heard, from_ns, schemas, recorded)


def test_the_server_says_who_it_is_and_takes_nothing(voyage: Voyage) -> None:
    assert voyage.heard.info["name"] == "digital shadow"
    assert voyage.heard.info["capabilities"] == []


def test_topics_and_schemas_are_those_of_the_recording(voyage: Voyage) -> None:
    channels = voyage.heard.channels
    assert voyage.schemas.keys() <= channels.keys()
    for topic, (name, text) in voyage.schemas.items():
        assert channels[topic]["encoding"] == "json"
        assert channels[topic]["schemaEncoding"] == "jsonschema"
        assert channels[topic]["schemaName"] == name
        # a file holds a schema of that name once, in the words of its first topic
        ours, theirs = json.loads(channels[topic]["schema"]), json.loads(text)
        assert ours | {"description": ""} == theirs | {"description": ""}


def test_every_message_fits_the_schema_that_was_advertised(voyage: Voyage) -> None:
    assert len(voyage.heard.messages) > 2 * len(foxglove.CHANNELS) + len(TOPICS)
    for topic, messages in voyage.heard.messages.items():
        schema = json.loads(voyage.heard.channels[topic]["schema"])
        validator = jsonschema.Draft202012Validator(schema)
        for time_ns, raw in messages:
            message = json.loads(raw)
            validator.validate(message)
            assert message.get("receive_time_ns", time_ns) == time_ns


def test_messages_are_those_of_the_recording_thinned_alike(voyage: Voyage) -> None:
    assert {"residual", "surroundings", "foxglove/boat_fix"} < voyage.recorded.keys()
    for topic, rows in voyage.recorded.items():
        assert voyage.since(voyage.heard.messages[topic]) == voyage.since(rows)


def test_another_boat_has_topics_and_frames_of_its_own(voyage: Voyage) -> None:
    channels, messages = voyage.heard.channels, voyage.heard.messages
    own = {topic.removeprefix("second/") for topic in channels if topic.startswith("second/")}
    assert own == {topic for topic in channels if not topic.startswith("second/")}
    frames = [json.loads(raw) for _, raw in messages["second/foxglove/boat_frame"]]
    assert {(m["parent_frame_id"], m["child_frame_id"]) for m in frames} == {
        ("second/world", "second/boat")
    }


def leads_to_a_value(path: str, messages: list[tuple[int, bytes]]) -> bool:
    """Is that field in every message of its topic?"""
    for _, raw in messages:
        value = json.loads(raw)
        for name in path.split(".")[1:]:
            value = value[name]
        assert isinstance(value, int | float | str)
    return bool(messages)


@pytest.mark.parametrize("path", list(paths()))
def test_every_path_of_the_layout_is_in_a_recording_and_comes_live(
    path: str, voyage: Voyage
) -> None:
    topic = path.split(".")[0]
    assert leads_to_a_value(path, voyage.recorded[topic])
    assert leads_to_a_value(path, voyage.heard.messages[topic])


@pytest.mark.parametrize(
    "topic", sorted({*topics_of("map"), *topics_of("3D"), *topics_of("RosOut")})
)
def test_every_topic_of_the_layout_is_in_a_recording_and_comes_live(
    topic: str, voyage: Voyage
) -> None:
    assert voyage.recorded[topic]
    assert voyage.heard.messages[topic]


def test_without_a_client_nothing_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("made for nobody")

    with Deck(settings=SERVED) as deck:
        monkeypatch.setattr("foxglove.Channel.log", never)
        monkeypatch.setattr("gateway.recording.foxglove.RowThinning.of", never)
        heard = deck.hear(datagrams(played(3.0))).heard()
    assert len(heard.payloads["shadow"]) > 100


@pytest.mark.alone
def test_a_running_program_serves_beside_strangers_and_clients_that_hang(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_STREAM)
    with (
        program(tmp_path, "--foxglove", str(port)) as live,
        playing([boat()], f"udpout:127.0.0.1:{live.port}"),
    ):
        assert live.says(f"Foxglove WebSocket on ws://127.0.0.1:{port}")
        with socket.create_connection(("127.0.0.1", port)) as stranger:
            stranger.sendall(b"GET / HTTP/1.1\r\n\r\n")
        with (
            subprocess.Popen([sys.executable, "-c", HANGING, str(port)], cwd=ROOT) as hanging,
            player(port) as heard,
        ):
            wait(lambda: os.waitpid(hanging.pid, os.WUNTRACED | os.WNOHANG)[0])
            count = len(heard.messages["health"])
            wait(lambda: len(heard.messages["health"]) > count + 3)
            shadow = [time_ns for time_ns, _ in heard.messages["shadow"]]
            seconds = live.end(signal.SIGTERM)
            hanging.kill()
    assert live.process.returncode == 0
    assert seconds < 2.0
    assert np.diff(shadow).max() < 1e9
    assert not [line for line in live.told if "handshake" in line or "defect" in line]


def test_a_client_that_does_not_read_holds_nobody_up() -> None:
    """More than sockets and backlog take: `show` returns at once, and so does the end."""
    with FoxgloveServer("0", 10.0) as server:
        view = server.boat("boat", leading=True)
        with subprocess.Popen(
            [sys.executable, "-c", HANGING, str(server.port)], cwd=ROOT
        ) as hanging:
            health = view._topics["health"]
            wait(health.has_sinks)
            health.log(b"{}", log_time=1)
            wait(lambda: os.waitpid(hanging.pid, os.WUNTRACED | os.WNOHANG)[0])
            rows = TopicRows(
                "health", np.zeros(1000, np.int64), np.arange(1000), [b"x" * 600] * 1000
            )
            worst = 0.0
            for _ in range(50):
                begun = time.monotonic()
                view.show([rows])
                worst = max(worst, time.monotonic() - begun)
            rescue = threading.Timer(10.0, hanging.kill)  # or the test itself would hang
            rescue.start()
            begun = time.monotonic()
            server.__exit__()
            ended = time.monotonic() - begun
            rescue.cancel()
            hanging.kill()
    assert worst < 1.0
    assert ended < STOP_S + 1.0


@pytest.mark.alone
def test_a_port_that_is_taken_is_one_line_and_bad_input(tmp_path: Path) -> None:
    (tmp_path / "boat.toml").write_text(dump_vessel(WAMV))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = ["live", f"udpin:127.0.0.1:{free_port()}", "--vessel", str(tmp_path / "boat.toml"),
                 "--no-publish", "--no-record", "--foxglove", str(port)]  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-c", LIVE, *words], cwd=ROOT, capture_output=True, text=True,
            timeout=PATIENCE_S, check=False,
        )  # fmt: skip
    assert done.returncode == BadInput.exit_status
    (error,) = [line for line in done.stderr.splitlines() if not line.startswith("getting ready")]
    assert error == (
        f"error: Foxglove server on 127.0.0.1:{port}: cannot listen there: Address already in use; "
        "is another program using the port?"
    )


@pytest.mark.parametrize("host", ["192.0.2.1", "no.such.host.invalid"])
def test_an_address_that_is_not_ours_is_one_line(host: str) -> None:
    with pytest.raises(
        BadInput, match=f"^Foxglove server on {host}:0: cannot listen there: [^(]+;"
    ):
        FoxgloveServer(f"{host}:0", 10.0).__enter__()


def test_a_library_that_is_missing_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ShadowError, match="pip install foxglove-sdk") as caught:
        FoxgloveServer("0", 10.0).__enter__()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "address"),
    [("8765", ("127.0.0.1", 8765)), ("0.0.0.0:1", ("0.0.0.0", 1)), ("[::1]:9", ("::1", 9))],
)
def test_addresses(text: str, address: tuple[str, int]) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize("text", ["", "localhost", "host:", ":8765", "1.2.3.4:70000", "8765x", "²"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(BadInput, match="expected"):
        parse_address(text)


@pytest.mark.parametrize(("host", "open_to_others"), [("127.0.0.1", False), ("0.0.0.0", True)])
def test_a_server_that_others_can_reach_says_so(host: str, open_to_others: bool) -> None:
    with FoxgloveServer(f"{host}:0", 10.0) as server:
        assert server.text.startswith(f"Foxglove WebSocket on ws://{host}:{server.port}")
        assert ("everyone" in server.text) is open_to_others
