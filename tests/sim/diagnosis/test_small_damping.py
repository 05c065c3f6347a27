"""Damping that a fit left at zero: it may come back where another voyage asks for it."""

from dataclasses import fields, replace

import pytest

from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.identification import IdentifySettings
from sim.identification.fast_damping import sizes_of_small_damping
from sim.identification.parameters import unknowns_of
from sim.model import Model
from tests.sim.diagnosis.sailed import sailed
from tests.sim.voyages import WAM_V

D = WAM_V.dynamics
FASTEST = (2.0, 0.5, 0.5)


VALUES = {f.name: getattr(D, f.name) for f in fields(D)}


def test_numbers_beside_one_another_have_their_own_share_only() -> None:
    assert sizes_of_small_damping(VALUES, FASTEST) == {}
    assert sizes_of_small_damping(VALUES, None) == {}
    assert sizes_of_small_damping({**VALUES, "X_u": -2e-10}, (0.0, 0.0, 0.0)) == {}  # at rest


def test_what_is_next_to_nothing_has_a_tenth_of_the_axis() -> None:
    """As far off as a tenth of all damping may be, in its own unit."""
    sizes = sizes_of_small_damping({**VALUES, "X_u": -2e-10, "N_rr": -1e-3}, FASTEST)
    assert set(sizes) == {"X_u", "N_rr"}
    assert sizes["X_u"] == pytest.approx(0.1 * 2.0 * abs(D.X_uu))
    assert sizes["N_rr"] * 0.5 == pytest.approx(0.1 * (abs(D.N_r) + 0.5e-3))


@pytest.mark.parametrize(("X_u", "std"), [(-2e-10, 0.15 * 0.1 * 2.0), (D.X_u, None)])
def test_a_prior_is_a_share_of_that(X_u: float, std: float | None) -> None:
    fitted = replace(WAM_V, dynamics=replace(D, X_u=X_u))
    how = IdentifySettings(priors={"X_u": 0.15}, fastest=FASTEST)
    (found,) = (u for u in unknowns_of(Model.of(fitted), 1, how).each if u.name == "X_u")
    assert found.prior == pytest.approx(0.15 * abs(X_u) if std is None else std * abs(D.X_uu))


def test_damping_at_zero_is_not_held_there() -> None:
    trial = sailed()
    fitted = replace(WAM_V, dynamics=replace(D, X_u=-2e-10, X_uu=-50.0))
    superset = SupersetModel.of(fitted, [], [trial])
    base = fit_base(superset, Model.of(fitted), [trial], DiagnoseSettings())
    found = dict(zip((u.name for u in base.unknowns.each), base.z, strict=True))
    assert found["X_u"] < -1.0
