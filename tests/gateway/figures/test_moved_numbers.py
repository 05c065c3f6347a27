"""What is said of base numbers that had to move: which, how far, and whether all of them alike."""

from dataclasses import replace

import pytest

from gateway.figures.words import moved_numbers
from sim.diagnosis.answer import LadderStep, StepBase
from sim.diagnosis.heldout import HeldOutScore
from sim.identification.intervals import Estimate
from tests.sim.voyages import WAM_V

ALIKE = {"m11": 1.4, "m22": 1.38, "X_uu": 1.45, "N_r": 1.5}
SENTENCE = "all alike, as if the motors gave"


def moved(half: float = 0.05, **factors: float) -> str:
    """Numbers of a hundred that changed by these factors; `half` of each 95 % interval."""
    numbers = tuple(
        Estimate(name, "kg", 100.0, 100.0 * f, (100.0 * (f - half), 100.0 * (f + half)), True)
        for name, f in factors.items()
    )
    return moved_numbers(_step(*numbers))


def _step(*numbers: Estimate) -> LadderStep:
    return LadderStep((), StepBase.REFITTED, HeldOutScore(0.2, None), numbers, {}, WAM_V)


def test_only_what_left_its_interval_is_told_the_furthest_first() -> None:
    assert moved(m11=1.04, X_u=0.97) == ""
    assert moved(m11=1.1, X_u=0.8, rounding=9.0) == (
        "X_u 100 → 80 kg (-20 %), m11 100 → 110 kg (+10 %)"
    )
    assert moved(**ALIKE, Y_v=3.0).count("→") == 4


def test_from_next_to_nothing_no_percentage_is_told() -> None:
    told = moved_numbers(_step(Estimate("X_uu", "N s²/m²", -7.5e-11, -1.4, (-1.5, -1.3), True)))
    assert told == "X_uu -7.5e-11 → -1.4 N s²/m²"


def test_all_alike_are_as_if_the_motors_gave_less() -> None:
    assert moved(**ALIKE).endswith(f"{SENTENCE} 70 % of what the file says")
    assert moved(m33=0.8, X_u=0.82, Y_v=0.78, N_r=0.8).endswith("125 % of what the file says")
    assert SENTENCE not in moved(0.001, m33=1.02, X_u=1.015, Y_v=1.02, N_r=1.01)  # as good as right


YAW = {"m33": 0.6, "N_r": 0.62, "N_rr": 0.58}
ARMS = "those of yaw alike, as if what turns her gave 167 % of the moment in the file"


def test_those_of_yaw_alike_are_as_if_the_arms_of_the_motors_were_longer() -> None:
    assert ARMS in moved(**YAW, m11=1.02, X_u=0.97)
    assert ARMS in moved(m33=0.6, N_r=0.6, X_uu=1.01)  # a file without N_rr


@pytest.mark.parametrize(
    "other",
    [
        {"N_r": 0.9},  # damping did not go with the inertia
        {"m33": 1.0},  # damping alone
        {"m11": 0.75},  # she is another boat
        {"m33": 0.9, "N_r": 0.9, "N_rr": 0.9},  # not far
        {"half": 0.5},  # nothing is known to have moved
    ],
)
def test_what_turns_her_is_not_called_weaker_where_it_is_not(other: dict[str, float]) -> None:
    assert "what turns her" not in moved(**(YAW | {"m11": 1.02, "X_u": 0.97} | other))


def test_a_boat_that_only_her_rudder_turns_is_not_asked_about_the_arms_of_motors() -> None:
    numbers = [
        Estimate(n, "kg", 100.0, 100.0 * f, (99.0 * f, 101.0 * f), True) for n, f in YAW.items()
    ]
    numbers.append(Estimate("m11", "kg", 100.0, 100.0, (99.0, 101.0), True))
    step = _step(*numbers)
    middle = replace(WAM_V.thrusters[0], position=(-1.0, 0.0))
    alone = replace(step, vessel=replace(WAM_V, thrusters=(middle,)))
    assert "(arms of the motors?)" in moved_numbers(step)
    assert moved_numbers(alone).endswith("of the moment in the file")


@pytest.mark.parametrize(
    "other",
    [
        {"m22": 0.7},  # one went the other way
        {"N_r": 2.0},  # one much further
        {"m11": 1.0, "m22": 1.0},  # damping alone: a hull that is fouled
    ],
)
def test_what_differs_is_not_called_alike(other: dict[str, float]) -> None:
    assert SENTENCE not in moved(**(ALIKE | other))
    assert SENTENCE not in moved(half=0.6, **ALIKE)  # nothing is known to have moved
