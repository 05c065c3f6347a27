"""The superset model is the plain one where nothing is switched on, and names what is added.

That it is each of the narrow ones, compiled too, is shown in tests/sim/kernel/test_kernel.py.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from sim.diagnosis.fit_problem import SupersetModel, neutral_values
from sim.effects.catalogue import EFFECTS
from sim.vessel import AddedEffect
from tests.sim.simulated import on_floats
from tests.sim.vessels import WAMV
from tests.sim.voyages import commands

DRIVE = commands(20.0, 0.1)


@pytest.fixture
def superset(monkeypatch: pytest.MonkeyPatch) -> SupersetModel:
    """All effects, their laws in plain Python."""
    monkeypatch.setattr("sim.diagnosis.fit_problem.Model", SimpleNamespace(of=on_floats))
    return SupersetModel.of(WAMV, EFFECTS)


def test_switched_off_it_is_the_plain_vessel(superset: SupersetModel) -> None:
    plain, all_off = (m.simulate(DRIVE, 0.1)[1] for m in (on_floats(WAMV), superset.model))
    np.testing.assert_allclose(all_off, plain, rtol=1e-12, atol=1e-12)


def test_what_has_memory_or_no_off_comes_beside_the_others(superset: SupersetModel) -> None:
    lag = next(e for e in EFFECTS if e.name == "thruster_lag")
    assert neutral_values(lag) is None
    both = superset.with_added(
        [
            AddedEffect(lag, {"tau": 0.3}),
            AddedEffect(superset.effects[0], {"speed": 0.2, "direction": 1.0}),
        ]
    )
    assert {"thruster_lag.tau", "steady_current.speed"} <= set(both.names)
    assert both.theta[both.names.index("steady_current.speed")] == 0.2


def test_a_model_with_memory_is_composed_once_and_has_each_time_its_own_numbers(
    superset: SupersetModel,
) -> None:
    lag = next(e for e in EFFECTS if e.name == "thruster_lag")
    one, other = (superset.with_added([AddedEffect(lag, {"tau": tau})]) for tau in (0.3, 0.8))
    for model, tau in ((one, 0.3), (other, 0.8)):
        assert model.theta[model.names.index("thruster_lag.tau")] == tau
        assert model.vessel.effects[-1].values == {"tau": tau}
    assert one.kernel is other.kernel
    assert len(superset._composed) == 1


def test_what_the_vessel_has_already_is_not_looked_for(superset: SupersetModel) -> None:
    has = AddedEffect(superset.effects[0], {"speed": 0.2, "direction": 1.0})
    others = SupersetModel.of(WAMV.with_effects(has), EFFECTS).effects
    assert others == superset.effects[1:]


def test_wind_cannot_be_switched_off_as_still_air_resists_too() -> None:
    wind = next(e for e in EFFECTS if e.name == "steady_wind")
    assert neutral_values(wind) is None
