"""Two passages of one mission: gaps and lags that were put in are found where they were put in."""

import numpy as np
import pytest

from sim.comparison.missions import Passage, TrackTooShortError, compare_missions

DT = 0.1
LEGS = [(0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0)]


def passage(name="boat", speed=1.0, shift=None, rest_s=20.0, slow=None, channel=1600.0):
    """Legs after a rest; `shift` (leg, m) to starboard of it, `slow` (from, to [m], m/s)."""
    corners = np.array(LEGS)
    along = np.append(0.0, np.hypot(*np.diff(corners, axis=0).T).cumsum())
    s, places = 0.0, [0.0] * round(rest_s / DT)
    while s < along[-1]:
        here = speed if slow is None or not slow[0] <= s < slow[1] else slow[2]
        s += here * DT
        places.append(min(s, along[-1]))
    places += [along[-1]] * 50
    at = np.array(places)
    north, east = (np.interp(at, along, corners[:, k]) for k in (0, 1))
    leg = np.searchsorted(along, at, side="right") - 1
    if shift is not None:
        course = [0.0, np.pi / 2, np.pi, np.pi][shift[0]]
        on = (leg == shift[0]) * np.clip(np.sin(np.pi * (at - along[shift[0]]) / 30.0), 0.0, 1.0)
        north, east = north - shift[1] * on * np.sin(course), east + shift[1] * on * np.cos(course)
    noise = np.random.default_rng(1).normal(0.0, 0.02, (2, len(at)))
    time = DT * np.arange(len(at)) + 1000.0
    pulses = np.where(np.arange(len(at)) % 2, channel, channel + 40.0)
    return Passage(name, time, north + 7.0 + noise[0], east - 3.0 + noise[1], 0.0 * at, {1: pulses})


def test_the_same_passage_does_not_part_wherever_and_whenever_it_began():
    found = compare_missions(passage(), passage("loop", rest_s=60.0))
    assert found.partings == ()
    assert np.abs(found.gap).max() < 0.6
    assert np.abs(found.lag).max() < 1.0
    assert found.first.time[-1] == pytest.approx(110.0, abs=4.0)
    assert found.apart_at_once.max() < 1.0
    assert found.same_mission


@pytest.mark.parametrize("side", [6.0, -6.0])
def test_a_gap_on_one_leg_is_found_on_that_leg_and_side(side):
    found = compare_missions(passage(), passage("loop", shift=(1, side)))
    (parting,) = found.partings
    assert 40.0 <= parting.start < parting.end <= 72.0
    assert parting.gap == pytest.approx(side, abs=0.7)
    assert parting.time == pytest.approx(parting.start, abs=3.0)
    assert compare_missions(passage(), passage("loop", shift=(1, side)), limit=8.0).partings == ()


def test_a_slow_stretch_is_a_lag_and_no_gap():
    found = compare_missions(passage(), passage("loop", slow=(50.0, 60.0, 0.5)))
    assert found.partings == ()
    assert found.lag[-1] == pytest.approx(10.0, abs=1.5)
    assert np.abs(found.lag[found.along < 45.0]).max() < 1.0
    start, end, change = found.slowest
    assert start < 60.0 < end + 15.0
    assert change > 5.0
    assert found.apart_at_once.max() == pytest.approx(10.0, abs=1.5)


def test_another_mission_is_said_to_be_one():
    other = passage("loop")
    other = Passage("loop", other.time, other.east, -other.north, other.yaw_rate)
    assert not compare_missions(passage(), other).same_mission


def test_outputs_are_compared_where_both_drive_them():
    found = compare_missions(passage(), passage("loop", channel=1640.0))
    ((boat, loop),) = found.mean_pulses().values()
    assert loop - boat == pytest.approx(40.0, abs=1.0)
    still = passage("loop")
    still = Passage("loop", *[getattr(still, n) for n in ("time", "north", "east", "yaw_rate")],
                    {1: 0.0 * still.time + 1500.0, 2: still.pulses[1]})  # fmt: skip
    assert compare_missions(passage(), still).mean_pulses() == {}


def test_a_boat_that_never_moves_cannot_be_compared():
    still = passage()
    still = Passage("moored", still.time, 0.0 * still.time, 0.0 * still.time, still.yaw_rate)
    with pytest.raises(TrackTooShortError, match="moored: is never under way"):
        compare_missions(still, passage())
    drift = Passage("drifts", still.time, 0.01 * (still.time - 1000.0), still.east, still.yaw_rate)
    with pytest.raises(TrackTooShortError, match="drifts: 1"):
        compare_missions(drift, passage())
