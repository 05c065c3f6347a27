"""The history of live boats holds minutes, not hours, and leaves out what cannot be."""

import os
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.figures import LIGHT
from gateway.monitor import Latest, VesselStatus
from gateway.recording.reader import Recording
from gateway.recording.recorder import Attachment, RecordingFile
from gateway.recording.writer import Compression
from gateway.shadow.topic_rows import LIVE, METADATA
from gateway.studio import live_history
from gateway.studio.access import Folders
from gateway.studio.live_chart import Chart, Strips
from gateway.studio.live_history import BoatHistory, LiveHistory, freeze_task, growing_recording
from gateway.studio.pages.live import LivePage, sentence_of
from gateway.studio.session import Session
from tests.conftest import ROOT
from tests.gateway.studio.pages import context_of, message_of

T0 = 1_700_000_000.0


def status(t: float, name: str = "boat", **more: float) -> VesselStatus:
    motion = {
        "receive_time_ns": int(t * 1e9), "surge_mps": 1.0, "sway_mps": 0.0, "yaw_rate_radps": 0.1,
        "east_m": t - T0, "north_m": 0.0, "yaw_rad": 0.0,
    } | more  # fmt: skip
    return VesselStatus(name, True, {"measured": Latest(motion, 0.0)}, 10.0)


def test_the_same_message_counts_once_and_old_ones_go():
    history = BoatHistory()
    for k in range(5000):
        history.add(status(T0 + 0.1 * (k // 2)))
    rows = list(history.rows["measured"])
    assert len(rows) == 600
    assert len({row[0] for row in rows}) == 600
    assert len(history.tracks["measured"]) == 500


def test_a_recording_that_begins_again_begins_the_strip_again():
    history = BoatHistory()
    history.add(status(T0 + 1000.0))
    history.add(status(T0))
    assert len(history.rows["measured"]) == 1


@pytest.mark.parametrize("wrong", [{"east_m": 1e9}, {"surge_mps": -1e8}, {"receive_time_ns": -1}])
def test_what_cannot_be_is_left_out(wrong):
    history = BoatHistory()
    history.add(status(T0, **wrong))
    assert len(history.rows["measured"]) == 0


def test_it_looks_by_itself_and_pages_get_what_is_new(monkeypatch):
    clock = iter(range(100000))

    class Watcher:
        def __init__(self, options, scope):
            pass

        def statuses(self):
            return (status(T0 + 0.1 * next(clock)),)

    monkeypatch.setattr(live_history, "BusWatcher", Watcher)
    monkeypatch.setattr(live_history, "PERIOD_S", 0.005)
    with LiveHistory(SimpleNamespace(where="here")) as live:
        end = time.monotonic() + 10.0
        while time.monotonic() < end and not (
            live.boats() and len(live.boats()[0].rows_since("measured", 0)) > 5
        ):
            time.sleep(0.01)
        (boat,) = live.boats()
    rows = boat.rows_since("measured", 0.0)
    assert rows.shape[1] == 4
    assert len(boat.rows_since("measured", rows[2, 0])) == len(rows) - 3
    assert boat.status.motion()["surge_mps"] == 1.0
    assert boat.rows_since("shadow", 0.0).shape == (0, 7)


def test_a_moment_that_was_comes_back_as_it_was():
    live = LiveHistory(SimpleNamespace(where="here"))
    for k in range(1000):
        live._take([status(T0 + 0.1 * k)], T0 + 0.1 * k)
    (then,) = live.as_of(T0 + 50.0)
    assert then.status.motion()["east_m"] == pytest.approx(50.0, abs=0.2)
    east, _ = then.tracks["measured"]
    assert (east[0], max(east)) == (0.0, pytest.approx(50.0, abs=0.2))
    rows = then.rows_since("measured", 0.0)
    assert rows[-1, 0] == pytest.approx(T0 + 50.0, abs=0.2)
    assert live.as_of(T0 - 1.0) == ()
    assert live.boats()[0].status.motion()["east_m"] > 99.0


def in_the_loop(t: float, moved: float = 0.0) -> VesselStatus:
    """`status` with a truth whose home lies 30 m west and 7 m south of the autopilot's origin."""
    given = status(t, east_m=1.0 * (t - T0) + moved)
    m = given.latest["measured"].message
    truth = {**m, "east_m": m["east_m"] + 30.0, "north_m": 7.0, "surge_mps": 1.5, "yaw_rad": 0.2}
    return replace(given, latest={**given.latest, "truth": Latest(truth, 0.0)})


def test_the_truth_of_a_boat_in_the_loop_is_laid_where_the_boat_was_first_known():
    history = BoatHistory()
    for k in range(100):
        given = in_the_loop(T0 + 0.1 * k)
        history.add(given)
    boat = history.boat(given)
    assert boat.truth_origin == pytest.approx((-30.0, -7.0))
    assert boat.placed("truth")["east_m"] == pytest.approx(boat.placed("measured")["east_m"])
    assert boat.placed("truth")["yaw_rad"] == 0.2
    assert boat.rows["truth"][-1, 1] == 1.5
    assert boat.tracks["truth"] == (pytest.approx(boat.tracks["measured"][0]), [0.0] * 20)
    off = in_the_loop(T0 + 10.0)
    off.latest["measured"].message["east_m"] += 0.8  # the estimate drifts: the truth does not
    history.add(off)
    assert history.boat(off).placed("truth")["east_m"] == pytest.approx(10.0)


def test_firmware_that_begins_anew_lays_the_truth_anew():
    history = BoatHistory()
    for k in range(100):
        history.add(in_the_loop(T0 + 0.1 * k))
    again = in_the_loop(T0 + 10.0, moved=-12.0)
    again.latest["truth"].message["east_m"] = 0.0
    history.add(again)
    assert history.truth_origin == pytest.approx((-2.0, -7.0))
    assert len(history.tracks["truth"]) == 1


def test_the_chart_and_its_legend_show_a_truth_only_where_there_is_one():
    chart, loop, sea = Chart(LIGHT), BoatHistory(), BoatHistory()
    loop.add(in_the_loop(T0))
    sea.add(status(T0))
    for boat, there in ((loop.boat(in_the_loop(T0)), True), (sea.boat(status(T0)), False)):
        chart.show((boat,))
        assert bool(chart._hulls["truth"].data["xs"]) is there
        shown = [i.label.value for i in chart.figure.legend[0].items if i.visible]
        assert ("truth" in shown) is there


def test_a_boat_at_sea_has_no_truth():
    history = BoatHistory()
    history.add(status(T0))
    boat = history.boat(status(T0))
    assert boat.truth_origin is None
    assert boat.placed("truth") is None
    assert boat.tracks["truth"] == ([], [])
    assert boat.placed("measured") is not None


def lacks(t: float, force: float = 30.0, **more: float) -> dict[str, float]:
    names = ("missing_surge_n", "missing_sway_n", "missing_yaw_nm")
    return {"receive_time_ns": int(t * 1e9), **dict.fromkeys(names, force),
            **{f"{name}_std": 4.0 for name in names}} | more  # fmt: skip


def test_the_missing_force_is_kept_over_time_and_what_cannot_be_is_not():
    history = BoatHistory()
    for k in range(3):
        latest = {"residual": Latest(lacks(T0 + k, 10.0 * k), 0.0)}
        history.add(VesselStatus("boat", True, latest, 10.0))
    latest = {"residual": Latest(lacks(T0 + 9.0, missing_yaw_nm_std=1e300), 0.0)}
    history.add(VesselStatus("boat", True, latest, 10.0))
    boat = history.boat(status(T0))
    rows = boat.rows_since("residual", T0)
    assert rows[:, 1].tolist() == [10.0, 20.0]
    strips = Strips(LIGHT)
    strips.show(boat)
    drawn = strips._sources["residual"].data
    assert drawn["Y"].tolist() == [0.0, 10.0, 20.0]
    assert drawn["N_low"].tolist() == [-8.0] * 3
    assert drawn["N_high"].tolist() == [8.0] * 3


@pytest.mark.parametrize(
    ("followed", "across", "corners"),
    [
        ("one", 100.0, [(-50.0, 50.0), (50.0, -50.0)]),
        ("two", 40.0, [(480.0, 520.0), (20.0, -20.0)]),
        ("nobody", 100.0, [(-25.0, 525.0), (20.0, -20.0)]),
        ("one", 0.0, [(-25.0, 525.0), (20.0, -20.0)]),
    ],
)
def test_the_chart_shows_the_boat_that_is_followed_else_all(followed, across, corners):
    boats = []
    for name, east in (("one", 0.0), ("two", 500.0)):
        history, seen = BoatHistory(), status(T0, name, east_m=east)
        history.add(seen)
        boats.append(history.boat(seen))
    chart = Chart(LIGHT)
    chart.show(tuple(boats), followed, across)
    shown = chart._corners.data
    (west, east), (north, south) = corners
    assert sorted(shown["x"]) == [west, east]
    assert sorted(shown["y"]) == [south, north]
    assert [r.data_source for r in chart.figure.x_range.renderers] == [chart._corners]


def said(kind: str, at: float, text: str = "") -> dict[str, object]:
    return {"kind": kind, "severity": "warning", "says": text, "receive_time_ns": int(at * 1e9)}


@pytest.mark.parametrize(
    ("events", "alive", "expected"),
    [
        ([said("model_wrong", T0 + 1.0, "wrong")], True, "wrong"),
        ([said("model_wrong", T0 + 1.0, "wrong"), said("model_explained", T0 + 2.0, "a current"),
          said("jump", T0 + 3.0)], True, "a current"),
        ([said("model_wrong", T0 + 1.0), said("model_right", T0 + 2.0)], True, None),
        ([said("model_wrong", T0 + 1.0)], False, None),
        ([said("model_wrong", T0 - 9.0)], True, None),
        ([said("jump", T0 + 1.0)], True, None),
    ],
)  # fmt: skip
def test_the_banner_says_what_holds_now_of_a_boat_that_is_heard(events, alive, expected):
    history = BoatHistory()
    history.remember(T0, VesselStatus("boat", False, {}, 0.0))  # an earlier run of the gateway
    latest = status(T0 + 5.0).latest
    now = VesselStatus("boat", alive, latest, 10.0, tuple(events), len(events))
    assert sentence_of(history.boat(now)) == expected


def live_recording(folder: Path, name: str, seconds: int, vessel: bytes = b"name = 'x'") -> Path:
    """A recording as the gateway writes it, not finished: a parameter, then ten frames a second."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    file = folder / f"{name}-20260101-120000.mcap"
    with file.open("wb") as stream:
        recording = RecordingFile(stream, Compression.LZ4, 10_000)
        attached = Attachment("vessel.toml", "application/toml", vessel)
        recording.start([attached], {METADATA: {"vessel": name, LIVE: "yes"}})
        begun = int(T0 * 1e9)
        for k in range(10 * seconds):
            message = (
                dialect.MAVLink_param_value_message(b"SERVO1_FUNCTION", 73.0, 9, 1, 0)
                if k == 0 else
                dialect.MAVLink_attitude_message(100 * k, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
            )  # fmt: skip
            at = np.array([begun + k * 100_000_000])
            recording.write(recording.raw("udp"), at, at, [message.pack(mav)])
        recording.flush()
    return file


def test_the_last_minutes_of_a_growing_recording_are_kept_with_its_parameters(tmp_path):
    other, file = live_recording(tmp_path, "other", 1), live_recording(tmp_path, "boat", 400)
    assert growing_recording("boat", [other, file]) == file
    found = freeze_task(lambda _: None, str(file), str(tmp_path / "out"))
    assert found.vessel == "name = 'x'"
    raw = Recording.open(found.file).raw()
    assert len(raw) == 3001 + 1
    assert int(raw.receive_time_ns[0]) == int(T0 * 1e9)  # the parameter, from before
    assert int(np.ptp(raw.receive_time_ns[1:])) == 300 * 10**9
    assert sorted(tmp_path.glob("out/*")) == [found.file]
    assert not Recording.open(file).finished  # the gateway's own is as it was


@pytest.mark.slow
def test_diagnose_this_takes_the_gateways_vessel_and_its_last_minutes_and_opens_diagnose(tmp_path):
    vessel = (ROOT / "configs/vessels/demo_boat.toml").read_bytes()
    live_recording(tmp_path, "boat", 20, vessel)
    session = Session(Folders.of([], [tmp_path], tmp_path / "out"), (), None)
    page = LivePage(context_of(session))
    try:
        page._banners._diagnose("ghost")
        assert "no recording of it grows" in message_of(page)
        page._banners._diagnose("boat")
        assert message_of(page) == ""
        end = time.monotonic() + 60.0
        while not page._opens and time.monotonic() < end:
            session.update()
            time.sleep(0.1)
        assert page._opens
        (log,) = session.logs
        assert log.name.startswith("boat-20260101-120000-until-")
        assert session.version.text.encode() == vessel
        assert session.slow.job == "diagnose"
    finally:
        session.close()


def test_without_a_growing_recording_it_is_said_where_one_is_looked_for(tmp_path):
    file = live_recording(tmp_path, "boat", 1)
    (tmp_path / "torn.mcap").write_bytes(b"no recording")
    for name, age in (("boat", 60.0), ("ghost", 0.0)):
        os.utime(file, (time.time() - age,) * 2)
        with pytest.raises(BadInput, match=f"{name}: no recording of it grows .* --folder"):
            growing_recording(name, [tmp_path / "torn.mcap", file])
