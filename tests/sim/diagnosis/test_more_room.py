"""Numbers of a file that are far off are told as that, and no effect stands in for them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from sim.diagnosis.answer import LadderStep, StepBase, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, _further_off, diagnose
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
    step = LadderStep((), StepBase.REFITTED, HeldOutScore(0.2, None), numbers, {}, WAM_V)
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
        # numbers that are bent to go with what nobody knows are not off
        (answer(Verdict.UNKNOWN, 0.1), answer(Verdict.UNKNOWN, 0.2, "a"), False),
        # who knew does not unlearn it
        (answer(Verdict.UNKNOWN, 0.1), answer(Verdict.EXPLAINED, 0.1, "a"), False),
        (answer(Verdict.UNKNOWN, 0.05, "b"), answer(Verdict.EXPLAINED, 0.1, "a"), False),
        (answer(Verdict.UNKNOWN, 0.1, "a"), answer(Verdict.UNKNOWN, 0.2), False),
    ],
)
def test_more_room_has_to_say_as_much_with_less(wide: Any, first: Any, simpler: bool) -> None:
    assert is_simpler(wide, first) is simpler


def told(first: Any, *effects: str, known: bool = True, **values: float) -> str:
    """What is said of a second answer with these effects and numbers that were 10."""
    numbers = tuple(
        replace(number(name, 10.0, value), identifiable=known) for name, value in values.items()
    )
    step = LadderStep((), StepBase.REFITTED, HeldOutScore(0.1, None), numbers, {}, WAM_V)
    second: Any = SimpleNamespace(ladder=[step], effects=effects)
    return _further_off(first, second, 0.45)


def test_it_is_said_which_numbers_are_off_and_what_stood_in_for_them() -> None:
    explained = answer(Verdict.EXPLAINED, 0.12, "thrust_scale", "steady_current")
    assert told(explained, "steady_current", m33=3.0, m11=13.0) == (
        "m33 of the file is off by more than 45 %, else thrust_scale would stand in"
    )
    assert told(explained, "steady_current", m33=14.0) == ""  # within what it was trusted to be
    assert told(explained, "steady_current", known=False, m33=3.0) == ""  # nobody can tell
    left = "X_u, X_uu of the file are off by more than 45 %: with less room for them the error was"
    assert told(explained, "thrust_scale", "steady_current", X_u=4.0, X_uu=25.0) == f"{left} 0.120"
    unknown = answer(Verdict.UNKNOWN, 0.5, "hull_lift")  # which was not told as the cause
    assert told(unknown, X_u=4.0, X_uu=25.0) == f"{left} 0.500"


@pytest.mark.slow
@pytest.mark.parametrize("current", [False, True])
def test_a_moment_of_inertia_three_times_too_large_is_no_stronger_motor(current: bool) -> None:
    trial = sailed("steady_current", speed=0.3, direction=1.0) if current else sailed()
    given = replace(WAM_V, dynamics=replace(WAM_V.dynamics, m33=3.0 * WAM_V.dynamics.m33))
    found = diagnose([trial], given, FEW)
    assert found.effects == (("steady_current",) if current else ())
    assert found.prior == 1.0
    assert found.vessel.dynamics.m33 == pytest.approx(WAM_V.dynamics.m33, rel=0.05)
    assert "m33 of the file is off by more than 45 %" in found.summary


@pytest.mark.parametrize(("recordings", "prior"), [(3, 1.0), (7, DiagnoseSettings().prior)])
def test_of_few_recordings_too_a_number_that_is_far_off_is_told(
    recordings: int, prior: float
) -> None:
    """Three voyages with a wrong number were "something … the catalogue does not hold"."""
    trials = [
        replace(sailed(None, 60.0, seed + 1), name=f"day {seed}") for seed in range(recordings)
    ]
    given = replace(WAM_V, dynamics=replace(WAM_V.dynamics, X_u=3.0 * WAM_V.dynamics.X_u))
    few = replace(FEW, effects=(named("thrust_scale"), named("hull_lift")))
    found = diagnose(trials, given, few)
    assert found.prior == prior
    assert ("X_u of the file is off by more than 45 %" in found.summary) is (prior == 1.0)


@pytest.mark.slow
def test_a_file_that_is_right_is_looked_at_once() -> None:
    found = diagnose([sailed()], WAM_V, FEW)
    assert found.prior == DiagnoseSettings().prior
    assert "of the file" not in found.summary


@pytest.mark.slow
def test_who_says_how_far_the_numbers_may_be_off_is_believed() -> None:
    given = replace(WAM_V, dynamics=replace(WAM_V.dynamics, m33=3.0 * WAM_V.dynamics.m33))
    found = diagnose([sailed()], given, replace(FEW, trusted=True))
    assert found.prior == FEW.prior
    assert numbers_at_limit(found.ladder[-1], FEW.prior)
