"""What a day may bring, but every day has, is told as the boat's, with one set of numbers."""

from dataclasses import replace

import pytest

from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import Scope
from tests.sim.diagnosis.sailed import sailed
from tests.sim.voyages import WAM_V

FEW = DiagnoseSettings(
    effects=tuple(map(named, ("towed_load", "hull_lift", "steady_current", "heading_offset")))
)
X_M = -1.5


def of_days(*drags: float):
    """Voyages on which something holds the boat so strongly [N s²/m²]."""
    trials = [sailed("towed_load", 60.0, k + 1, drag=drag, x=X_M) for k, drag in enumerate(drags)]
    return [replace(trial, name=f"day {k}") for k, trial in enumerate(trials)]


def test_only_effects_of_a_day_can_be_alike() -> None:
    alike = [effect for effect in EFFECTS if effect.alike]
    assert [effect.name for effect in alike] == ["towed_load"]
    for effect in alike:
        assert effect.scope is Scope.VOYAGE
        assert effect.of_the_boat == replace(effect, scope=Scope.BOAT)
        assert effect.of_the_boat.laws == effect.laws


@pytest.mark.parametrize("drags", [(30.0, 30.0, 30.0), (25.0, 30.0, 35.0)])
def test_what_holds_the_boat_on_all_recordings_is_the_boat(drags) -> None:
    """On a day that no fit has seen it would be missed, though it is not quite the same."""
    found = diagnose(of_days(*drags), WAM_V, FEW)
    assert found.effects == ("towed_load",)
    numbers = {e.name: e for e in found.ladder[-1].parameters["towed_load"]}
    assert set(numbers) == {"towed_load.drag", "towed_load.x"}  # one set
    assert all(e.trial is None for e in numbers.values())
    assert numbers["towed_load.drag"].value == pytest.approx(30.0, rel=0.2)
    assert numbers["towed_load.x"].value == pytest.approx(X_M, abs=0.3)
    assert "towed_load has one set of numbers for all 3 recordings, as of motors" in found.summary


@pytest.mark.parametrize("drags", [(0.0, 60.0, 20.0), (0.0, 0.0, 40.0), (30.0, 30.0)])
def test_what_some_day_does_not_have_or_two_recordings_show_is_of_the_day(drags) -> None:
    found = diagnose(of_days(*drags), WAM_V, FEW)
    assert found.effects == ("towed_load",)
    numbers = [e for e in found.ladder[-1].parameters["towed_load"] if e.name.endswith("drag")]
    assert [e.trial for e in numbers] == [f"day {k}" for k in range(len(drags))]
    for number, drag in zip(numbers, drags, strict=True):
        assert number.value == pytest.approx(drag, abs=3.0)
    assert "one set of numbers" not in found.summary
