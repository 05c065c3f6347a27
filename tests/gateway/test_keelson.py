"""Keelson's keys and envelopes, read with Keelson's own package as its consumers read them."""

import math
import socket
import sys
import time
from collections.abc import Iterator
from typing import Any

import keelson
import orjson
import pytest
import zenoh

from gateway.bus import Bus, BusSettings, open_session, session_config
from gateway.cli import _with_defaults
from gateway.commands import settings_from
from gateway.config import settings_of
from gateway.errors import BadInput
from gateway.keelson import KNOTS, TOPICS
from tests.gateway.voyages import event, rows_of

PATIENCE_S = 20.0
BOAT, GHOST = "fleet/north/@v0/otter", "fleet/north/@v0/otter_shadow"


@pytest.fixture
def endpoint() -> str:
    """An endpoint on a port that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def message(topic: str, **members: float) -> bytes:
    """A message of a topic with some members set."""
    return orjson.dumps({**orjson.loads(rows_of(topic, 1).payloads[0]), **members})


class Consumer:
    """Listens to everything of a base path, as keelson2mcap does: key -> the decoded payload."""

    def __init__(self, session: zenoh.Session) -> None:
        self.received: dict[str, Any] = {}
        session.declare_subscriber("fleet/north/@v0/*/pubsub/**", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        _, _, payload = keelson.uncover(sample.payload.to_bytes())
        schema = keelson.get_subject_schema(keelson.get_subject_from_pubsub_key(key))
        decoded = keelson.decode_protobuf_payload_from_type_name(payload, schema)
        self.received[key] = decoded

    def wait_for(self, bus: Bus, topic: str, payload: bytes, key: str) -> Any:
        """Publish until it has come: a subscriber is known a moment after it was declared."""
        end = time.monotonic() + PATIENCE_S
        self.received.clear()
        while key not in self.received:
            assert time.monotonic() < end, f"{key} never came; {sorted(self.received)}"
            bus.publish(topic, payload)
            time.sleep(0.02)
        return self.received[key]


@pytest.fixture
def both(endpoint: str) -> Iterator[tuple[Bus, Consumer, zenoh.Session]]:
    """A bus of the vessel otter, and a consumer in a session of its own."""
    settings = BusSettings(endpoint, keelson="fleet/north")
    with (
        open_session(settings) as own,
        zenoh.open(session_config("client", {"connect": [endpoint]})) as other,
        Bus("otter", settings=settings, session=own) as bus,
    ):
        yield bus, Consumer(other), other


def test_a_consumer_decodes_what_the_boat_and_its_shadow_do(both: Any) -> None:
    bus, consumer, session = both
    moving = {"surge_mps": 3.0, "sway_mps": 4.0, "yaw_rad": -0.5, "yaw_rate_radps": 0.1,
              "surge_mps_std": 0.1, "sway_mps_std": 0.1}  # fmt: skip
    sent = message("measured", **moving)
    source = "shadow_gateway/estimate"
    speed = consumer.wait_for(
        bus, "measured", sent, f"{BOAT}/pubsub/course_over_ground_deg/{source}"
    )
    stamp = orjson.loads(sent)["receive_time_ns"]
    assert speed.timestamp.ToNanoseconds() == stamp
    expected = {
        "surge_velocity_mps": 3.0,
        "sway_velocity_mps": 4.0,
        "yaw_rate_degps": math.degrees(0.1),
        "heading_true_north_deg": 360.0 - math.degrees(0.5),
        "speed_over_ground_knots": 5.0 * KNOTS,
        "course_over_ground_deg": math.degrees(-0.5 + math.atan2(4.0, 3.0)),
    }
    for subject, value in expected.items():
        got = consumer.received[f"{BOAT}/pubsub/{subject}/{source}"].value
        assert got == pytest.approx(value, rel=1e-6), subject

    place = {"boat_latitude_deg": 57.6, "boat_longitude_deg": 11.7, "shadow_latitude_deg": 57.7}
    key = f"{BOAT}/pubsub/location_fix/{source}"
    fix = consumer.wait_for(bus, "position", message("position", **place), key)
    assert (fix.latitude, fix.longitude) == (57.6, 11.7)
    ghost = consumer.received[f"{GHOST}/pubsub/location_fix/shadow_gateway/shadow"]
    assert ghost.latitude == 57.7

    key = f"{BOAT}/pubsub/force_newton/shadow_gateway/missing"
    lacking = message("residual", missing_surge_n=-7.0, missing_sway_n=2.0, missing_yaw_nm=5.0)
    force = consumer.wait_for(bus, "residual", lacking, key)
    assert (force.vector.x, force.vector.y, force.frame_id) == (-7.0, 2.0, "body_frd")
    moment = consumer.received[f"{BOAT}/pubsub/moment_newton_meter/shadow_gateway/missing"]
    assert (moment.vector.x, moment.vector.z) == (0.0, 5.0)

    text = event(severity="warning").payloads[0]
    log = consumer.wait_for(bus, "event", text, f"{BOAT}/pubsub/log_message/shadow_gateway/events")
    assert (log.message, log.name) == (orjson.loads(text)["says"], orjson.loads(text)["kind"])
    assert log.level == type(log).WARNING

    alive = {str(reply.ok.key_expr) for reply in session.liveliness().get(f"{BOAT}/pubsub/**")}
    assert keelson.construct_liveliness_key("fleet/north", "otter", source) in alive


def test_no_simulation_comes_under_the_boats_own_keys() -> None:
    """Own-ship speed of any source is measured; the shadow is another entity."""
    shadow = {one.source for f in TOPICS["shadow"] for one in f(orjson.loads(message("shadow")))}
    assert shadow == {"shadow"}


def test_a_boat_that_lies_still_has_no_course() -> None:
    still = orjson.loads(message("measured", surge_mps=0.1, sway_mps=0.0, surge_mps_std=0.06))
    subjects = {one.subject for f in TOPICS["measured"] for one in f(still)}
    assert "speed_over_ground_knots" in subjects
    assert "course_over_ground_deg" not in subjects


@pytest.mark.parametrize(
    ("typed", "published", "base"),
    [
        (["--publish"], True, None),
        (["--publish", "keelson"], True, "keelson"),
        (["--no-publish"], False, None),
    ],
)
def test_publish_says_where(typed: list[str], published: bool, base: str | None) -> None:
    _, where = _with_defaults([*typed, "a.tlog"])[:2]
    zenoh_settings = settings_from(None, None, where).zenoh
    assert (zenoh_settings.publish, zenoh_settings.keelson) == (published, base)
    assert _with_defaults(["replay", *typed, "a.tlog"])[-1] == "a.tlog"


def test_a_base_path_that_is_none_is_refused() -> None:
    with pytest.raises(BadInput, match=r"keelson = 'a/\*': expected a path"):
        settings_of({"zenoh": {"keelson": "a/*"}}, "gateway.toml")


def test_without_its_package_one_line_says_what_to_install(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "keelson", None)
    settings = BusSettings(endpoint, keelson="keelson")
    with pytest.raises(BadInput, match=r"pip install 'shadow-gateway\[keelson\]'"):
        Bus("otter", settings=settings).__enter__()
