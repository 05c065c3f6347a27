"""Damping that a fit left at zero: it may come back where another voyage asks for it."""

from dataclasses import replace

import pytest

from sim.diagnosis.diagnose import DiagnoseSettings, fit_base, room_for_small_damping
from sim.diagnosis.fit_problem import SupersetModel
from sim.model import Model
from tests.sim.diagnosis.sailed import sailed
from tests.sim.voyages import WAM_V

D = WAM_V.dynamics
FASTEST = (2.0, 0.5, 0.5)


def test_numbers_beside_one_another_have_their_own_share_only() -> None:
    assert room_for_small_damping(D, FASTEST) == {}
    assert room_for_small_damping(D, None) == {}
    assert room_for_small_damping(replace(D, X_u=-2e-10), (0.0, 0.0, 0.0)) == {}  # at rest


def test_what_is_next_to_nothing_has_a_tenth_of_the_axis() -> None:
    """As far off as a tenth of all damping may be, in its own unit."""
    room = room_for_small_damping(replace(D, X_u=-2e-10, N_rr=-1e-3), FASTEST)
    assert set(room) == {"X_u", "N_rr"}
    assert room["X_u"] * 1e-9 == pytest.approx(0.1 * 2.0 * abs(D.X_uu))
    assert room["N_rr"] * 1e-3 * 0.5 == pytest.approx(0.1 * (abs(D.N_r) + 0.5e-3))


def test_damping_at_zero_is_not_held_there() -> None:
    trial = sailed()
    fitted = replace(WAM_V, dynamics=replace(D, X_u=-2e-10, X_uu=-50.0))
    superset = SupersetModel.of(fitted, [], [trial])
    base = fit_base(superset, Model.of(fitted), [trial], DiagnoseSettings())
    found = dict(zip((u.name for u in base.unknowns.each), base.z, strict=True))
    assert found["X_u"] < -1.0
