"""Fits without parts of the time, fits that begin anew, and the moments of events."""

from dataclasses import replace

import numpy as np
import pytest

from sim.diagnosis import thresholds
from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit import (
    Fit,
    event_interval,
    event_names,
    final_fit,
    fit_effects,
    from_given_base,
    is_needed,
    may_join,
    start_values,
    unknowns_for,
    with_event_moved,
    with_given_base,
)
from sim.diagnosis.fit_problem import FitProblem, SupersetModel
from sim.diagnosis.screening import screen
from sim.effects.catalogue import named
from sim.identification import BASE
from sim.model import Model
from sim.state import Floats
from sim.trial import Trial
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import DT, STD, sailed
from tests.sim.voyages import WAM_V, commands, trial_of

BEND = 4.0  # standard deviations, where a residual begins to count less


@pytest.fixture(scope="module")
def fit() -> Fit:
    """The base on a voyage that it explains."""
    return fit_base(SupersetModel.of(WAM_V, ()), Model.of(WAM_V), [sailed()], DiagnoseSettings())


def added(*names: str) -> list[AddedEffect]:
    return [AddedEffect(named(n), {p.name: p.start for p in named(n).parameters}) for n in names]


@pytest.mark.parametrize(
    ("name", "present", "may"),
    [
        ("crossing_waves", [], False),  # a second train is none without the first
        ("crossing_waves", ["hull_lift"], False),
        ("crossing_waves", ["hull_lift", "wave_motion"], True),
        ("crossing_waves", ["wave_motion", "crossing_waves"], False),
        ("wave_motion", [], True),
        ("steady_current", ["current_change"], False),  # held by it
        ("current_change", ["steady_current"], False),
    ],
)
def test_what_may_stand_beside_what_is_there(name: str, present: list[str], may: bool) -> None:
    assert may_join(named(name), added(*present)) is may


def test_the_first_train_is_needed_while_the_second_is_there() -> None:
    assert is_needed(named("wave_motion"), added("wave_motion", "crossing_waves"))
    assert not is_needed(named("wave_motion"), added("wave_motion", "hull_lift"))
    assert not is_needed(named("crossing_waves"), added("wave_motion", "crossing_waves"))


def cost(fit: Fit, z: Floats, rows: Floats) -> float:
    """Pseudo-Huber cost of some rows, and of leaving what was given."""
    r = fit.at(z[None])[0][rows]
    prior = np.array([u.prior for u in fit.unknowns.each])
    left = np.sum(((z - fit.unknowns.start) / prior) ** 2)
    return float(2.0 * BEND**2 * np.sum(np.sqrt(1.0 + (r / BEND) ** 2) - 1.0) + left)


@pytest.mark.parametrize("m33", [1.0, 0.6, 2.5])
def test_no_refit_fits_its_own_rows_worse(fit: Fit, m33: float) -> None:
    """Wherever it begins: far off a whole step may leave the track."""
    z = fit.z.copy()
    z[[u.name for u in fit.unknowns.each].index("m33")] *= m33
    begun = replace(fit, z=z, residual=fit.at(z[None])[0])
    for (seen, _), refit in zip(begun.problem.folds, begun.fold_fits.z, strict=True):
        assert cost(fit, refit, seen) <= cost(fit, z, seen) * (1.0 + 1e-9)
    np.testing.assert_allclose(begun.fold_fits.residual, fit.at(begun.fold_fits.z))


def test_a_stiff_hull_is_screened_on_fewer_rows(fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of its rows takes many integration steps; a hull that is none loses no row."""
    asked: list[int] = []

    def thinned(problem: FitProblem, rows: int) -> FitProblem:
        asked.append(rows)
        return problem

    monkeypatch.setattr(FitProblem, "thinned", thinned)
    given = [replace(u, start=100.0 * u.start) if u.name == "N_r" else u for u in fit.unknowns.each]
    z = fit.z.copy()
    z[[u.name for u in given].index("N_r")] *= 100.0
    stiff = replace(fit, z=z, unknowns=replace(fit.unknowns, each=tuple(given)))
    superset = SupersetModel.of(WAM_V, ())
    screen(superset, fit.model(), [], fit)
    assert asked == [thresholds.SCREENED_ROWS, thresholds.COARSE_ROWS]
    asked.clear()
    screen(superset, fit.model(), [], stiff)
    stiffness = stiff.problem.stiffness(stiff.unknowns, stiff.z)
    assert stiffness == pytest.approx(2.0)
    assert max(asked) == round(thresholds.SCREENED_ROWS / stiffness)
    asked.clear()
    monkeypatch.setattr(FitProblem, "stiffness", lambda *_: 50.0)  # as of a lag of a millisecond
    screen(superset, fit.model(), [], fit)
    assert min(asked) == round(thresholds.MIN_SCREENED_SHARE * thresholds.COARSE_ROWS)


def test_a_fit_without_a_part_is_near_the_fit_with_it(fit: Fit) -> None:
    prior = np.array([u.prior for u in fit.unknowns.each])
    told = np.linalg.inv(fit.jacobian.T @ fit.jacobian + np.diag(prior**-2.0))
    base = [u.name in BASE for u in fit.unknowns.each]
    off = np.abs(fit.fold_fits.z - fit.z) / np.sqrt(np.diag(told))
    assert np.all(off[:, base] < 2.0)
    assert np.any(fit.fold_fits.z != fit.z)


def test_a_base_that_went_far_begins_again_where_it_was_given(fit: Fit) -> None:
    unknowns = fit.unknowns
    names = [u.name for u in unknowns.each]
    assert with_given_base(unknowns, unknowns.start) is None
    z = unknowns.start + 0.01
    i = names.index("X_u")
    z[i] = unknowns.start[i] + 1.1 * thresholds.RESTART_SIGMAS * unknowns.each[i].prior
    again = with_given_base(unknowns, z)
    assert again is not None
    base = np.array([name in BASE for name in names])
    np.testing.assert_array_equal(again[base], unknowns.start[base])
    np.testing.assert_array_equal(again[~base], z[~base])


def test_from_the_base_as_given_the_effects_are_fitted_before_it_moves() -> None:
    """A hull bent far, with a current that sets the other way: back to the true current."""
    current = named("steady_current")
    trial = sailed("steady_current", speed=0.3, direction=0.6)
    superset = SupersetModel.of(WAM_V, (current,))
    base = fit_base(superset, Model.of(WAM_V), [trial], DiagnoseSettings())
    added = [AddedEffect(current, {"speed": 0.3, "direction": 0.6 + np.pi})]
    unknowns = unknowns_for(superset, added, 1, base.problem.settings)
    is_base = np.array([u.name in BASE for u in unknowns.each])
    near = unknowns.start.copy()
    assert from_given_base(added, unknowns, base.problem, near) is None
    far = np.where(is_base, unknowns.bounds[0], near)
    again = from_given_base(added, unknowns, base.problem, far)
    assert again is not None
    np.testing.assert_allclose(again[is_base], near[is_base], rtol=1e-3)
    found = unknowns.to_named(again)[[u.name.startswith("steady") for u in unknowns.each]]
    np.testing.assert_allclose(found, [0.3, 0.6], rtol=0.05)


FAULT = named("thruster_fault")
NAME = "thruster_fault.time"


def failing(at: float, rest: tuple[float, float] = (0.0, 0.0)) -> Trial:
    """The port thruster weakens at that time; it rests meanwhile [s, s]."""
    drive = commands(200.0, DT, 3)
    drive[round(rest[0] / DT) : round(rest[1] / DT), 0] = 0.0
    fault = AddedEffect(FAULT, {"thruster": 1.0, "gain": 0.4, "time": at})
    _, reports = Model.of(WAM_V.with_effects(fault)).simulate(drive, DT)
    motion = reports[0, :-1] + np.random.default_rng(1).normal(0.0, STD, (len(drive), 9))
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, DT, np.diag(STD**2))


def fit_of(trial: Trial, time: float) -> Fit:
    """A fault fitted at about that time."""
    superset, settings = SupersetModel.of(WAM_V, [FAULT]), DiagnoseSettings()
    base = fit_base(superset, Model.of(WAM_V), [trial], settings)
    added = [AddedEffect(FAULT, {"thruster": 1.0, "gain": 0.5, "time": time})]
    unknowns = unknowns_for(superset, added, 1, base.problem.settings)
    return fit_effects(added, unknowns, base.problem, start_values(unknowns, base))


@pytest.fixture(scope="module")
def off() -> Fit:
    return fit_of(failing(93.0), 95.0)


@pytest.mark.slow
def test_what_is_known_of_a_coefficient_does_not_follow_the_fit() -> None:
    """It begins where an earlier fit ended; what was known beforehand stays what it was."""
    wind, settings = named("steady_wind"), DiagnoseSettings().identify(WAM_V)
    superset = SupersetModel.of(WAM_V, [wind])
    known = {p.name: p for p in wind.parameters if p.prior}
    found = AddedEffect(
        wind, {"speed": 8.0, "direction": 1.0, "c_x": 0.9, "c_n": 0.05, "centre": 0.1}
    )
    unknowns = {u.name: u for u in unknowns_for(superset, [found], 1, settings).each}
    assert set(known) == {"c_x", "c_n", "centre"}
    for key, p in known.items():
        own = unknowns[f"steady_wind.{key}"]
        assert (own.start, own.prior, own.assumed) == (p.start, p.prior, False)
    speed = unknowns["steady_wind.speed"]
    assert speed.assumed  # nothing is known of it
    assert speed.start == 8.0


@pytest.mark.slow
def test_events_are_moments() -> None:
    trial = failing(93.0)
    assert event_names(fit_of(trial, 95.0)) == (NAME,)
    bare = fit_base(SupersetModel.of(WAM_V, []), Model.of(WAM_V), [trial], DiagnoseSettings())
    assert event_names(bare) == ()


@pytest.mark.slow
def test_an_event_is_moved_to_where_the_data_have_it(off: Fit) -> None:
    on = with_event_moved(off, NAME)
    assert on.values("thruster_fault")["time"] == pytest.approx(93.0, abs=0.3)
    assert np.sum(on.residual**2) < np.sum(off.residual**2)
    assert off.values("thruster_fault")["time"] == 95.0  # nothing is changed in place


def test_its_interval_holds_it_and_is_short_while_the_motor_works(off: Fit) -> None:
    low, high = event_interval(with_event_moved(off, NAME), NAME)
    assert low <= 93.0 <= high
    assert high - low < 2.0


def test_an_event_that_stands_beside_is_not_told_for_sure(off: Fit) -> None:
    low, high = event_interval(off, NAME)
    assert low <= 93.0
    assert high >= 95.0


def test_while_the_motor_rests_nobody_can_tell() -> None:
    low, high = event_interval(
        with_event_moved(fit_of(failing(93.0, (86.0, 98.0)), 92.0), NAME), NAME
    )
    assert low < 88.0
    assert high > 96.0


def test_the_last_fit_has_the_numbers_and_the_moment(off: Fit) -> None:
    last = final_fit(off)
    found = last.values("thruster_fault")
    assert found["time"] == pytest.approx(93.0, abs=0.3)
    assert found["gain"] == pytest.approx(0.4, abs=0.02)


def test_an_event_that_stands_after_the_trial_is_looked_for_at_its_ends() -> None:
    low, high = event_interval(fit_of(sailed(), 1000.0), NAME)
    assert 0.0 <= low <= high <= 200.0
