"""`shadow replay` of a recording of `shadow live`: as it ran, with the configuration it had."""

from dataclasses import replace
from pathlib import Path

import pytest

from gateway.config import Settings, recorded_settings
from gateway.errors import BadInput
from gateway.offline.replay import ReplayOptions, replay
from gateway.recording.reader import Recording
from gateway.recording.recorder import TICK_LINK, Attachment, Recorder
from gateway.simulated_boat import Faults, Silence
from sim.following.follower import FollowerOptions
from tests.gateway.pipelines.aboard import SETTINGS, Deck, datagrams, played
from tests.sim.vessels import WAMV

TOPICS = ("measured", "reference", "shadow", "control", "residual", "position")


def payloads(path: Path, topic: str) -> list[bytes]:
    return [payload for rows in Recording.open(path).rows(topic) for payload in rows.payloads]


@pytest.fixture(scope="module")
def recorded_live(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of twelve seconds with a silence."""
    folder = tmp_path_factory.mktemp("live")
    wire = played(12.0, faults=Faults(silences=(Silence(5.0, 8.0),)))
    with Deck(out=folder) as deck:
        deck.hear(datagrams(wire), until_s=13.0)
    (path,) = folder.glob("wam-v-*.mcap")
    return path


def test_replay_reproduces_what_ran_live_and_can_be_replayed_again(
    recorded_live: Path, tmp_path: Path
) -> None:
    path = recorded_live
    for turn in ("once", "twice"):
        options = ReplayOptions(out=tmp_path / turn, settings=SETTINGS)
        (again,) = replay(path, WAMV, options=options).recordings
        for topic in TOPICS:
            assert payloads(again, topic) == payloads(path, topic) != []
        assert TICK_LINK in Recording.open(again).raw().links
        path = again


def test_another_plant_gain_gives_another_shadow(recorded_live: Path, tmp_path: Path) -> None:
    path = recorded_live
    slack = replace(SETTINGS.following, follower=FollowerOptions(rate=1.0))
    options = ReplayOptions(out=tmp_path / "slack", settings=replace(SETTINGS, following=slack))
    (again,) = replay(path, WAMV, options=options).recordings
    assert payloads(again, "measured") == payloads(path, "measured")
    assert payloads(again, "shadow") != payloads(path, "shadow")


def test_a_recording_knows_its_configuration_and_other_logs_have_none(
    recorded_live: Path, tmp_path: Path
) -> None:
    path = recorded_live
    told = recorded_settings(path)
    assert told is not None
    assert told.following == SETTINGS.following
    other = tmp_path / "other.tlog"
    other.write_bytes(b"\x00" * 32)
    assert recorded_settings(other) is None


def with_config(folder: Path, text: bytes) -> Path:
    """A stranger's recording with a configuration of its own."""
    attached = [Attachment("config.json", "application/json", text)]
    with Recorder(folder / "stranger.mcap", attachments=attached) as recorder:
        recorder.write_raw([b"\xfd"], [1_700_000_000_000_000_000])
    return folder / "stranger.mcap"


def test_where_to_listen_call_and_write_is_never_taken_from_a_recording(tmp_path: Path) -> None:
    path = with_config(
        tmp_path,
        b"""{"zenoh": {"publish": true, "endpoint": "tcp/0.0.0.0:7999", "config_file": "/x"},
        "links": {"endpoints": ["tcp:203.0.113.9:1"]}, "foxglove": {"address": "0.0.0.0:8765"},
        "boats": [{"vessel": "/etc/passwd"}], "recording": {"minimum_free_bytes": 0},
        "studio": {"tiles": "http://203.0.113.9/{Z}/{X}/{Y}"}, "what": 1,
        "following": {"rate_hz": 20.0}, "filter": {"gyro_delay_s": 0.05}}""",
    )
    told = recorded_settings(path)
    assert told is not None
    assert (told.following.rate_hz, told.filter.gyro_delay_s) == (20.0, 0.05)
    plain = Settings()
    for table in ("zenoh", "links", "foxglove", "boats", "recording", "studio"):
        assert getattr(told, table) == getattr(plain, table), table


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b"{", "config.json is damaged: give the configuration with --config"),
        (b"[1]", "config.json is damaged"),
        (b'{"filter": 3}', "config.json: filter"),
        (b'{"filter": {"gyro_delay_s": 1e308}}', "gyro_delay_s = 1e+308: expected"),
        (b"[" * 100_000, "config.json is damaged"),
    ],
)
def test_a_damaged_configuration_in_a_recording_is_one_line(
    tmp_path: Path, text: bytes, says: str
) -> None:
    with pytest.raises(BadInput) as caught:
        recorded_settings(with_config(tmp_path, text))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
