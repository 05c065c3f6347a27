"""Files with one mistake: what is wrong in them is what is said to be, and all else is right."""

from pathlib import Path

import pytest

from benchmarks.mistakes import FAR, KINDS, is_right, mistakes, write
from gateway.vessel_file import load_vessel


def test_a_case_is_the_same_whatever_else_is_run_and_other_dice_are_other_cases() -> None:
    for kind in KINDS:
        for beside in (False, True):
            assert list(mistakes(kind, beside)) == list(mistakes(kind, beside))
            assert list(mistakes(kind, beside, 1)) != list(mistakes(kind, beside))
            assert all(bool(case.hidden) is beside for case in mistakes(kind, beside))
    factors = [f for case in mistakes("number", False) for f in case.wrong.values()]
    assert all(FAR[0] <= max(f, 1.0 / f) <= FAR[1] for f in factors)
    assert min(factors) < 1.0 < max(factors)


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_is_wrong_in_that_alone(tmp_path: Path, kind: str) -> None:
    case = next(mistakes(kind, False))
    _, file = write(case, tmp_path)
    vessel = load_vessel(file)
    for name in ("m11", "m22", "m33", "X_u", "X_uu", "Y_v", "Y_vv", "N_r", "N_rr"):
        right = getattr(case.boat.hull, name)
        assert getattr(vessel.dynamics, name) == pytest.approx(case.wrong.get(name, 1.0) * right)
    for motor, thruster in zip(case.boat.motors, vessel.thrusters, strict=True):
        assert thruster.position[0] == pytest.approx(case.wrong.get("x", 1.0) * motor.x)
        assert thruster.thrust[1] == pytest.approx(case.wrong.get("thrust", 1.0) * motor.ahead)


def test_right_is_who_names_what_is_there_and_nothing_else() -> None:
    case = next(mistakes("unit", True))
    names = ["thrust_scale", "steady_current"]
    assert case.effects == set(names)
    assert is_right(case, {"effects": names, "verdict": "explained"})
    assert not is_right(case, {"effects": names, "verdict": "unknown"})
    assert not is_right(case, {"effects": names[:1], "verdict": "explained"})
    assert not is_right(case, {"effects": [*names, "hull_lift"], "verdict": "explained"})
