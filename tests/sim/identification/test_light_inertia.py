"""Inertia that is less than the hull's own is said to be impossible, with what to check."""

from dataclasses import replace

import pytest

from sim.identification.intervals import Estimate
from sim.identification.light_inertia import too_light
from tests.sim.voyages import WAM_V

MASS, LENGTH = WAM_V.hull.mass, WAM_V.hull.length
TURNING = MASS * LENGTH**2


def fitted(name: str, value: float, low: float, high: float) -> Estimate:
    unit = "kg m²" if name == "m33" else "kg"
    return Estimate(name, unit, value, value, (low, high), True)


@pytest.mark.parametrize(
    ("name", "of", "value", "high", "told"),
    [
        ("m11", MASS, 0.06, 0.2, True),
        ("m22", MASS, 0.3, 0.5, True),
        ("m22", MASS, 0.3, 4.0, False),  # these data allow another
        ("m11", MASS, 0.7, 0.75, False),  # as of models that were published
        ("m33", TURNING, 0.001, 0.005, True),
        ("m33", TURNING, 0.016, 0.02, False),
        ("X_u", MASS, 0.0, 0.1, False),
    ],
)
def test_a_hull_has_its_own_mass_at_least(
    name: str, of: float, value: float, high: float, told: bool
) -> None:
    texts = too_light([fitted(name, value * of, 0.0, high * of)], WAM_V)
    assert len(texts) == told
    if told:
        assert texts[0].startswith(f"{name} {value * of:.3g} k")
        assert f"than a hull of {MASS:g} kg has without any water: mass or thrust (" in texts[0]


def test_all_that_are_too_light_are_told_at_once_and_without_motors_no_thrust() -> None:
    light = [fitted(name, 0.1 * MASS, 0.0, 0.2 * MASS) for name in ("m11", "m22")]
    (text,) = too_light(light, replace(WAM_V, thrusters=()))
    assert text.startswith(f"m11 {0.1 * MASS:.3g} kg, m22 {0.1 * MASS:.3g} kg is far less")
    assert "mass or thrust of the vessel file" in text
