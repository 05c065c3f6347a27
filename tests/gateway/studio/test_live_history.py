"""The history of live boats holds minutes, not hours, and leaves out what cannot be."""

import time
from types import SimpleNamespace

import pytest

from gateway.monitor import Latest, VesselStatus
from gateway.studio import live_history
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
