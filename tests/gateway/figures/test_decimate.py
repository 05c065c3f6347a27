"""Decimation: far fewer points, and nothing that the eye would miss."""

from itertools import pairwise

import numpy as np
import pytest

from gateway.figures import decimated, within, worst_kept


def test_few_points_stay_as_they_are():
    x = np.arange(100.0)
    kept = decimated(x, x, columns=50)
    np.testing.assert_array_equal(kept[0], x)


@pytest.mark.parametrize("seed", range(5))
def test_peaks_pauses_and_ends_survive(seed):
    rng = np.random.default_rng(seed)
    x, y = np.arange(36000.0), rng.normal(size=36000)
    at = rng.integers(0, 36000, 5)
    y[at] = [30.0, -40.0, 50.0, -60.0, 70.0]
    y[12000:12003] = np.nan
    fx, fy = decimated(x, y, columns=500)
    assert len(fx) < 1100
    assert (np.diff(fx) > 0).all()
    assert (fx[0], fx[-1]) == (0.0, 35999.0)
    assert np.isin(x[at], fx).all()
    assert np.isnan(fy).sum() == 1
    edges = np.linspace(0, 36000, 501).astype(int)
    for a, b in pairwise(edges):
        inside = (fx >= a) & (fx < b)
        assert np.nanmax(fy[inside]) == np.nanmax(y[a:b])
        assert np.nanmin(fy[inside]) == np.nanmin(y[a:b])


def test_a_column_of_pauses_alone_is_no_mistake():
    y = np.full(1000, np.nan)
    y[-1] = 1.0
    _, fy = decimated(np.arange(1000.0), y, columns=10)
    assert np.nansum(fy) == 1.0


def test_a_window_reaches_to_its_neighbours():
    x = np.arange(10.0)
    np.testing.assert_array_equal(within(x, x, 3.5, 5.5)[0], [3.0, 4.0, 5.0, 6.0])


def test_the_worst_of_every_run_of_points_is_kept():
    value = np.random.default_rng(1).exponential(size=10000)
    kept = worst_kept(value, 300)
    assert len(kept) == 300
    assert np.argmax(value) in kept
    edges = np.linspace(0, 10000, 301).astype(int)
    assert value[kept][17] == value[edges[17] : edges[18]].max()
