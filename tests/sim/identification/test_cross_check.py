"""The cross-check speaks where shooting and instruments disagree, and only there."""

from dataclasses import replace

import pytest

from sim.effects.steady_current import EFFECT as CURRENT
from sim.identification.instrumental import cross_check_by_instruments
from sim.identification.intervals import Estimate
from sim.identification.settings import BASE
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.identification.boats import noisy
from tests.sim.vessels import WAMV


@pytest.fixture(scope="module")
def trial():
    return noisy(WAMV, 300.0, seed=1)


def told(**shares):
    """Estimates 2 % wide around the truth, some of them off by a share."""
    out = []
    for name in BASE:
        truth = getattr(WAMV.dynamics, name)
        value = truth * (1.0 + shares.get(name, 0.0))
        half = 0.02 * abs(truth)
        out.append(Estimate(name, "SI", truth, value, (value - half, value + half), True))
    return out


def test_silent_where_both_agree(trial):
    assert cross_check_by_instruments([trial], Model.of(WAMV), told()) == ()


def test_a_mass_that_is_far_off_is_named_with_where_to_look(trial):
    (says,) = cross_check_by_instruments([trial], Model.of(WAMV), told(m11=0.3))
    assert says.startswith("m11: instrumental variables say")
    assert "thruster_lag" in says


def test_what_the_data_do_not_tell_is_not_compared(trial):
    vague = [replace(e, identifiable=False) for e in told(m11=0.3)]
    assert cross_check_by_instruments([trial], Model.of(WAMV), vague) == ()


def test_a_vessel_with_effects_is_not_compared(trial):
    moving = WAMV.with_effects(AddedEffect(CURRENT, {"speed": 0.2, "direction": 0.0}))
    assert cross_check_by_instruments([trial], Model.of(moving), told(m11=0.3)) == ()
