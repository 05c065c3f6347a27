"""The live book keeps minutes, not hours, and believes nobody."""

import time
from types import SimpleNamespace

import pytest

from gateway.monitor.vessel_status import Latest, VesselStatus
from gateway.studio import live_history
from gateway.studio.live_history import LiveHistory, Pages

T0 = 1_700_000_000.0


def picture(t: float, name: str = "boat", **more: float) -> VesselStatus:
    motion = {
        "receive_time_ns": int(t * 1e9), "surge_mps": 1.0, "sway_mps": 0.0, "yaw_rate_radps": 0.1,
        "east_m": t - T0, "north_m": 0.0, "yaw_rad": 0.0,
    } | more  # fmt: skip
    return VesselStatus(name, True, {"measured": Latest(motion, 0.0)}, 10.0)


def test_the_same_message_counts_once_and_old_ones_go():
    pages = Pages()
    for k in range(5000):
        pages.take(picture(T0 + 0.1 * (k // 2)))
    rows = list(pages.rows["measured"])
    assert len(rows) == 600
    assert len({row[0] for row in rows}) == 600
    assert len(pages.tracks["measured"]) == 500


def test_a_recording_that_begins_again_begins_the_strip_again():
    pages = Pages()
    pages.take(picture(T0 + 1000.0))
    pages.take(picture(T0))
    assert len(pages.rows["measured"]) == 1


@pytest.mark.parametrize("wrong", [{"east_m": 1e9}, {"surge_mps": -1e8}, {"receive_time_ns": -1}])
def test_what_cannot_be_is_left_out(wrong):
    pages = Pages()
    pages.take(picture(T0, **wrong))
    assert len(pages.rows["measured"]) == 0


def test_it_looks_by_itself_and_pages_get_what_is_new(monkeypatch):
    clock = iter(range(100000))

    class Seen:
        def __init__(self, options, scope):
            pass

        def statuses(self):
            return (picture(T0 + 0.1 * next(clock)),)

    monkeypatch.setattr(live_history, "BusWatcher", Seen)
    monkeypatch.setattr(live_history, "PERIOD_S", 0.005)
    with LiveHistory(SimpleNamespace(where="here")) as book:
        end = time.monotonic() + 10.0
        while time.monotonic() < end and not (
            book.now() and len(book.now()[0].since("measured", 0)) > 5
        ):
            time.sleep(0.01)
        (now,) = book.now()
    rows = now.since("measured", 0.0)
    assert rows.shape[1] == 4
    assert len(now.since("measured", rows[2, 0])) == len(rows) - 3
    assert now.boat()["surge_mps"] == 1.0
    assert now.since("shadow", 0.0).shape == (0, 4)
