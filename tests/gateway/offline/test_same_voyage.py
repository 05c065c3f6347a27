"""One voyage in two recordings is told: it counted twice in `identify`."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.offline.notices import notices_of
from gateway.offline.same_voyage import same_voyage_notices, seconds_alike
from sim.trial import Trial
from tests.sim.voyages import WAM_V, simulated


def turning(seed: int = 0, seconds: float = 200.0, **changes: object) -> Trial:
    """A boat that turns to and fro as that seed says."""
    trial = simulated(WAM_V, seconds)
    rng, nu = np.random.default_rng(seed), trial.nu.copy()
    periods = rng.uniform(8.0, 60.0, 5)
    nu[:, 2] = sum(0.05 * np.sin(2.0 * np.pi * trial.time / p + p) for p in periods)
    return replace(trial, nu=nu, **changes)  # type: ignore[arg-type]


def test_the_same_turns_at_the_same_time_are_one_voyage():
    one = turning(name="radio")
    nu = one.nu + 0.003 * np.random.default_rng(1).standard_normal(one.nu.shape)
    late = one.start_time_ns + 4_200_000_000  # the receiver's clock is off
    other = replace(one, name="board", nu=nu, start_time_ns=late)
    assert seconds_alike(one, other) == pytest.approx(196.0, abs=1.0)
    (text,) = same_voyage_notices([one, other])
    assert text.startswith("radio and board turn alike by the clock for 196 s")
    assert text in notices_of([one, other], WAM_V)


@pytest.mark.parametrize(
    "other",
    [
        turning(seed=1),  # another boat beside it
        turning(start_time_ns=turning().start_time_ns + 3_600_000_000_000),  # the same plan, later
        replace(turning(), nu=np.zeros_like(turning().nu)),  # at anchor
    ],
    ids=["other turns", "another hour", "no turns"],
)
def test_what_only_shares_turns_or_time_is_not(other):
    assert same_voyage_notices([turning(), other]) == []
