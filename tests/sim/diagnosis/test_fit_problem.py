"""The superset model is each of the narrow ones, and the plain one where nothing is switched on."""

import numpy as np
import pytest

from sim.diagnosis.fit_problem import SupersetModel, neutral_values
from sim.effects.catalogue import EFFECTS
from sim.effects.effect import Effect
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.simulated import in_numpy
from tests.sim.vessels import VALUES, WAMV
from tests.sim.voyages import commands

SUPERSET = SupersetModel.of(WAMV, EFFECTS)
DRIVE = commands(20.0, 0.1)


def test_switched_off_it_is_the_plain_vessel() -> None:
    plain, superset = Model.of(WAMV).simulate(DRIVE, 0.1)[1], SUPERSET.model.simulate(DRIVE, 0.1)[1]
    np.testing.assert_allclose(superset, plain, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("effect", SUPERSET.effects, ids=lambda e: e.name)
def test_switched_on_it_is_the_vessel_with_that_effect(effect: Effect) -> None:
    added = AddedEffect(
        effect, VALUES.get(effect.name) or {p.name: p.start for p in effect.parameters}
    )
    narrow = in_numpy(WAMV.with_effects(added)).simulate(DRIVE, 0.1)[1]
    superset = SUPERSET.with_added([added]).simulate(DRIVE, 0.1)[1]
    np.testing.assert_allclose(superset, narrow, rtol=1e-9, atol=1e-9)


def test_what_has_memory_or_no_off_comes_beside_the_others() -> None:
    lag = next(e for e in EFFECTS if e.name == "thruster_lag")
    assert neutral_values(lag) is None
    both = SUPERSET.with_added(
        [
            AddedEffect(lag, {"tau": 0.3}),
            AddedEffect(SUPERSET.effects[0], {"speed": 0.2, "direction": 1.0}),
        ]
    )
    assert {"thruster_lag.tau", "steady_current.speed"} <= set(both.names)
    assert both.theta[both.names.index("steady_current.speed")] == 0.2


def test_wind_cannot_be_switched_off_as_still_air_resists_too() -> None:
    wind = next(e for e in EFFECTS if e.name == "steady_wind")
    assert neutral_values(wind) is None
