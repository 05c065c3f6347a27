"""A replay records what it computed, computes the same again, and shows it to others."""

import json
import socket
import struct
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from mcap.reader import make_reader

from gateway.bus import BusSettings, open_session
from gateway.config import Settings, ZenohSettings, as_tables
from gateway.errors import BadInput
from gateway.offline.replay import (
    CHUNK_S,
    MAX_CHUNK,
    ReplayOptions,
    ReplaySummary,
    _chunk_ends,
    options_by_log,
    replay,
)
from gateway.recording.reader import Recording
from gateway.recording.recorder import RecordingSettings, TopicsKept
from gateway.shadow.model_monitor import JUDGED_ANEW, Adapt
from gateway.topics import TOPICS
from gateway.user_effects import load_effects
from gateway.vessel_file import load_vessel, zenoh_key
from sim.following.follower import FollowerOptions, ReferenceMode
from sim.vessel import AddedEffect, Vessel
from tests.conftest import ROOT
from tests.gateway.ingest.scripted import Script, attitude, heartbeat
from tests.gateway.ingest.test_dataflash import FMT_ITSELF, entry, fmt
from tests.gateway.json_schema import validator_of
from tests.gateway.pipelines.sailing import frames, tlog, voyage
from tests.gateway.test_effect_files import FILE
from tests.sim.vessels import IACQUABOT, RUDDER_BOAT, WAMV

WHOLE = RecordingSettings(topics=TopicsKept.ALL)
UNHEARD = Settings(zenoh=ZenohSettings(publish=False), recording=WHOLE)
OTTER = ROOT / "configs" / "vessels" / "otter.toml"


def options(
    out: Path | None, mode: ReferenceMode = ReferenceMode.AUTO, **more: Any
) -> ReplayOptions:
    following = replace(UNHEARD.following, reference=mode)
    return ReplayOptions(out, settings=replace(UNHEARD, following=following), **more)


def recorded(path: Path) -> dict[str, list[tuple[Any, Any]]]:
    """Topic -> (schema, message) as the mcap library reads it."""
    found = defaultdict(list)
    with path.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            found[channel.topic].append((schema, message))
    return found


def payloads(path: Path) -> dict[str, list[bytes]]:
    return {topic: [m.data for _, m in found] for topic, found in recorded(path).items()}


LATER = {"surroundings", "wind"}  # half a minute must have been seen
ASKED_FOR = {"parameters"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen seconds, with a silence of motion in the middle."""
    return tlog(tmp_path_factory.mktemp("log") / "a.tlog", voyage(14.0, silent=(7.0, 9.5)))


@pytest.fixture(scope="module")
def first(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (path,) = replay(log, WAMV, None, options(tmp_path_factory.mktemp("first"))).recordings
    return path


def test_every_topic_is_recorded_and_every_message_fits_the_schema_in_the_file(first: Path) -> None:
    found = recorded(first)
    assert set(TOPICS) - LATER - ASKED_FOR <= set(found)
    assert not ASKED_FOR & set(found)
    for topic, messages in found.items():
        for schema, message in messages if topic != "mavlink/raw" else []:
            validator_of(schema.data).validate(json.loads(message.data))


def test_numbers_are_followed_where_that_is_asked_for_and_change_nothing_else(
    log: Path, first: Path, tmp_path: Path
) -> None:
    plain = options(tmp_path)
    following = replace(plain.settings.following, adapt=Adapt.WATCH)
    asked = replace(plain, settings=replace(plain.settings, following=following))
    (path,) = replay(log, WAMV, None, asked).recordings
    found = payloads(path)
    messages = [json.loads(data) for data in found.pop("parameters")]
    schema = validator_of(json.dumps(TOPICS["parameters"].json_schema()))
    for message in messages:
        schema.validate(message)
    names = ["thrust left", "thrust right", "drag", "turning damping"]
    assert [message["name"] for message in messages[:4]] == names
    assert {message["applied"] for message in messages} == {1.0}
    assert found == payloads(first)


def test_raw_frames_come_out_byte_for_byte_with_their_receipt(log: Path, first: Path) -> None:
    raw = frames(voyage(14.0, silent=(7.0, 9.5)))
    found = [message for _, message in recorded(first)["mavlink/raw"]]
    assert [message.data for message in found] == [frame[8:] for frame in raw]
    stamps = [int.from_bytes(frame[:8], "big") * 1000 for frame in raw]
    assert [message.log_time for message in found] == stamps


def test_vessel_and_configuration_travel_in_the_file(first: Path, tmp_path: Path) -> None:
    recording = Recording.open(first)
    path = tmp_path / "vessel.toml"
    path.write_bytes(recording.attachments["vessel.toml"].data)
    assert load_vessel(path) == WAMV
    given = options(None).settings
    resolved = replace(given, filter=given.filter.with_parameters({}, "ArduPilot"))
    assert json.loads(recording.attachments["config.json"].data) == json.loads(
        json.dumps(as_tables(resolved))
    )
    assert recording.metadata["shadow"]["vessel"] == "wam-v"


@pytest.mark.usefixtures("plain_laws")
def test_a_plant_and_effects_of_ones_own_travel_too(log: Path, tmp_path: Path) -> None:
    source = tmp_path / "line.py"
    source.write_text(FILE.replace("FACTOR", "1"))
    (effect,) = load_effects(source)
    vessel = WAMV.with_effects(AddedEffect(effect, {"k": 5.0}))
    recording = Recording.open(
        replay(log, vessel, IACQUABOT, options(tmp_path / "out")).recordings[0]
    )
    folder = tmp_path / "unpacked"
    folder.mkdir()
    for name in ("vessel.toml", "plant.toml", "line.py"):
        (folder / name).write_bytes(recording.attachments[name].data)
    own = load_effects(folder / "line.py")
    assert load_vessel(folder / "vessel.toml", own) == vessel
    assert load_vessel(folder / "plant.toml") == IACQUABOT


def test_replaying_twice_gives_the_same_bytes(log: Path, first: Path, tmp_path: Path) -> None:
    (again,) = replay(log, WAMV, None, options(tmp_path)).recordings
    assert again.read_bytes() == first.read_bytes()


def test_replaying_the_recording_reproduces_what_it_holds(first: Path, tmp_path: Path) -> None:
    (again,) = replay(first, WAMV, None, options(tmp_path)).recordings
    assert payloads(again) == payloads(first)


def test_the_speed_of_a_replay_changes_no_state(tmp_path: Path) -> None:
    short = tlog(tmp_path / "short.tlog", voyage(1.5))
    (fast,) = replay(short, WAMV, None, options(tmp_path / "fast")).recordings
    begun = time.monotonic()
    (slow,) = replay(short, WAMV, None, options(tmp_path / "slow", realtime=True)).recordings
    assert time.monotonic() - begun > 1.3
    assert payloads(slow) == payloads(fast)


def test_an_outage_is_told_in_events_and_the_shadow_runs_on(first: Path) -> None:
    found = payloads(first)
    kinds = [json.loads(event)["kind"] for event in found["event"]]
    assert kinds == [
        "started",
        "telemetry_silent",
        "reference_model",
        "telemetry_back",
        "reference_measured",
    ]
    times = [json.loads(row)["vehicle_time_ns"] for row in found["shadow"]]
    assert np.diff(times).max() < 0.5e9
    sources = {json.loads(row)["source"] for row in found["reference"]}
    assert sources == {"measured", "model"}
    assert len(found["measured"]) < len(found["shadow"])


def rebooted(folder: Path, seconds: float, at: float, after: float) -> Path:
    """A log of so many seconds, and of `after` an autopilot booted again at `at`: all [s]."""
    data = tlog(folder / "one.tlog", voyage(seconds)).read_bytes()
    later = tlog(folder / "later.tlog", [(t + at, m) for t, m in voyage(after)]).read_bytes()
    both = folder / "both.tlog"
    both.write_bytes(data + later)
    return both


def test_a_reboot_is_told_once(tmp_path: Path) -> None:
    """`info` counted it; the recording held "telemetry is fresh again" alone."""
    both = rebooted(tmp_path, 20.0, 35.0, 10.0)
    (path,) = replay(both, WAMV, None, options(tmp_path / "out")).recordings
    events = [json.loads(event) for event in payloads(path)["event"]]
    (told,) = [event for event in events if event["kind"] == "reboot"]
    assert told["says"] == "the autopilot rebooted"
    first = events[0]["vehicle_time_ns"]
    assert (told["vehicle_time_ns"] - first) * 1e-9 == pytest.approx(35.0, abs=1.5)


def test_positions_stand_about_the_boats_own_origin(first: Path) -> None:
    row = json.loads(payloads(first)["position"][0])
    assert row["boat_latitude_deg"] == pytest.approx(63.447, abs=1e-3)
    assert row["boat_longitude_deg"] == pytest.approx(10.4, abs=1e-3)


def test_the_summary_tells_how_the_shadow_followed(tmp_path: Path) -> None:
    path = tlog(tmp_path / "whole.tlog", voyage(14.0))
    summary = replay(path, WAMV, None, options(None, ReferenceMode.MEASURED))
    assert summary.recordings == ()
    assert summary.seconds == pytest.approx(13.9, abs=0.15)
    assert (summary.rmse[3:] < [0.03, 0.02, 0.01]).all()
    other = replay(path, WAMV, IACQUABOT, options(None, ReferenceMode.MEASURED))
    assert (other.rmse[3:] < [0.03, 0.02, 0.01]).all()
    assert not np.array_equal(other.rmse, summary.rmse)


def test_another_vessel_misses_another_force(tmp_path: Path) -> None:
    path = tlog(tmp_path / "whole.tlog", voyage(10.0))
    weak = replace(WAMV, dynamics=replace(WAMV.dynamics, X_u=-80.0))
    right, wrong = (replay(path, vessel, None, options(None)) for vessel in (WAMV, weak))
    assert wrong.missing[0] > right.missing[0] + 20.0


def test_what_is_odd_about_a_log_is_noted(log: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.tlog"
    path.write_bytes(log.read_bytes()[:-5])
    assert (
        "the log is cut off at its end: read up to there"
        in replay(path, WAMV, None, options(None)).notes
    )


def test_a_log_that_tells_no_velocity_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    script = Script()
    for k in range(50):
        script.send(0.1 * k, attitude(100.0 + 0.1 * k))
        script.send(0.1 * k, heartbeat())
    path = tmp_path / "a.tlog"
    path.write_bytes(bytes(script.raw))
    with pytest.raises(BadInput, match=r"a\.tlog: nothing in it tells velocity"):
        replay(path, WAMV, None, options(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("plain_laws")
def test_a_plant_that_cannot_be_limited_is_one_line(log: Path) -> None:
    following = replace(UNHEARD.following, follower=FollowerOptions(limits=True))
    limited = ReplayOptions(settings=replace(UNHEARD, following=following))
    with pytest.raises(BadInput, match=r"^rudder boat: "):
        replay(log, WAMV, RUDDER_BOAT, limited)


def test_a_failure_midway_leaves_nothing(log: Path, tmp_path: Path) -> None:
    def fail(share: float) -> None:
        if share > 0.5:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        replay(log, WAMV, None, options(tmp_path / "out"), fail)
    assert list((tmp_path / "out").iterdir()) == []


def test_progress_ends_at_all_of_it(log: Path) -> None:
    told: list[float] = []
    replay(log, WAMV, None, options(None), told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_logs_of_one_name_get_recordings_of_their_own(tmp_path: Path) -> None:
    logs = [Path("a/x.tlog"), Path("b/x.BIN"), Path("y.tlog")]
    assert [o.stem for o in options_by_log(logs, ReplayOptions())] == ["x", "x-2", "y"]


TABLE_COLUMNS = """time = { column = "t", unit = "s" }
[columns]
yaw = { column = "yaw", unit = "rad" }
surge = { column = "u", unit = "m/s" }
sway = { column = "v", unit = "m/s" }
"""
MODES = [ReferenceMode.AUTO, ReferenceMode.MODEL]


def dataflash(times_s: list[float]) -> bytes:
    """A log of a boat that goes straight ahead, of XKF1 alone."""
    columns = "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"
    rows = [
        struct.pack("<QBhhH7f3hi", round(t * 1e6), 0, 0, 0, 0, 1.0, 0, 0, 0, t - 9.0, *[0.0] * 2,
                    *[0] * 4)
        for t in times_s
    ]  # fmt: skip
    head = FMT_ITSELF + fmt(9, "XKF1", "QBccCfffffffccce", columns)
    return head + b"".join(entry(9, row) for row in rows)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "wild", [[1e6], [1e6, 1e6 + 0.1], [4e9], [9e5 + 1e3 * k for k in range(9)]]
)
@pytest.mark.parametrize("suffix", [".BIN", ".csv"])
def test_wild_times_are_no_eternity(
    tmp_path: Path, suffix: str, wild: list[float], mode: ReferenceMode
) -> None:
    """A span of 10⁶ s is 10⁸ steps of the follower if it is simulated; 4·10⁹ s is a century."""
    times = [10.0 + 0.1 * k for k in range(300)]
    times[150 : 150 + len(wild)] = wild
    path = tmp_path / f"wild{suffix}"
    if suffix == ".csv":
        path.write_text("t,yaw,u,v\n" + "".join(f"{t},0,1,0\n" for t in times))
        (tmp_path / "mapping.toml").write_text(TABLE_COLUMNS)
    else:
        path.write_bytes(dataflash(times))
    summary = replay(path, WAMV, None, options(None, mode))
    ticks = 300 * len(wild)  # each silence is filled with at most thirty seconds of ticks
    assert 270 <= summary.rows <= 300 + ticks
    if mode is ReferenceMode.AUTO:
        assert summary.rmse[3] < 0.1


def test_a_vessels_name_becomes_a_key() -> None:
    assert zenoh_key(replace(WAMV, name="Sea Otter #2 (new)")) == "sea-otter--2--new"


@contextmanager
def listener() -> Iterator[tuple[ZenohSettings, list[tuple[str, bytes, str]]]]:
    """A second session on a port that nobody uses, and what it hears."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    heard: list[tuple[str, bytes, str]] = []

    def hear(sample: Any) -> None:
        heard.append((str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)))

    with open_session(BusSettings(endpoint)) as session:
        session.declare_subscriber("shadow/**", hear)
        yield ZenohSettings(endpoint=endpoint), heard


def test_a_second_session_hears_what_is_recorded(tmp_path: Path) -> None:
    path = tlog(tmp_path / "a.tlog", voyage(4.0))
    with listener() as (zenoh, heard):
        settings = replace(UNHEARD, zenoh=zenoh)
        paced = ReplayOptions(tmp_path, realtime=True, name="grebe", settings=settings)
        (recording,) = replay(path, WAMV, None, paced).recordings
    found = payloads(recording)
    due = set(TOPICS) - LATER - ASKED_FOR - {"residual"}  # its longest prediction needs ten seconds
    assert {key for key, _, _ in heard} == {f"shadow/grebe/{topic}" for topic in due}
    for key, payload, encoding in heard:
        topic = key.removeprefix("shadow/grebe/")
        assert encoding == TOPICS[topic].encoding
        assert payload in found[topic]
    shadows = [payload for key, payload, _ in heard if key.endswith("/shadow")]
    assert len(shadows) > 0.8 * len(found["shadow"])


# ---- logs of the shared folder


def otter(path: Path, out: Path | None = None) -> ReplaySummary:
    return replay(path, load_vessel(OTTER), None, options(out, ReferenceMode.MEASURED))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["otter_calm.tlog", "otter_calm.BIN"])
def test_the_shadow_of_the_otter_stays_with_it(shared_data: Path, name: str) -> None:
    summary = otter(shared_data / "sitl" / name)
    assert summary.seconds > 600.0
    assert (summary.rmse[3:] <= [0.02, 0.02, 0.01]).all(), summary.rmse[3:]
    assert (summary.rmse[:2] < 0.3).all(), summary.rmse[:2]


@pytest.mark.slow
def test_the_otters_recording_reproduces_itself(shared_data: Path, tmp_path: Path) -> None:
    whole = (shared_data / "sitl" / "otter_calm.tlog").read_bytes()
    piece = tmp_path / "piece.tlog"
    piece.write_bytes(whole[: len(whole) // 8])
    (first,) = otter(piece, tmp_path / "first").recordings
    (again,) = otter(first, tmp_path / "again").recordings
    assert payloads(again) == payloads(first)


def vessel_of(name: str) -> Vessel:
    return load_vessel(OTTER.with_name(f"{name}.toml"))


@pytest.mark.parametrize(
    "name",
    [*(pytest.param(f"boat_{n}.tlog", marks=pytest.mark.slow) for n in ("calm", "gps")),
     "boat_radio.tlog"],
)  # fmt: skip
@pytest.mark.parametrize("mode", [ReferenceMode.AUTO, ReferenceMode.MEASURED])
def test_the_shadow_stays_finite_and_near_on_every_log(
    shared_data: Path, name: str, mode: ReferenceMode
) -> None:
    summary = replay(shared_data / "sitl" / name, vessel_of("blueboat"), None, options(None, mode))
    assert np.isfinite(summary.rmse).all()
    assert np.isfinite(summary.missing).all()
    assert (summary.rmse[3:] < [0.4, 0.4, 0.5]).all()  # these boats turn at 1.5 rad/s
    # And that is no discontinuity: silences of the link, and once each the sensors that were not
    # ready and what the model lacks.
    assert summary.events < 0.1 * summary.seconds + 8


def test_measurements_that_share_a_receipt_are_not_one_chunk() -> None:
    """The newest receipt stands where the receiver's clock was set back: for hours, perhaps."""
    count = 2 * MAX_CHUNK + 5
    feed: Any = MagicMock(receive_time_ns=np.zeros(count, np.int64))
    feed.__len__.return_value = count
    assert list(_chunk_ends(feed, [], CHUNK_S, None, None)) == [MAX_CHUNK, 2 * MAX_CHUNK, count]


def test_what_was_wrong_before_a_reboot_is_judged_anew_as_it_is_live(tmp_path: Path) -> None:
    """A replay went on with "wrong since" a moment before the reboot, which live takes back."""
    lame = replace(
        WAMV, thrusters=tuple(replace(each, thrust=(-10.0, 15.0)) for each in WAMV.thrusters)
    )
    both = rebooted(tmp_path, 60.0, 70.0, 8.0)
    (path,) = replay(both, lame, None, options(tmp_path / "out")).recordings
    events = [json.loads(event) for event in payloads(path)["event"]]
    kinds = [event["kind"] for event in events]
    assert "model_wrong" in kinds[: kinds.index("reboot")]
    assert kinds[kinds.index("reboot") + 1] == "model_right"
    (right,) = [event for event in events if event["kind"] == "model_right"]
    assert right["says"] == JUDGED_ANEW
    assert right["vehicle_time_ns"] == events[kinds.index("reboot")]["vehicle_time_ns"]
