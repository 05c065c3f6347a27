"""Numbers of a file that are far off are told as that, and no effect stands in for them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from sim.diagnosis.answer import LadderStep, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose
from sim.diagnosis.heldout import HeldOutScore
from sim.diagnosis.more_room import is_simpler, numbers_at_limit
from sim.effects.catalogue import named
from sim.identification.intervals import Estimate
from tests.sim.diagnosis.sailed import sailed
from tests.sim.voyages import WAM_V

FEW = DiagnoseSettings(
    effects=tuple(map(named, ("steady_current", "thrust_scale", "hull_lift", "antenna_offset")))
)


def number(name: str, before: float, value: float) -> Estimate:
    return Estimate(name, "kg", before, value, (value, value), True)


def test_numbers_at_their_limit_are_those_that_went_as_far_as_their_prior_allows() -> None:
    numbers = (
        number("m11", 100.0, 145.0),
        number("X_u", -10.0, -5.6),  # 44 %
        number("N_r", -10.0, -5.5),
        number("Y_vv", 0.0, -9.0),  # of nothing there is no share
        number("rounding", 1.0, 9.0),  # none of the base
    )
    step = LadderStep((), "refitted", HeldOutScore(0.2, None), numbers, {}, WAM_V)
    assert numbers_at_limit(step, 0.15) == ["m11", "N_r"]
    assert numbers_at_limit(step, 0.1) == ["m11", "X_u", "N_r"]
    assert numbers_at_limit(step, 1.0) == []


def answer(verdict: Verdict, error: float, *effects: str, floor: float = 0.1) -> Any:
    ladder = [SimpleNamespace(heldout=HeldOutScore(error, None))]
    return SimpleNamespace(verdict=verdict, ladder=ladder, effects=effects, noise_floor=floor)


@pytest.mark.parametrize(
    ("wide", "first", "simpler"),
    [
        (answer(Verdict.ADEQUATE, 0.1), answer(Verdict.EXPLAINED, 0.12, "thrust_scale"), True),
        (answer(Verdict.ADEQUATE, 0.1), answer(Verdict.EXPLAINED, 0.1, "thrust_scale"), True),
        # an effect is more than a number that is off, where it predicts better
        (answer(Verdict.ADEQUATE, 0.12), answer(Verdict.EXPLAINED, 0.1, "cubic_drag"), False),
        (answer(Verdict.EXPLAINED, 0.1, "a"), answer(Verdict.EXPLAINED, 0.101, "b"), False),
        (answer(Verdict.EXPLAINED, 0.1, "a"), answer(Verdict.EXPLAINED, 0.2, "b"), True),
        (answer(Verdict.EXPLAINED, 0.1, "a", "c"), answer(Verdict.EXPLAINED, 0.2, "b"), False),
        (answer(Verdict.EXPLAINED, 0.1, "a"), answer(Verdict.UNKNOWN, 0.2), True),
        (answer(Verdict.EXPLAINED, 0.2, "a"), answer(Verdict.UNKNOWN, 0.1), False),
        (answer(Verdict.UNKNOWN, 0.1), answer(Verdict.UNKNOWN, 0.2, "a"), True),
        (answer(Verdict.UNKNOWN, 0.1, "a"), answer(Verdict.UNKNOWN, 0.2), False),
    ],
)
def test_more_room_has_to_say_as_much_with_less(wide: Any, first: Any, simpler: bool) -> None:
    assert is_simpler(wide, first) is simpler


@pytest.mark.slow
@pytest.mark.parametrize("current", [False, True])
def test_a_moment_of_inertia_three_times_too_large_is_no_stronger_motor(current: bool) -> None:
    trial = sailed("steady_current", speed=0.3, direction=1.0) if current else sailed()
    given = replace(WAM_V, dynamics=replace(WAM_V.dynamics, m33=3.0 * WAM_V.dynamics.m33))
    found = diagnose([trial], given, FEW)
    assert found.effects == (("steady_current",) if current else ())
    assert found.prior == 1.0
    assert found.vessel.dynamics.m33 == pytest.approx(WAM_V.dynamics.m33, rel=0.05)
    assert "numbers of the file are off by more than 45 %" in found.summary


@pytest.mark.slow
def test_a_file_that_is_right_is_looked_at_once() -> None:
    found = diagnose([sailed()], WAM_V, FEW)
    assert found.prior == DiagnoseSettings().prior
    assert "numbers of the file" not in found.summary
