"""The history of live boats holds minutes, not hours, and leaves out what cannot be."""

import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from gateway.figures.style import LIGHT
from gateway.monitor import Latest, VesselStatus
from gateway.studio import live_history
from gateway.studio.live_chart import Chart
from gateway.studio.live_history import BoatHistory, LiveHistory

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
            live.boats() and len(live.boats()[0].velocities_since("measured", 0)) > 5
        ):
            time.sleep(0.01)
        (boat,) = live.boats()
    rows = boat.velocities_since("measured", 0.0)
    assert rows.shape[1] == 4
    assert len(boat.velocities_since("measured", rows[2, 0])) == len(rows) - 3
    assert boat.status.motion()["surge_mps"] == 1.0
    assert boat.velocities_since("shadow", 0.0).shape == (0, 4)


def test_a_moment_that_was_comes_back_as_it_was():
    live = LiveHistory(SimpleNamespace(where="here"))
    for k in range(1000):
        live._take([status(T0 + 0.1 * k)], T0 + 0.1 * k)
    (then,) = live.as_of(T0 + 50.0)
    assert then.status.motion()["east_m"] == pytest.approx(50.0, abs=0.2)
    east, _ = then.tracks["measured"]
    assert (east[0], max(east)) == (0.0, pytest.approx(50.0, abs=0.2))
    rows = then.velocities_since("measured", 0.0)
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
    assert boat.velocities["truth"][-1, 1] == 1.5
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
