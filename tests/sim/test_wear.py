"""Wear: what changes is found with its date, what does not change raises no alarm."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from sim.wear import (
    EDGE,
    MIN_RECORDINGS,
    Series,
    believed,
    course_of,
    evidence_of,
    scatter_of,
)

N = 20
DAYS = np.linspace(0.0, 95.0, N)


def made(seed: int, loss: float = 0.0, kind: str = "", scatter: float = 0.01, n: int = N) -> Series:
    random, days = np.random.default_rng(seed), DAYS[:n]
    level = np.full(n, 50.0)
    if kind == "step":
        level[12:] *= 1.0 - loss
    elif kind == "drift":
        level *= 1.0 - loss * np.maximum(days - 30.0, 0.0) / (days[-1] - 30.0)
    std = np.full(n, 0.25)
    return Series(days, level + random.normal(0.0, np.hypot(std, 50.0 * scatter)), std)


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
    assert change.now == pytest.approx(45.0, abs=1.0)


def test_where_nothing_changes_the_p_value_is_what_it_says():
    p = np.array([evidence_of(made(seed, scatter=0.03)).p_value for seed in range(100, 180)])
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


def test_units_and_signs_do_not_matter():
    one = made(3, 0.1, "step")
    found = evidence_of(one)
    turned = evidence_of(Series(one.time, -1e-3 * one.value, 1e-3 * one.std))
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
    assert not believed(steady).any()
    assert believed([1e-4, *steady]).tolist() == [True] + [False] * 40
    assert believed([0.03]).tolist() == [True]
    assert believed([]).tolist() == []


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
