"""What the benchmark counts is there for every boat: none is counted as lost that is shadowed."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.live_latency import Ears, Sent, fleet_tables
from gateway.config import load_settings
from gateway.live.plans import plans_in


@pytest.mark.parametrize("boats", [1, 20])
def test_each_boat_has_a_plan_of_its_own_and_the_name_it_is_heard_under(
    boats: int, tmp_path: Path
) -> None:
    config = tmp_path / "gateway.toml"
    config.write_text(fleet_tables(boats))
    plans = plans_in(load_settings(config).boats, ())
    assert [plan.system for plan in plans] == [1 + boat for boat in range(boats)]
    assert [plan.key for plan in plans] == [f"boat-{boat}" for boat in range(boats)]


class Mute:
    """A session that hears nothing."""

    def declare_subscriber(self, *_: object) -> None: ...


def sent_twice() -> Sent:
    """Two datagrams of one boat, 20 ms apart."""
    moments = np.array([1_000_000_000, 1_020_000_000])
    return Sent(np.array([20_000, 20_020]), np.zeros(2, np.int64), moments, moments)


def test_a_boat_that_never_came_is_lost_not_a_traceback() -> None:
    ears = Ears(Mute())
    for heard in (ears.shadowed(sent_twice()), ears.relayed(sent_twice())):
        assert heard.lost == 2
        assert np.isnan(heard.p99)
        assert heard.rate == 0.0


def test_a_shadow_is_timed_by_its_own_datagram() -> None:
    ears = Ears(Mute())
    for boot_ms, late_ms in ((20_000, 3), (20_020, 7)):
        now = 1_000_000_000 + (boot_ms - 20_000 + late_ms) * 1_000_000
        payload = b'{"vehicle_time_ns": %d}' % (boot_ms * 1_000_000 + 5)
        ears._shadow.append((now, "shadow/boat-0/shadow", payload))
    heard = ears.shadowed(sent_twice())
    assert (heard.lost, heard.worst) == (0, pytest.approx(7.0))
