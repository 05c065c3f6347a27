"""A compass that is turned near a place: what is reported, where it is looked for, its words."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.body import Report
from sim.effects import learned_anomaly as anomaly
from sim.effects.effect import ResidualForce
from sim.effects.tables import EVENLY
from sim.effects.words import FittedValues
from sim.state import Floats, to_world
from tests.sim.vessels import WAMV

T = np.arange(0.0, 60.0, 0.002)
YAW = 0.1 * T
U, V = 1.0 + 0.3 * np.sin(0.31 * T), 0.1 * np.cos(0.17 * T)
NORTH, EAST = (np.cumsum(x) * 0.002 for x in to_world(U, V, YAW))
PIER = {"north": 3.0, "east": 8.0, "reach": 16.0, **EVENLY,
        **{f"f{k}": 0.3 * max(1.0 - 0.25 * k, 0.0) for k in range(9)}}  # fmt: skip


def rate(x: Floats) -> Floats:
    return np.gradient(x, T)


def test_near_the_place_the_heading_is_off_and_what_moves_over_ground_is_as_it_was() -> None:
    true = Report(NORTH, EAST, YAW, U, V, rate(YAW), rate(U), rate(V), 0.0 * T)
    seen = anomaly.observe(true, SimpleNamespace(**PIER))
    d = np.hypot(NORTH - 3.0, EAST - 8.0)
    np.testing.assert_allclose(seen.yaw - YAW, 0.3 * np.maximum(1.0 - d / 8.0, 0.0), atol=1e-12)
    assert 0.1 < np.mean(d > 8.0) < 0.9  # it was there, and it was not
    world = to_world(seen.u, seen.v, seen.yaw)
    np.testing.assert_allclose(world, to_world(U, V, YAW), atol=1e-12)
    for now, was in ((seen.u_dot, rate(seen.u)), (seen.v_dot, rate(seen.v))):
        assert np.quantile(np.abs(now - was), 0.75) < 1e-3
    np.testing.assert_array_equal(seen.r, rate(YAW))


def seen_by(error: float, seconds: float = 600.0) -> ResidualForce:
    """A boat that winds about, and slips outward as it turns, past a pier at (6, -4)."""
    t = np.arange(0.0, seconds, 0.2)
    place = np.stack([25.0 * np.sin(0.05 * t), 20.0 * np.sin(0.037 * t + 1.0)], axis=1)
    r = 0.3 * np.sin(0.21 * t)
    off = error * np.exp(-0.5 * np.sum((place - [6.0, -4.0]) ** 2, axis=1) / 8.0**2)
    u, v = 1.2 * np.cos(off), -1.2 * np.sin(off) - 0.4 * r
    v += np.random.default_rng(4).normal(0.0, 0.03, len(t))
    return ResidualForce(t, place, 0.0 * place, nu=np.stack([u, v, r], axis=1))


@pytest.mark.parametrize("error", [0.3, -0.3])
def test_it_is_looked_for_where_the_boat_seems_to_crab(error: float) -> None:
    first, *_ = anomaly.search(WAMV, lambda: seen_by(error))
    assert np.hypot(first["north"] - 6.0, first["east"] + 4.0) < 4.0
    assert first["f0"] == pytest.approx(error, abs=0.1)
    assert abs(first["f8"]) < 0.05


def test_a_boat_that_lay_still_has_one_empty_table() -> None:
    t = np.arange(0.0, 60.0, 0.2)
    still = ResidualForce(t, np.zeros((len(t), 2)), np.zeros((len(t), 2)), nu=np.zeros((len(t), 3)))
    (empty,) = anomaly.search(WAMV, lambda: still)
    assert {empty[key] for key in anomaly.VALUES_AT} == {0.0}


def test_it_says_where_and_by_how_much_but_only_what_is_known() -> None:
    ci95 = {key: (PIER[key] - 0.05, PIER[key] + 0.05) for key in anomaly.VALUES_AT}
    said = anomaly.in_words(FittedValues(PIER, ci95))
    assert said.startswith("the compass is turned near N 3 m, E 8 m: +17.2° 0 m away, ")
    assert said.endswith("+0.0° 16 m away")
    wide = dict.fromkeys(anomaly.VALUES_AT, (-3.0, 3.0))
    assert anomaly.in_words(FittedValues(PIER, wide)).endswith(": nowhere surely")
    none = PIER | dict.fromkeys(anomaly.VALUES_AT, 0.0)
    assert anomaly.in_words(FittedValues(none)).endswith(": nowhere surely")
    field = anomaly.over_map(FittedValues(PIER, ci95))
    assert not field.directed
    assert field.unit == "°"
    at_it = np.argmin(np.hypot(field.north - 3.0, field.east - 8.0))
    assert field.to_north[at_it] == pytest.approx(17.2, abs=0.1)
