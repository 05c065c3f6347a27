"""`shadow replay` of a recording of `shadow live`: as it ran, with the configuration it had."""

from dataclasses import replace
from pathlib import Path

from gateway.offline.replay import ReplayOptions, recorded_settings, replay
from gateway.recording.reader import TICK_LINK, Recording
from gateway.simulated_boat.faults import Faults, Silence
from sim.following.follower import FollowerOptions
from tests.gateway.pipelines.aboard import SETTINGS, Deck, datagrams, played
from tests.sim.vessels import WAMV

TOPICS = ("measured", "reference", "shadow", "control", "residual", "position")


def payloads(path: Path, topic: str) -> list[bytes]:
    return [payload for rows in Recording.open(path).rows(topic) for payload in rows.payloads]


def recorded_live(folder: Path) -> Path:
    wire = played(20.0, faults=Faults(silences=(Silence(9.0, 12.0),)))
    with Deck(out=folder) as deck:
        deck.hear(datagrams(wire), until_s=21.0)
    (path,) = folder.glob("wam-v-*.mcap")
    return path


def test_replay_reproduces_what_ran_live_and_can_be_replayed_again(tmp_path: Path) -> None:
    path = recorded_live(tmp_path)
    for turn in ("once", "twice"):
        options = ReplayOptions(out=tmp_path / turn, settings=SETTINGS)
        (again,) = replay(path, WAMV, options=options).recordings
        for topic in TOPICS:
            assert payloads(again, topic) == payloads(path, topic) != []
        assert TICK_LINK in Recording.open(again).raw().links
        path = again


def test_another_plant_gain_gives_another_shadow(tmp_path: Path) -> None:
    path = recorded_live(tmp_path)
    slack = replace(SETTINGS.following, follower=FollowerOptions(rate=1.0))
    options = ReplayOptions(out=tmp_path / "slack", settings=replace(SETTINGS, following=slack))
    (again,) = replay(path, WAMV, options=options).recordings
    assert payloads(again, "measured") == payloads(path, "measured")
    assert payloads(again, "shadow") != payloads(path, "shadow")


def test_a_recording_knows_its_configuration_and_other_logs_have_none(tmp_path: Path) -> None:
    path = recorded_live(tmp_path)
    told = recorded_settings(path)
    assert told is not None
    assert told.following == SETTINGS.following
    other = tmp_path / "other.tlog"
    other.write_bytes(b"\x00" * 32)
    assert recorded_settings(other) is None
