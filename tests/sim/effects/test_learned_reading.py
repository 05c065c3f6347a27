"""A sensor's error as a table: what it changes, that rates are those of the values, its words."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.body import Report
from sim.effects import learned_reading as reading
from sim.effects.effect import ForceAxis
from sim.effects.words import FittedValues
from sim.state import Floats, to_world
from tests.sim.vessels import WAMV

T = np.arange(0.0, 60.0, 0.002)
YAW = 1.2 * np.sin(0.23 * T) + 0.1 * T
U, V = 1.0 + 0.5 * np.sin(0.31 * T), 0.2 * np.cos(0.17 * T)
R = np.gradient(YAW, T)


def rate(x: Floats) -> Floats:
    return np.gradient(x, T)


MOTION = Report(0.0 * T, 0.0 * T, YAW, U, V, R, rate(U), rate(V), rate(R))


def reported(acts: float, by: float, error: Callable[[Floats], Floats]) -> Report:
    """The motion as a sensor reports it that errs by this over its variable."""
    low, high = {reading.AHEAD: (0.0, 2.0), reading.HEADING: (0.0, 2.0 * np.pi)}.get(
        by, (-1.0, 1.0)
    )
    table = next(
        t
        for t in reading.tables(WAMV, {"u": (0.0, 2.0), "r": (-1.0, 1.0), "swing": (-0.7, 0.6)})
        if (t["acts"], t["by"]) == (acts, by)
    )
    filled = dict(zip((f"f{k}" for k in range(9)), error(np.linspace(low, high, 9)), strict=True))
    return reading.observe(MOTION, SimpleNamespace(**{**table, "low": low, "high": high, **filled}))


@pytest.mark.parametrize("by", [reading.TURNING, reading.SWINGING, reading.AHEAD, reading.HEADING])
def test_a_heading_that_is_off_turns_what_is_reported_on_board_and_not_what_moves_over_ground(
    by: float,
) -> None:
    seen = reported(reading.OF_HEADING, by, lambda x: 0.2 * np.sin(x))
    assert np.abs(seen.yaw - YAW).max() > 0.05
    np.testing.assert_allclose(
        to_world(seen.u, seen.v, seen.yaw), to_world(U, V, YAW), rtol=0.0, atol=1e-12
    )
    assert np.array_equal(seen.r, R)
    # accelerations are those of the velocities, but for a moment at each knot
    for now, was in ((seen.u_dot, rate(seen.u)), (seen.v_dot, rate(seen.v))):
        assert np.median(np.abs(now - was)) < 1e-5
        assert np.quantile(np.abs(now - was), 0.75) < 1e-3


def test_a_lag_is_a_line_over_the_yaw_rate() -> None:
    late = reported(reading.OF_HEADING, reading.TURNING, lambda x: -0.3 * x)
    then = np.interp(T - 0.3, T, YAW)
    np.testing.assert_allclose(late.yaw[T > 0.3], then[T > 0.3], atol=5e-3)


def test_a_speed_that_is_a_tenth_too_much_is_so_in_both_directions() -> None:
    seen = reported(reading.OF_SPEED, reading.AHEAD, lambda x: 0.0 * x + 0.1)
    np.testing.assert_allclose([seen.u, seen.v, seen.u_dot], 1.1 * np.array([U, V, rate(U)]))
    assert (seen.yaw is YAW) or np.array_equal(seen.yaw, YAW)
    faster = reported(reading.OF_SPEED, reading.AHEAD, lambda x: 0.1 * x)
    np.testing.assert_allclose(faster.u, (1.0 + 0.1 * U) * U)
    assert np.median(np.abs(faster.u_dot - rate(faster.u))) < 1e-5


def test_a_gyro_with_a_scale_of_its_own_changes_the_yaw_rate_alone() -> None:
    seen = reported(reading.OF_YAW_RATE, reading.TURNING, lambda x: 0.1 * x)
    np.testing.assert_allclose(seen.r, 1.1 * R)
    np.testing.assert_allclose(seen.r_dot, 1.1 * rate(R), atol=1e-9)
    np.testing.assert_array_equal([seen.yaw, seen.u, seen.v], [YAW, U, V])


def values(**change: float) -> FittedValues:
    return FittedValues(reading.EFFECT.example | change, {}, None)  # type: ignore[arg-type, operator]


def test_it_says_what_is_off_and_where() -> None:
    said = reading.in_words(values())
    assert said.startswith("the heading that is reported is off with the yaw rate: +13.8° at -34.4")
    assert said.endswith("-13.8° at 34.4 °/s")
    around = reading.in_words(values(by=4.0, low=0.0, high=2.0 * np.pi, f8=0.0))
    assert around.endswith("+13.8° at 360 °")  # where it begins again
    speed = reading.in_words(values(acts=2.0, by=1.0, low=0.0, high=2.0))
    assert speed.startswith(
        "the speed that is reported is off with the speed ahead: +24 % at 0 m/s"
    )
    gyro = reading.in_words(values(acts=3.0))
    assert "the yaw rate that is reported is off with the yaw rate: +14 °/s at -34.4 °/s" in gyro


def test_it_is_drawn_as_the_force_that_it_looks_like() -> None:
    def axis(**change: float) -> Any:
        return reading.evidence_axis(values(**change))

    assert axis() == (ForceAxis.SWAY, "turn_rate", None)
    assert axis(by=4.0) == (ForceAxis.SWAY, "heading", None)
    assert axis(acts=2.0, by=1.0) == (ForceAxis.SURGE, "surge", None)
    assert axis(acts=3.0) == (ForceAxis.YAW, "turn_rate", None)


def test_knots_that_do_not_rise_are_no_table() -> None:
    assert not reading.mismatch(WAMV, reading.EFFECT.example or {})
    assert "must rise" in reading.mismatch(WAMV, values(at3=0.9))
