"""Wear: what changes is found with its date, what does not change raises no alarm."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from sim.wear import (
    ALARM,
    EDGE,
    MIN_RECORDINGS,
    WORN,
    Series,
    believed,
    course_of,
    evidence_of,
    scatter_of,
)

N = 20
DAYS = np.linspace(0.0, 95.0, N)


def made(
    seed: int, loss: float = 0.0, kind: str = "", scatter: float = 0.01, n: int = N, wears: int = 0
) -> Series:
    random, days = np.random.default_rng(seed), DAYS[:n]
    level = np.full(n, 50.0)
    if kind == "step":
        level[12:] *= 1.0 - loss
    elif kind == "drift":
        level *= 1.0 - loss * np.maximum(days - 30.0, 0.0) / (days[-1] - 30.0)
    std = np.full(n, 0.25)
    return Series(days, level + random.normal(0.0, np.hypot(std, 50.0 * scatter)), std, wears)


@pytest.mark.parametrize("kind", ["step", "drift"])
def test_a_loss_is_found_with_its_kind_its_date_and_its_size(kind):
    found = evidence_of(made(3, 0.1, kind))
    assert found.p_value < 1e-3
    change = found.change
    assert change.kind == kind
    assert change.share95[0] < -0.1 < change.share95[1] < 0.0
    true = 57.5 if kind == "step" else 30.0  # between the 12th and 13th recording; the 7th
    assert change.moment == pytest.approx(true, abs=2.6 if kind == "step" else 16.0)
    assert change.moment95[0] <= true <= change.moment95[1]
    if kind == "step":  # nobody knows when between two recordings
        assert change.moment95[0] <= DAYS[11]
        assert DAYS[12] <= change.moment95[1]
    assert change.now == pytest.approx(45.0, abs=1.0)


def test_a_size_stands_in_the_middle_of_its_own_interval():
    """A late loss with few recordings: a drift and steps explain it alike, at different sizes."""
    random = np.random.default_rng(240)
    n = random.integers(6, 14)
    days = np.sort(random.uniform(0.0, 300.0, n))
    worn = 1.0 - 0.3 * np.maximum(0.0, days - 100.0) / 200.0
    days_off = random.normal(0.0, 0.02, n) * (1 + 4 * (random.random(n) < 0.1))
    change = evidence_of(Series(days, 100.0 * (worn + days_off), np.full(n, 1.0), -1)).change
    low, high = change.share95
    assert low < change.share < high
    assert change.share - low == pytest.approx(high - change.share)
    assert change.now == pytest.approx(change.before * (1.0 + change.share))


@pytest.mark.slow
@pytest.mark.parametrize("wears", [0, -1])
def test_where_nothing_changes_the_p_value_is_what_it_says(wears):
    series = [made(seed, scatter=0.03, wears=wears) for seed in range(100, 180)]
    p = np.array([evidence_of(one).p_value for one in series])
    assert np.sum(p <= 0.05) <= 9  # 4 expected; more than 9 have a chance of 1 %
    assert 0.3 < p.mean() < 0.7


def test_one_bad_day_decides_nothing(monkeypatch):
    def alarms() -> int:
        count = 0
        for seed in range(12):
            for at in (0, N // 2, N - 1):
                series = made(seed)
                series.value[at] *= 0.6
                count += evidence_of(series).p_value < 0.05
        return count

    assert alarms() <= 8
    monkeypatch.setattr("sim.wear.FAR", 1e9)
    assert alarms() > 8  # where it counts for what it is, it raises them


def test_what_goes_the_way_of_wear_is_clearer(monkeypatch):
    p = {w: evidence_of(made(3, 0.04, "drift", scatter=0.02, wears=w)).p_value for w in (-1, 0, 1)}
    assert p[-1] < p[0] < p[1] < 0.3
    monkeypatch.setattr("sim.wear.WORN", 0.5)
    assert evidence_of(made(3, 0.04, "drift", scatter=0.02, wears=1)).p_value == p[0]
    assert WORN > 0.5


def test_a_drift_is_dated_by_the_recordings_around_its_beginning():
    random = np.random.default_rng(8)
    level = 50.0 - 0.2 * np.maximum(DAYS - 52.0, 0.0)  # between two recordings
    value, std = level + random.normal(0.0, 0.01, N), np.full(N, 0.01)
    for bad in (None, 4, N - 1):  # a day that is far off changes neither its kind nor its dates
        value = value.copy()
        if bad is not None:
            value[bad] -= 20.0
        change = evidence_of(Series(DAYS, value, std)).change
        assert change.kind == "drift"
        if bad is None:
            assert change.moment95[0] <= DAYS[10] < 52.0 < DAYS[11] <= change.moment95[1]
            assert change.moment95[1] - change.moment95[0] <= 3 * (DAYS[1] - DAYS[0])


def test_units_and_signs_do_not_matter():
    one = made(3, 0.1, "step", wears=-1)
    found = evidence_of(one)
    turned = evidence_of(Series(one.time, -1e-3 * one.value, 1e-3 * one.std, -1))
    assert turned.p_value == found.p_value
    assert turned.change.share == pytest.approx(found.change.share)
    assert turned.change.moment == found.change.moment


def test_too_few_recordings_say_nothing():
    assert evidence_of(made(1, n=MIN_RECORDINGS - 1)) is None
    assert evidence_of(made(1, n=MIN_RECORDINGS)) is not None
    same = Series(np.zeros(8), np.arange(8.0), np.ones(8))
    assert evidence_of(same) is None  # all at one time: there is no before and after
    assert EDGE > 1


def test_over_a_fleet_only_what_is_clear_among_all_is_believed():
    steady = [0.03, *np.linspace(0.1, 1.0, 39)]
    assert not believed(steady, [0] * 40).any()
    assert believed([1e-4, *steady], [0] * 41).tolist() == [True] + [False] * 40
    assert believed([0.03], [0]).tolist() == [True]
    assert believed([], []).tolist() == []


def test_what_wears_is_believed_before_others_within_the_same_false_alarms():
    assert believed([0.03, 0.5], [-1, 0]).tolist() == [True, False]
    assert believed([0.03, 0.5], [0, -1]).tolist() == [False, False]
    assert believed([0.03, 0.03], [0, -1]).tolist() == [True, True]  # what is left is the other's
    random = np.random.default_rng(3)
    fleets = random.uniform(size=(20_000, 8))  # p-values where nothing changes
    alarms = sum(believed(p, [-1, -1, 1, 1, 0, 0, 0, 0]).any() for p in fleets)
    assert 0.9 * ALARM < alarms / len(fleets) < 1.06 * ALARM


def test_the_scatter_is_what_the_intervals_do_not_tell():
    random = np.random.default_rng(0)
    value = 50.0 + random.normal(0.0, 1.0, 4000)
    assert scatter_of(value, np.full(4000, 0.6)) == pytest.approx(0.8, rel=0.05)
    assert scatter_of(value, np.full(4000, 2.0)) == 0.0


def test_the_course_is_that_of_a_kalman_smoother():
    series = made(3, 0.1, "drift", scatter=0.02)
    course = course_of(series)
    kalman = KalmanFilter(dim_x=1, dim_z=1)
    kalman.x, kalman.P = np.array([[50.0]]), np.array([[1e8]])
    kalman.F = kalman.H = np.eye(1)
    steps = np.diff(series.time, prepend=series.time[0])
    Q = [np.array([[course.rate**2 * step]]) for step in steps]
    R = [np.array([[std**2 + course.scatter**2]]) for std in series.std]
    x, P, *_ = kalman.batch_filter(series.value[:, None], Qs=Q, Rs=R)
    x, P, *_ = kalman.rts_smoother(x, P, Qs=[*Q[1:], Q[-1]])
    assert course.mean == pytest.approx(x[:, 0, 0], abs=1e-3)
    half = 1.96 * np.sqrt(P[:, 0, 0])
    assert course.high - course.mean == pytest.approx(half, rel=1e-3)


def test_the_course_jumps_where_a_step_is_believed():
    series = made(3, 0.1, "step")
    course = course_of(series, evidence_of(series).change)
    assert course.mean[11] - course.mean[12] == pytest.approx(5.0, abs=1.0)
    assert np.ptp(course.mean[:12]) < 1.0
    assert (course.low < course.mean).all()
    assert (course.mean < course.high).all()
