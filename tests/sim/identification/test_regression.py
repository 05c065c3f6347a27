"""Least squares: what the equations say it must give."""

import numpy as np
import pytest

from sim.identification import BASE
from sim.identification.regression import DELTA_SIGN, ordinary_least_squares, regressor
from sim.model import Model
from tests.sim.vessels import IACQUABOT, WAMV


def excited() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.normal(0.0, 0.8, (400, 3)), rng.normal(0.0, 0.5, (400, 3))


@pytest.mark.parametrize("vessel", [IACQUABOT, WAMV])
def test_regressor_times_parameters_is_the_force(vessel):
    nu, nu_dot = excited()
    model = Model.of(vessel)
    delta = DELTA_SIGN * [getattr(vessel.dynamics, name) for name in BASE]
    still = np.zeros((len(nu), model.actuator_count))
    motion = np.hstack([np.zeros_like(nu), nu, nu_dot])
    force, _ = model.missing_force(motion, np.arange(400.0), still, still)
    np.testing.assert_allclose(regressor(nu, nu_dot) @ delta, force, rtol=1e-9, atol=1e-9)


def test_the_printed_regressor_lacks_the_munk_moment_alone():
    nu, nu_dot = excited()
    delta = DELTA_SIGN * [getattr(WAMV.dynamics, name) for name in BASE]
    lacking = (regressor(nu, nu_dot) - regressor(nu, nu_dot, printed=True)) @ delta
    munk = (WAMV.dynamics.m22 - WAMV.dynamics.m11) * nu[:, 0] * nu[:, 1]
    np.testing.assert_allclose(lacking[:, 2], munk)
    np.testing.assert_array_equal(lacking[:, :2], 0.0)


def test_white_noise_on_the_force_is_covered_95_times_in_100():
    nu, nu_dot = excited()
    phi, rng = regressor(nu, nu_dot), np.random.default_rng(5)
    delta = np.arange(1.0, 10.0)
    inside = []
    for _ in range(200):
        found, std = ordinary_least_squares(phi, phi @ delta + rng.normal(0.0, 2.0, (400, 3)))
        inside.append(np.abs(found - delta) <= 1.96 * std)
    assert 0.93 < np.mean(inside) < 0.97
