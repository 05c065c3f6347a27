"""Thinning for players: how many rows, which, and how often anything is made."""

import numpy as np
import orjson
import pytest

from gateway.json_rows import TopicRows
from gateway.recording import foxglove
from gateway.recording.foxglove import PlayerRows

HZ, STEP_NS = 10.0, 100_000_000
ROW = {"receive_time_ns": 0, "north_m": 1.0, "east_m": 2.0, "yaw_rad": 0.3}
AXES = ("latitude", "longitude")
BOAT = "foxglove/boat_pose"


def shown(rows: PlayerRows, times, topic="measured", row=ROW, **options):
    """Times of what is shown, by channel."""
    payloads = [orjson.dumps(row | {"receive_time_ns": int(t)}) for t in times]
    stamps = np.asarray(times, np.int64)
    found = rows.of(TopicRows(topic, stamps, stamps, payloads), **options)
    return {s.channel.topic: [int(times[i]) for i in s.rows] for s in found}


def test_the_first_row_of_each_step_is_shown_however_rows_are_packed() -> None:
    times = np.sort(np.random.default_rng(1).integers(0, 100 * STEP_NS, 2000))
    first = [int(times[times // STEP_NS == k][0]) for k in np.unique(times // STEP_NS)]
    assert shown(PlayerRows(HZ), times)[BOAT] == first
    one_by_one = PlayerRows(HZ)
    assert [t for t in times.tolist() if shown(one_by_one, [t])] == first


def test_every_event_is_shown() -> None:
    event = {"severity": "info", "says": "x", "kind": "y"}
    assert shown(PlayerRows(HZ), [5, 6, 7], "event", event) == {"foxglove/log": [5, 6, 7]}


def test_what_players_do_not_know_is_not_looked_at() -> None:
    assert shown(PlayerRows(HZ), [5], "residual") == {}


def test_nothing_is_made_for_channels_that_nobody_wants(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = PlayerRows(HZ)
    only = shown(rows, [5], wanted=lambda channel: channel.topic == BOAT)
    assert set(only) == {BOAT}
    monkeypatch.setattr(TopicRows, "messages", None)  # whoever calls it fails
    monkeypatch.setattr(rows, "_thinning", None)
    assert shown(rows, [5 * STEP_NS], wanted=lambda channel: False) == {}


def test_a_boat_of_several_has_topics_and_frames_of_its_own() -> None:
    places = {f"{who}_{what}_deg": 1.0 for who in ("boat", "shadow") for what in AXES}
    row = ROW | places | {"severity": "info", "says": "x", "kind": "y"}
    for plain in foxglove.CHANNELS:
        own = foxglove.named(plain, "otter-2")
        before, after = plain.convert(row), own.convert(row)
        assert (own.topic, own.schema) == (f"otter-2/{plain.topic}", plain.schema)
        frames = {key for key in before if key.endswith("frame_id")}
        assert frames or plain.schema == "foxglove.Log"
        assert {key: after[key] for key in frames} == {k: f"otter-2/{before[k]}" for k in frames}
        assert {k: v for k, v in after.items() if k not in frames} == {
            k: v for k, v in before.items() if k not in frames
        }
