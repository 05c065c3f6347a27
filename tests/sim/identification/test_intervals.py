"""Intervals of numbers, from uncertainties that are given."""

from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.identification import BASE, FILTERED_STD, IdentifySettings
from sim.identification.intervals import Estimate, Uncertainty, estimates_of, named_covariance
from sim.identification.parameters import DAMPING, MASSES, OFFSET_LIMIT_S, OFFSETS, unknowns_of
from sim.model import Model
from sim.vessel import AddedEffect, Vessel
from tests.sim.identification.noisy_trials import noisy
from tests.sim.vessels import WAMV, added


def estimates(
    std: float,
    vessel: Vessel = WAMV,
    free: tuple[str, ...] = BASE,
    filtered: float = 0.0,
    **at: float,
) -> dict[str, Estimate]:
    """Of a vessel as it is, but numbers that are given; each is known to within so many times its
    scale.
    """
    unknowns = unknowns_of(Model.of(vessel), 1, IdentifySettings(free=free))
    variance = (std * np.array([u.scale for u in unknowns.each])) ** 2
    known = Uncertainty(np.diag(1.0 / variance), np.diag(variance), 2.0)
    names = [u.name for u in unknowns.each]
    z = np.array([at.get(name, x) for name, x in zip(names, unknowns.start, strict=True)])
    return {e.name: e for e in estimates_of(unknowns, z, known, ["trial"], filtered)}


def test_an_interval_holds_no_number_that_no_boat_has() -> None:
    """Damping takes energy out, and a mass is one; an offset may lie on either side."""
    vague = estimates(3.0)
    assert all(vague[name].ci95[1] == 0.0 for name in DAMPING)
    assert all(vague[name].ci95[0] == 0.0 for name in MASSES)
    assert vague[OFFSETS[0]].ci95[0] < 0.0 < vague[OFFSETS[0]].ci95[1]


def test_an_interval_that_needs_no_limit_is_symmetric() -> None:
    for name in (*DAMPING, *MASSES):
        e = estimates(0.01)[name]
        assert sum(e.ci95) == pytest.approx(2.0 * e.value)
        assert e.ci95[0] < e.value < e.ci95[1]


def test_of_an_autopilots_motion_no_number_of_the_hull_is_known_better_than_its_filter() -> None:
    """An Otter in the loop with ArduRover came out up to 2.5 % off, in intervals of 0.6 %."""
    item = added(named("learned_drag"))
    free = (*BASE, "learned_drag.more")
    narrow, wide = (
        estimates(1e-6, WAMV.with_effects(item), free, filtered=share) for share in (0.0, 0.01)
    )
    for name in BASE:
        half = 0.5 * (wide[name].ci95[1] - wide[name].ci95[0])
        assert half == pytest.approx(0.0196 * abs(wide[name].value), rel=1e-3)
        assert wide[name].identifiable
    for name in (OFFSETS[0], "learned_drag.more"):
        assert wide[name].ci95 == narrow[name].ci95


def test_only_motion_of_an_autopilots_filter_is_taken_for_such() -> None:
    trial = noisy(WAMV, 30.0)
    settings = IdentifySettings()
    assert settings.with_motion_of([trial]).filtered == 0.0
    assert settings.with_motion_of([trial, replace(trial, filtered=True)]).filtered == FILTERED_STD


def test_an_interval_of_what_an_effect_declares_to_begin_at_zero_does_not_reach_below() -> None:
    """More drag in a place is more; the place itself may lie on either side of the origin."""
    item = added(named("learned_drag"))
    names = tuple(f"learned_drag.{key}" for key in ("more", "north"))
    vague = estimates(20.0, WAMV.with_effects(item), names)
    assert vague["learned_drag.more"].ci95[0] == 0.0
    assert vague["learned_drag.north"].ci95[0] < 0.0


@pytest.mark.parametrize("direction", [-2.0, -0.05, 0.05, 2.0])
def test_an_interval_of_a_direction_may_lie_to_west_as_to_east(direction: float) -> None:
    """Only the speed of a pair begins at zero: a direction below zero once had 0 as its lower end,
    above its upper one.
    """
    item = AddedEffect(named("steady_current"), {"speed": 0.3, "direction": direction})
    found = estimates(0.5, WAMV.with_effects(item), ("steady_current.*",))
    e = found["steady_current.direction"]
    assert sum(e.ci95) == pytest.approx(2.0 * direction)
    assert e.ci95[0] < direction < e.ci95[1]
    assert found["steady_current.speed"].ci95[0] >= 0.0


def test_an_interval_of_a_large_boat_grows_with_what_is_not_known_of_her() -> None:
    """Numbers that are no angles are not folded at π: a ship's differences are larger than that."""
    dynamics = replace(WAMV.dynamics, m33=5e7)
    unknowns = unknowns_of(Model.of(replace(WAMV, dynamics=dynamics)), 1, IdentifySettings())
    names = [u.name for u in unknowns.each]
    variance = np.diag(np.array([0.1 * u.scale for u in unknowns.each]) ** 2)
    told = named_covariance(unknowns, unknowns.start, variance)
    i = names.index("m33")
    assert np.sqrt(told[i, i]) == pytest.approx(0.1 * unknowns.each[i].scale)
    assert np.sqrt(told[i, i]) > 1e5


@pytest.mark.parametrize("name", OFFSETS)
def test_an_offset_at_its_lower_limit_is_early_and_at_its_upper_limit_late(name: str) -> None:
    early = estimates(0.01, **{name: -OFFSET_LIMIT_S})[name].doubt
    late = estimates(0.01, **{name: OFFSET_LIMIT_S})[name].doubt
    assert "sooner than telemetry can explain" in early
    assert "later" not in early
    assert "later than telemetry can explain (" in late
