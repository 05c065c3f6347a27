"""filterpy says the same: filter and smoother agree with it to 1e-9."""

from functools import cache

import numpy as np
import pytest

from gateway.estimation import FilterSettings, Flag, MeasurementKind
from gateway.estimation.filter import Estimator
from gateway.estimation.smoother import smooth
from tests.gateway.estimation import oracle

SETTINGS = FilterSettings(prior_position_m=30.0, gate_probability=1 - 1e-15, velocity_error_mps=0.1)
EVENTS = 400


def started(events):
    """The events from the first yaw on: before it the filter does not move."""
    return events[np.argmax(events.kind == MeasurementKind.YAW) :]


@cache
def filtered_by_filterpy():
    """Events, and what filterpy makes of them."""
    events = started(oracle.random_events(np.random.default_rng(2), EVENTS))
    return events, oracle.run(events, SETTINGS)


@pytest.mark.parametrize("body", [False, True])
def test_filter_agrees_with_filterpy(body):
    events = started(oracle.random_events(np.random.default_rng(1), EVENTS, body))
    expected = oracle.run(events, SETTINGS)
    estimator = Estimator(SETTINGS)
    _, rows = estimator.advance(estimator.start(), events, covariance=True)
    assert not rows.has(Flag.GATED).any()
    assert set(events.kind) >= {
        MeasurementKind.TICK,
        MeasurementKind.YAW,
        MeasurementKind.YAW_RATE,
        MeasurementKind.POSITION,
    }
    np.testing.assert_allclose(rows.motion, expected.x[:, :9], rtol=1e-9, atol=1e-9)
    P = oracle.with_heading_error(expected.x[:, :9], expected.P[:, :9, :9], SETTINGS)
    np.testing.assert_allclose(rows.covariance, P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rows.nis, expected.nis, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("passes", [1, 2])
def test_smoother_agrees_with_filterpy(passes, monkeypatch):
    events, filtered = filtered_by_filterpy()
    x, P = oracle.smoothed(filtered)
    if passes == 2:
        x, P = oracle.smoothed(oracle.run(events, SETTINGS, along=x))

    monkeypatch.setattr("gateway.estimation.smoother.PASSES", passes)
    at = np.flatnonzero(events.kind == MeasurementKind.TICK)
    result = smooth(events, events.time_s[at], SETTINGS)
    known = result.known
    assert known.mean() > 0.9
    motion = np.hstack([result.eta, result.nu, result.nu_dot])
    np.testing.assert_allclose(motion[known], x[at][known, :9], rtol=1e-9, atol=1e-9)
    P = oracle.with_heading_error(x[at, :9], P[at, :9, :9], SETTINGS)
    np.testing.assert_allclose(result.covariance[known], P[known], rtol=1e-9, atol=1e-9)


def test_smoother_does_not_depend_on_the_size_of_its_chunks(monkeypatch):
    events = started(oracle.random_events(np.random.default_rng(3), 400))
    grid = np.arange(1.0, 8.0, 0.05)
    whole = smooth(events, grid, SETTINGS)
    monkeypatch.setattr("gateway.estimation.smoother.CHUNK", 37)
    pieces = smooth(events, grid, SETTINGS)
    np.testing.assert_array_equal(whole.nu, pieces.nu)
    np.testing.assert_array_equal(whole.covariance, pieces.covariance)
