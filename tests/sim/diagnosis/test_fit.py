"""Fits without parts of the time, and fits that begin anew."""

from dataclasses import replace

import numpy as np
import pytest

from sim.diagnosis.diagnose import DiagnoseSettings, refitted
from sim.diagnosis.fit import FAR, Fit, as_given
from sim.diagnosis.fit_problem import SupersetModel
from sim.identification.settings import BASE
from sim.model import Model
from sim.state import Floats
from tests.sim.diagnosis.sailed import sailed
from tests.sim.diagnosis.voyages import WAM_V

BEND = 4.0  # standard deviations, where a residual begins to count less


@pytest.fixture(scope="module")
def fit() -> Fit:
    """The base on a voyage that it explains."""
    return refitted(SupersetModel.of(WAM_V, ()), Model.of(WAM_V), [sailed()], DiagnoseSettings())


def cost(fit: Fit, z: Floats, rows: Floats) -> float:
    """Pseudo-Huber cost of some rows, and of leaving what was given."""
    r = fit.at(z[None])[0][rows]
    prior = np.array([u.prior for u in fit.unknowns.each])
    left = np.sum(((z - fit.unknowns.start) / prior) ** 2)
    return float(2.0 * BEND**2 * np.sum(np.sqrt(1.0 + (r / BEND) ** 2) - 1.0) + left)


@pytest.mark.parametrize("m33", [1.0, 0.6, 2.5])
def test_no_refit_fits_its_own_rows_worse(fit: Fit, m33: float) -> None:
    """Wherever it begins: far off a whole step may leave the track."""
    z = fit.z.copy()
    z[[u.name for u in fit.unknowns.each].index("m33")] *= m33
    begun = replace(fit, z=z, residual=fit.at(z[None])[0])
    for (seen, _), refit in zip(begun.ground.folds(), begun.refits.z, strict=True):
        assert cost(fit, refit, seen) <= cost(fit, z, seen) * (1.0 + 1e-9)
    np.testing.assert_allclose(begun.refits.residual, fit.at(begun.refits.z))


def test_a_fit_without_a_part_is_near_the_fit_with_it(fit: Fit) -> None:
    prior = np.array([u.prior for u in fit.unknowns.each])
    told = np.linalg.inv(fit.slope.T @ fit.slope + np.diag(prior**-2.0))
    assert np.all(np.abs(fit.refits.z - fit.z) < 4.0 * np.sqrt(np.diag(told)))
    assert np.any(fit.refits.z != fit.z)


def test_a_base_that_went_far_begins_again_where_it_was_given(fit: Fit) -> None:
    unknowns = fit.unknowns
    names = [u.name for u in unknowns.each]
    assert as_given(unknowns, unknowns.start) is None
    z = unknowns.start + 0.01
    i = names.index("X_u")
    z[i] = unknowns.start[i] + 1.1 * FAR * unknowns.each[i].prior
    again = as_given(unknowns, z)
    assert again is not None
    base = np.array([name in BASE for name in names])
    np.testing.assert_array_equal(again[base], unknowns.start[base])
    np.testing.assert_array_equal(again[~base], z[~base])
