"""Thrust as a table: where it lies on the knots, what it costs, that it never falls."""

from dataclasses import replace

import numpy as np
import pytest

from sim.identification import IdentifySettings, updated_vessel
from sim.identification.parameters import unknowns_of
from sim.kernel.cache import plain_kernel_for
from sim.vessel import (
    as_table,
    curve_exponent,
    curve_problem,
    knot_shares,
    next_knot,
    table_owner,
    with_free_curves,
)
from tests.sim.simulated import on_floats
from tests.sim.vessels import WAMV

DT = 0.1
TABLE = ((-1.0, -1.0), (-0.4, -0.1), (0.0, 0.0), (0.1, 0.0), (0.5, 0.6), (1.0, 1.0))


def with_curves(*curves):
    """The WAM-V with these curves, left and right."""
    thrusters = tuple(replace(t, curve=c) for t, c in zip(WAMV.thrusters, curves, strict=True))
    return replace(WAMV, thrusters=thrusters)


def thrusts(vessel, commands):
    """Static thrust [N] of each thruster at commands (K,)."""
    kernel = plain_kernel_for(on_floats(vessel).kernel.structure).module
    p = kernel.unpack(on_floats(vessel).theta)
    return np.array([kernel.static_actuation(np.array([c, c]), p) for c in commands])


def test_thrust_passes_through_the_knots_and_runs_straight_between_them():
    c = np.array([-1.0, -0.7, -0.4, 0.0, 0.1, 0.3, 0.5, 0.75, 1.0])
    share = np.array([-85.0, -0.55 * 85, -8.5, 0.0, 0.0, 27.0, 54.0, 72.0, 90.0])
    found = thrusts(with_curves(TABLE, "linear"), c)
    np.testing.assert_allclose(found[:, 0], share, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], np.where(c > 0, 90.0 * c, 85.0 * c), atol=1e-12)


def test_a_thruster_may_share_the_table_of_another():
    shared = thrusts(with_curves("right", TABLE), np.linspace(-1, 1, 41))
    np.testing.assert_array_equal(shared[:, 0], shared[:, 1])


def test_a_straight_table_is_a_linear_curve():
    commands = np.random.default_rng(1).uniform(-1.0, 1.0, (200, 2))
    straight = ((-1.0, -1.0), (0.0, 0.0), (0.5, 0.5), (1.0, 1.0))
    ours, _ = on_floats(with_curves(straight, "left")).simulate(commands, DT)
    plain, _ = on_floats(WAMV).simulate(commands, DT)
    np.testing.assert_allclose(ours, plain, atol=1e-9)


def test_a_plain_vessel_has_the_kernel_it_had():
    assert on_floats(WAMV).kernel.structure.tables == ()
    assert not [name for name in on_floats(WAMV).names if "curve_" in name]


def test_numbers_put_back_by_name_move_a_knot():
    vessel = updated_vessel(
        with_curves(TABLE, "left"), {"left.curve_50": 0.7, "left.curve_-40": -0.2}
    )
    assert vessel.thrusters[0].curve[1] == (-0.4, -0.2)
    assert vessel.thrusters[0].curve[4] == (0.5, 0.7)
    assert on_floats(vessel).names == on_floats(with_curves(TABLE, "left")).names


def test_a_curve_that_is_freed_starts_as_it_was():
    quadratic = with_curves("quadratic", "quadratic")
    for names in (("left.curve", "right.curve"), ("curve",)):
        c = np.array([-1, -0.75, -0.5, -0.25, -0.1, 0.0, 0.1, 0.25, 0.5, 0.75, 1.0])
        np.testing.assert_allclose(
            thrusts(with_free_curves(quadratic, names), c), thrusts(quadratic, c), atol=1e-12
        )
    assert with_free_curves(quadratic, ("curve",)).thrusters[1].curve == "left"
    assert with_free_curves(quadratic, ("m11",)) == quadratic


@pytest.mark.parametrize("seed", range(5))
def test_whatever_is_searched_a_curve_never_falls(seed):
    vessel = with_free_curves(with_curves("quadratic", "linear"), ("curve", "left.curve"))
    unknowns = unknowns_of(on_floats(vessel), 1, IdentifySettings(("curve",), offsets=False))
    lower, upper = unknowns.bounds
    z = np.random.default_rng(seed).uniform(lower, upper)
    values = dict(zip((u.name for u in unknowns.each), unknowns.to_named(z), strict=True))
    curve = updated_vessel(vessel, values).thrusters[0].curve
    assert curve_problem(curve) is None
    np.testing.assert_allclose(unknowns.from_named(unknowns.to_named(z)), z, atol=1e-12)


def test_a_knot_beside_one_that_is_fixed_stays_below_it():
    vessel = with_curves(TABLE, "left")
    unknowns = unknowns_of(
        on_floats(vessel), 1, IdentifySettings(("left.curve_10",), offsets=False)
    )
    np.testing.assert_allclose(unknowns.to_named(np.array([1.0])), [0.6])
    assert next_knot("curve_10", knot_shares(TABLE)) == "curve_50"
    assert next_knot("curve_-40", knot_shares(TABLE)) is None


def test_a_table_with_a_mistake_is_told():
    for wrong in (TABLE[1:], TABLE[:2] + TABLE[3:], (*TABLE[:3], (0.6, 0.9), *TABLE[4:])):
        assert curve_problem(wrong)
    assert curve_problem(TABLE) is None
    assert table_owner(WAMV.thrusters, WAMV.thrusters[0]) == -1
    assert curve_exponent(replace(WAMV.thrusters[0], curve="quadratic")) == 2.0
    assert curve_problem(as_table("quadratic")) is None
