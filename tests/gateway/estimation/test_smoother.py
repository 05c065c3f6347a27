"""Outages, discontinuities, outliers and long silence, seen from both sides."""

import dataclasses

import numpy as np
import pytest

from gateway.estimation import FilterSettings, MeasurementKind, State
from gateway.estimation.events import join, make_events, ticks
from gateway.estimation.smoother import smooth
from tests.gateway.estimation.boat import telemetry, weaving_boat

SETTINGS = FilterSettings()


def voyage(seed=0, seconds=40.0):
    rng = np.random.default_rng(seed)
    truth = weaving_boat(rng, seconds)
    return truth, telemetry(rng, truth, SETTINGS)


def motion(result):
    return np.hstack([result.eta, result.nu, result.nu_dot])


def std(result):
    return np.sqrt(np.einsum("tii->ti", result.covariance))


def shifted(result, by):
    return dataclasses.replace(result, time_s=result.time_s + by)


def test_an_outage_is_bridged_and_its_uncertainty_stated():
    truth, events = voyage(3)
    silent = (events.time_s > 15.0) & (events.time_s < 21.0)
    grid = np.arange(10.0, 30.0, 0.1)
    result = smooth(events[~silent], grid, SETTINGS)
    inside = (grid > 15.2) & (grid < 20.8)
    assert result.known.all()
    middle = np.argmin(np.abs(grid - 18.0))
    assert (std(result)[middle, :6] > 1.2 * std(result)[0, :6]).all()
    error = np.abs(motion(result) - truth.at(grid))[:, 3:]
    assert (error[inside] < 4 * std(result)[inside, 3:]).all()
    assert (np.linalg.eigvalsh(result.covariance) > 0).all()


def test_an_outage_is_worst_in_its_middle():
    _, events = voyage(3)
    silent = (events.time_s > 15.0) & (events.time_s < 21.0)
    result = smooth(events[~silent], np.array([15.2, 18.0, 20.8]), SETTINGS)
    u = std(result)[:, State.U]
    assert u[1] > u[0]
    assert u[1] > u[2]


def test_the_order_of_receipt_does_not_matter():
    _, events = voyage(seconds=10.0)
    grid = np.arange(1.0, 9.0, 0.1)
    mixed = events[np.random.default_rng(0).permutation(len(events))]
    one, other = smooth(events, grid, SETTINGS), smooth(mixed, grid, SETTINGS)
    np.testing.assert_array_equal(motion(one), motion(other))


def test_the_grid_does_not_change_the_result():
    _, events = voyage(seconds=10.0)
    coarse = smooth(events, np.arange(1.0, 9.0, 0.5), SETTINGS)
    fine = smooth(events, np.arange(1.0, 9.0, 0.02), SETTINGS)
    np.testing.assert_allclose(motion(fine)[::25], motion(coarse), rtol=0, atol=2e-4)


def test_outliers_are_left_out():
    _, events = voyage(seconds=10.0)
    hit = np.flatnonzero(events.kind == MeasurementKind.VELOCITY)[100:103]
    z = events.z.copy()
    z[hit] += 20.0
    grid = np.arange(1.0, 9.0, 0.1)
    spoiled = smooth(dataclasses.replace(events, z=z), grid, SETTINGS)
    clean = smooth(events, grid, SETTINGS)
    assert clean.gated == 0
    assert spoiled.gated == 3
    assert np.abs(spoiled.nu - clean.nu).max() < 0.02


def test_a_discontinuity_is_not_motion():
    truth, events = voyage()
    z = events.z.copy()
    z[(events.kind == MeasurementKind.POSITION) & (events.time_s > 20.0)] += [50.0, -20.0]
    grid = np.arange(5.0, 35.0, 0.1)
    result = smooth(dataclasses.replace(events, z=z), grid, SETTINGS)
    assert np.abs(result.nu - truth.at(grid)[:, 3:6]).max() < 0.3
    assert result.eta[-1, 0] - truth.at(grid)[-1, 0] == pytest.approx(50.0, abs=3.0)
    assert result.eta[0, 0] - truth.at(grid)[0, 0] == pytest.approx(0.0, abs=3.0)


def test_a_long_silence_is_not_invented():
    _, events = voyage()
    grid = np.arange(-2.0, 182.0, 0.5)
    result = smooth(join([events, shifted(events, 140.0)]), grid, SETTINGS)
    silent = (grid < 0.0) | ((grid > 40.0) & (grid < 140.0)) | (grid > 180.0)
    assert not result.known[silent].any()
    assert result.known[(grid > 1.0) & (grid < 39.0)].all()
    assert result.known[(grid > 141.0) & (grid < 179.0)].all()
    assert np.isfinite(motion(result)).all()
    assert (std(result)[silent, State.U] >= SETTINGS.prior_speed_mps).all()
    # Each side is what it would be alone.
    first = smooth(events, np.arange(2.0, 38.0, 0.5), SETTINGS)
    here = (grid >= 2.0) & (grid < 38.0)
    np.testing.assert_allclose(result.nu[here], first.nu, rtol=0, atol=1e-4)


def test_nothing_known_is_said_so():
    result = smooth(ticks(np.zeros(0)), np.arange(3.0), SETTINGS)
    assert not result.known.any()
    result = smooth(
        make_events(MeasurementKind.YAW, np.arange(3.0), np.zeros(3), 0.1), np.arange(3.0)
    )
    assert not result.known.any()
    assert np.isfinite(motion(result)).all()
