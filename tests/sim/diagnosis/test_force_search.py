"""Several causes at once, told from missing forces: voyages by physics written anew."""

from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis import force_search, thresholds
from sim.diagnosis.diagnose import DiagnoseSettings, fit_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.force_search import (
    ForceProblem,
    acts_at_once,
    fit_under_its_noise,
    in_place_by_forces,
    search_forces,
)
from sim.effects.catalogue import EFFECTS, named
from sim.effects.effect import Effect
from sim.model import Model
from sim.trial import Trial
from sim.vessel import AddedEffect
from tests.sim.voyages import WAM_V, commands, trial_of, voyage

DT = 0.1
FAILS = 130.0  # s, when the left motor loses half
ASKED = (
    "thruster_fault", "steady_current", "current_change", "heading_offset", "thruster_imbalance",
    "advance_loss", "payload_change",
)  # fmt: skip
STD = np.array([0.02, 0.02, 0.005, 0.01, 0.01, 0.002, 0.02, 0.02, 0.01])


def day(fails: bool, current: tuple[float, float], heading_off: float) -> Trial:
    """Five minutes; the left motor keeps half from one moment on, the compass is off [rad]."""
    told = commands(300.0, DT)
    kept = np.ones_like(told)
    if fails:
        kept[round(FAILS / DT) :, 0] = 0.5
    eta, nu, nu_dot, _ = voyage(300.0, DT, current=current, kept=kept)
    c, s = np.cos(heading_off), np.sin(heading_off)
    to_heading = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    motion = np.concatenate(
        [eta + np.array([0.0, 0.0, heading_off]), nu @ to_heading, nu_dot @ to_heading], 1
    )
    motion += np.random.default_rng(2).normal(0.0, STD, motion.shape)
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], told, DT, np.diag(STD**2))


def problem_of(trial: Trial) -> tuple[ForceProblem, Any, list[Effect]]:
    effects = [named(name) for name in ASKED]
    superset = SupersetModel.of(WAM_V, effects)
    base = fit_base(superset, Model.of(WAM_V), [trial], DiagnoseSettings())
    return ForceProblem.of(superset, [trial], base.problem.settings), base, effects


@pytest.fixture(scope="module")
def hard() -> tuple[ForceProblem, Any, list[Effect]]:
    return problem_of(day(True, (0.3, -0.2), 0.15))


def test_all_causes_of_a_day_stand_out(hard: tuple[ForceProblem, Any, list[Effect]]) -> None:
    problem, base, effects = hard
    found = search_forces(problem, effects, 4)
    last = found.fit
    water = {"steady_current", "current_change"} & set(last.names)  # either, of steady water
    assert set(last.names) == {"thruster_fault", "heading_offset", *water}
    assert len(water) == 1
    assert all(name in found.promising[name] for name in last.names)
    z = last.unknowns.to_named(last.z)
    numbers = {u.name: float(x) for u, x in zip(last.unknowns.each, z, strict=True)}
    assert numbers["thruster_fault.gain"] == pytest.approx(0.5, abs=0.08)
    assert numbers["heading_offset.angle"] == pytest.approx(0.15, abs=0.05)
    speeds = [numbers[f"{name}.speed"] for name in water]
    assert speeds == pytest.approx([np.hypot(0.3, 0.2)], abs=0.06)
    fault = next(a for a in last.added if a.effect.name == "thruster_fault")
    assert fault.values["time"] == pytest.approx(FAILS, abs=3.0)
    fit = fit_under_its_noise(last, base.problem)
    assert fit.names == last.names
    assert max(fit.noise_share) < 0.5 * max(base.noise_share)


@pytest.mark.parametrize(
    ("deviances", "rounds"),
    [
        ([2000.0, 1700.0, 1000.0, 300.0, 290.0, 280.0], 5),  # a tow that comes down slowly
        ([2000.0, 1990.0, 0.0], 2),
        (list(range(20000, 0, -1000)), thresholds.MAX_ROUNDS_FROM_FORCES),
    ],
)
def test_fit_and_noise_take_turns_as_long_as_that_leads_on(
    monkeypatch: pytest.MonkeyPatch, deviances: list[float], rounds: int
) -> None:
    left = iter(deviances)
    problem: Any = SimpleNamespace(deviance=lambda *_: next(left))
    made = count()

    def fitted(*_: Any) -> Any:
        return SimpleNamespace(
            added=(), unknowns=None, z=None, problem=problem, number=next(made)
        )  # fmt: skip

    monkeypatch.setattr(force_search, "fit_effects", fitted)
    monkeypatch.setattr(force_search, "_problem_at", lambda *_: problem)
    start: Any = SimpleNamespace(added=(), unknowns=None, z=None)
    last: Any = fit_under_its_noise(start, problem)
    assert last.number == rounds - 1


def test_no_more_stand_out_than_were_asked_for(
    hard: tuple[ForceProblem, Any, list[Effect]],
) -> None:
    problem, _, effects = hard
    assert len(search_forces(problem, effects, 1).fit.added) == 1
    assert search_forces(problem, [], 4).fit.added == ()
    assert search_forces(problem, [named("thrust_scale")], 4).fit.added == ()  # like the base


def test_slopes_are_those_of_the_residuals_and_of_the_columns_asked_for(
    hard: tuple[ForceProblem, Any, list[Effect]],
) -> None:
    """An effect that trials measured may have no number of its own: no column at all."""
    problem, base, _ = hard
    fit = problem.with_effects(base, [AddedEffect(named("heading_offset"), {"angle": 0.1})])
    whole, some = problem.jacobian(fit), np.array([1, 3])
    assert not problem.jacobian(fit, np.array([], np.int64)).any()
    np.testing.assert_array_equal(problem.jacobian(fit, some)[:, some], whole[:, some])
    moved = fit.z + 1e-4 * np.arange(1.0, len(fit.z) + 1.0)
    there = problem.at(fit.added, fit.unknowns, moved).residual - fit.residual
    predicted = whole @ (moved - fit.z)
    assert np.abs(there - predicted).max() < 0.02 * np.abs(there).max()


def test_what_leaves_as_little_of_the_forces_may_stand_in_a_place(
    hard: tuple[ForceProblem, Any, list[Effect]],
) -> None:
    """A current that stays for one that turns, or the other way round; no loss of advance, which
    leaves all of the water's force, and no load for a compass that is off.
    """
    problem, base, effects = hard
    fit = fit_under_its_noise(search_forces(problem, effects, 4).fit, base.problem)
    waters = {"steady_current", "current_change"}
    present = next(iter(waters & set(fit.names)))
    place = fit.names.index(present)
    asked = [named("advance_loss"), *map(named, waters - {present})]
    others = in_place_by_forces(problem, fit, place, asked)
    assert [other.names[-1] for other in others] == [*(waters - {present})]
    assert set(others[0].names[:-1]) == set(fit.names) - {present}
    assert max(others[0].noise_share) < 1.2 * max(fit.noise_share)
    offset = fit.names.index("heading_offset")
    assert in_place_by_forces(problem, fit, offset, [named("payload_change")]) == []
    held = [named("thruster_fault"), named("thruster_lag")]  # it has one; laws with memory
    assert in_place_by_forces(problem, fit, offset, held) == []


@pytest.mark.parametrize(
    ("fails", "heading_off", "alone"), [(False, 0.0, set()), (True, 0.0, {"thruster_fault"})]
)
def test_what_is_not_there_does_not_stand_out(
    fails: bool, heading_off: float, alone: set[str]
) -> None:
    """A complete model, and a single cause."""
    problem, _, effects = problem_of(day(fails, (0.0, 0.0), heading_off))
    assert set(search_forces(problem, effects, 4).fit.names) == alone


def test_lags_plugs_and_curves_are_left_to_predictions() -> None:
    left = {e.name for e in EFFECTS if not acts_at_once(e)}
    assert {
        "thruster_lag",
        "steering_lag",
        "steering_play",
        "steering_rate",
        "actuator_wiring",
        "wave_motion",
    } <= left
    assert not left & {"thruster_fault", "wind_change", "compass_deviation", "payload_change"}
