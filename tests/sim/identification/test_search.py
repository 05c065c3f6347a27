"""The search that all fits share, on problems whose answer is known in closed form."""

import numpy as np
import pytest

from sim.effects.catalogue import named
from sim.identification import IdentifySettings
from sim.identification.parameters import Unknown, UnknownNameError, Unknowns, unknowns_of
from sim.identification.search import (
    DAMPING,
    SearchLimits,
    damped_steps,
    residuals_and_jacobian,
    search,
)
from sim.model import Model
from tests.sim.vessels import WAMV, added

A = np.array([[1.0, 2.0], [0.5, -1.0], [3.0, 0.1], [0.2, 0.4]])
B = np.array([1.0, -2.0, 0.5, 3.0])


def straight(z):
    """z (K, 2) -> residuals (K, 4), linear in z."""
    return z @ A.T - B


def unknowns(*each):
    return Unknowns(Model.of(WAMV), each)


def one(name, lower=-10.0, upper=10.0, prior=np.inf, trial=None):
    return Unknown(name, "", 0.0, lower, upper, 1.0, 1e-3, prior, trial=trial)


def of_trials(each):
    """z (K, 2) of each trial -> the same residuals of each."""
    return [straight(z) for z in each]


def slope_in(both):
    return lambda z: residuals_and_jacobian(of_trials, [0], both, z)[1]


@pytest.mark.parametrize("iterative", [False, True])
def test_priors_count_as_further_rows(iterative):
    both = unknowns(one("a", prior=0.5), one("b"))
    ends = SearchLimits(1e3, 30, change=1e-10, iterative=iterative)
    found = search(straight, slope_in(both), both, np.zeros(2), ends)
    rows = np.vstack([A, [2.0, 0.0]])
    expected = np.linalg.lstsq(rows, np.append(B, 0.0), rcond=None)[0]
    assert found.x == pytest.approx(expected, abs=1e-6)
    assert len(found.fun) == len(B) + 1  # without a prior there is no row


def test_a_start_beyond_the_limits_is_taken_inside():
    both = unknowns(one("a", lower=-0.2, upper=0.2), one("b", lower=-0.2, upper=0.2))
    found = search(straight, slope_in(both), both, np.array([5.0, -5.0]), SearchLimits(1e3, 30))
    assert np.all(np.abs(found.x) <= 0.2)


def test_no_step_leaves_the_limits():
    seen = []

    def residuals(each):
        seen.extend(each)
        return of_trials(each)

    both = unknowns(one("a", upper=1.0), one("b"))
    left, slope = residuals_and_jacobian(residuals, [0], both, np.array([1.0, 0.0]))
    assert np.concatenate(seen)[:, 0].max() <= 1.0
    assert left == pytest.approx(A[:, 0] - B)
    assert slope == pytest.approx(A, abs=1e-9)


def test_a_recording_has_no_slope_along_the_numbers_of_another():
    both = unknowns(one("a"), one("b", trial=1))
    runs = []

    def residuals(each):
        runs.extend(len(z) for z in each)
        return of_trials(each)

    _, slope = residuals_and_jacobian(residuals, [0, 1], both, np.zeros(2))
    assert slope[:4, 1] == pytest.approx(np.zeros(4))
    assert slope[4:] == pytest.approx(A, abs=1e-9)
    assert runs == [2, 3]  # nor is it run for them


def test_only_some_columns_are_worked_out_if_so_asked():
    both = unknowns(one("a"), one("b"))
    _, slope = residuals_and_jacobian(of_trials, [0], both, np.zeros(2), np.array([1]))
    assert slope == pytest.approx(A * [0.0, 1.0], abs=1e-9)


def test_residuals_that_are_at_hand_are_not_worked_out_again():
    both, runs = unknowns(one("a"), one("b")), []

    def residuals(each):
        runs.extend(len(z) for z in each)
        return of_trials(each)

    left, slope = residuals_and_jacobian(residuals, [0], both, np.zeros(2), known=-B)
    assert left == pytest.approx(-B)
    assert slope == pytest.approx(A, abs=1e-9)
    assert runs == [2]
    nothing = np.array([], np.int64)  # a trial without a number of its own is run as it is
    left, _ = residuals_and_jacobian(residuals, [0], both, np.zeros(2), nothing, known=-B)
    assert left == pytest.approx(-B)


WEIGHT = np.array([1.0, 0.5, 0.2, 0.9])


def steps(slope=A, prior=np.inf, z=(0.0, 0.0)):
    both, at = unknowns(one("a", prior=prior), one("b")), np.array(z)
    return damped_steps(both, at, slope @ at - B, slope, WEIGHT)


def test_the_first_step_is_not_damped_and_ends_where_weighted_rows_and_priors_are_least():
    root = np.sqrt(WEIGHT)
    rows = np.vstack([root[:, None] * A, [2.0, 0.0]])
    expected = np.linalg.lstsq(rows, np.append(root * B, 0.0), rcond=None)[0]
    assert DAMPING[0] == 0.0
    assert np.array([1.0, -3.0]) + steps(prior=0.5, z=(1.0, -3.0))[0] == pytest.approx(expected)


def test_damping_holds_back_what_the_rows_hardly_tell_and_leaves_the_rest_its_step():
    """Two numbers that act nearly alike: their sum is told, their difference is not."""
    alike = np.outer(A[:, 0], [1.0, 1.0]) + 1e-3 * np.outer(A[:, 1], [1.0, -1.0])
    whole, *damped = steps(slope=alike)
    apart, together = np.array([1.0, -1.0]), np.array([1.0, 1.0])
    alone = A[:, 0] @ (WEIGHT * B) / (A[:, 0] @ (WEIGHT * A[:, 0]))
    assert abs(whole @ apart) > 100.0
    assert abs(damped[0] @ apart) < 1.0
    assert damped[0] @ together == pytest.approx(alone, rel=0.01)


def test_what_no_row_tells_does_not_move():
    blind = A * [1.0, 0.0]
    assert steps(slope=blind)[:, 1] == pytest.approx(np.zeros(len(DAMPING)))
    assert np.all(steps(slope=blind)[:, 0] != 0.0)


@pytest.mark.parametrize(
    ("name", "moved"),
    [
        ("learned", {"x", *(f"f{k}" for k in range(9))}),
        ("thruster_fault", {"gain"}),
        ("steady_current", {"speed", "direction"}),
    ],
)
def test_all_of_an_effect_is_what_a_fit_can_move(name, moved):
    """No choice, no moment, no range of a table: no slope leads to those."""
    vessel = WAMV.with_effects(added(named(name)))
    settings = IdentifySettings(free=(f"{name}.*",), offsets=False)
    free = unknowns_of(Model.of(vessel), 1, settings).each
    assert {u.name for u in free} == {f"{name}.{key}" for key in moved}


def test_an_effect_of_choices_alone_has_nothing_to_fit():
    vessel = WAMV.with_effects(added(named("actuator_wiring")))
    with pytest.raises(UnknownNameError, match="actuator_wiring"):
        unknowns_of(Model.of(vessel), 1, IdentifySettings(free=("actuator_wiring.*",)))
