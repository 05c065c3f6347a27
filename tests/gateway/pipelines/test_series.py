"""Values that hold until the next one."""

import numpy as np
import pytest

from gateway.shadow import HeldSeries


def held(*pairs: tuple[float, float]) -> HeldSeries:
    return HeldSeries(np.array([t for t, _ in pairs]), np.array([[v] for _, v in pairs]))


def test_a_value_holds_from_its_time_on() -> None:
    values = held((1.0, 5.0), (2.0, 7.0)).at(np.array([0.5, 1.0, 1.9, 2.0, 9.0]))
    assert values[:, 0] == pytest.approx([np.nan, 5.0, 5.0, 7.0, 7.0], nan_ok=True)


def test_mean_weighs_by_time() -> None:
    mean = held((0.0, 1500.0), (0.75, 1900.0)).mean(np.array([0.0, 1.0, 2.0]))
    assert mean[:, 0] == pytest.approx([1600.0, 1900.0])


def test_mean_is_unknown_where_half_of_it_is() -> None:
    series = held((0.0, 1500.0), (0.4, np.nan), (1.2, 1700.0))
    assert series.mean(np.array([0.0, 1.0, 2.0]))[:, 0] == pytest.approx(
        [np.nan, 1700.0], nan_ok=True
    )


def test_mean_before_the_first_value_is_unknown() -> None:
    assert np.isnan(held((5.0, 1.0)).mean(np.array([0.0, 1.0]))).all()
    assert np.isnan(held().values.reshape(0, 1)).all()
    empty = HeldSeries(np.zeros(0), np.zeros((0, 2)))
    assert np.isnan(empty.mean(np.array([0.0, 1.0]))).all()
    assert np.isnan(empty.at(np.array([0.0]))).all()


def test_silence_is_the_gap_around_a_moment() -> None:
    silence = held((0.0, 1.0), (1.0, 1.0), (5.0, 1.0)).silence(np.array([-1.0, 0.5, 3.0, 5.0]))
    assert silence == pytest.approx([np.inf, 1.0, 4.0, np.inf])
