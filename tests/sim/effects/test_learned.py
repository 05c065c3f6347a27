"""The table that takes any shape: its values between the knots, and what it is told as."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.effects.learned import (
    EFFECT,
    HEADING,
    KNOTS,
    MOTOR,
    SWAY,
    THRUST,
    TURNING,
    YAW,
    in_words,
    table,
)

SHARES = {f"f{k}": 0.1 * (-1) ** k * k for k in range(KNOTS)}
BASE = {**EFFECT.example, **SHARES}


def at(x: np.ndarray, **values: float) -> np.ndarray:
    return np.asarray(table(x, SimpleNamespace(**{**BASE, **values})))


def test_between_the_knots_it_is_linear_and_beyond_them_constant() -> None:
    x = np.linspace(-1.0, 3.0, 101)
    knots = np.linspace(0.0, 2.0, KNOTS)
    np.testing.assert_allclose(at(x), np.interp(x, knots, list(SHARES.values())), atol=1e-12)


def test_a_heading_has_no_end() -> None:
    around = {"by": HEADING, "high": 2.0 * np.pi}
    x = np.linspace(0.0, 2.0 * np.pi, 50)
    for turns in (-2, 1):
        np.testing.assert_allclose(
            at(x + turns * 2.0 * np.pi, **around), at(x, **around), atol=1e-9
        )
    assert at(np.array(-1e-9), **around) == pytest.approx(SHARES["f0"], abs=1e-6)
    assert at(np.array(-1e-9)) == SHARES["f0"]


@pytest.mark.parametrize(
    ("values", "parts", "never"),
    [
        ({}, ("force ahead with the speed ahead", "-30 N at 1 m/s"), "origin"),
        ({"acts": SWAY, "x": -0.44}, ("force to starboard -0.44 m from the origin",), "moment"),
        ({"acts": YAW}, ("moment", "half the hull's length", "-30 N at 1 m/s"), "origin"),
        ({"acts": THRUST}, ("share of the thrust", "-30 % at 1 m/s"), " N "),
        (
            {"by": TURNING, "acts": THRUST, "high": np.pi / 3},
            ("share of the thrust that changes with the yaw rate", "-30 % at 30 °/s"),
            " N ",
        ),
        ({"by": HEADING, "high": 2.0 * np.pi}, ("with the heading", "-30 N at 180 °"), "m/s"),
        ({"by": MOTOR, "high": 1.0}, ("thrust of each motor", "-30 N at 50 %"), "m/s"),
    ],
)
def test_it_is_told_in_the_units_of_its_variable(values, parts, never) -> None:
    said = in_words({**EFFECT.example, **values})
    for part in parts:
        assert part in said
    assert never not in said
