"""What the benchmark counts is there for every boat: none is counted as lost that is shadowed."""

import numpy as np
import pytest

from benchmarks import live_latency
from benchmarks.live_latency import Ears, Sent, one_run


class Mute:
    """A session that hears nothing."""

    def declare_subscriber(self, *_: object) -> None: ...


def test_each_boat_of_several_is_shadowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_latency, "SETTLE_S", 2.0)
    boats, seconds = 3, 5.0
    relay, shadow = one_run(boats, seconds)
    sent = boats * live_latency.RATE_HZ * (seconds - 2.0)
    assert relay.lost + shadow.lost < 0.5 * sent / boats  # a boat without a shadow is a third


def test_a_boat_that_never_came_is_lost_not_a_traceback() -> None:
    ears = Ears(Mute())
    moments = np.array([0, 20_000_000])
    sent = Sent(np.array([20_000, 20_020]), np.zeros(2, np.int64), moments, moments)
    for heard in (ears.shadowed(sent), ears.relayed(sent)):
        assert heard.lost == 2
        assert np.isnan(heard.p99)
        assert heard.rate == 0.0
