"""A delay beside an autopilot that answers waves: believed only where it is there."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis import feedback, ladder
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose, fit_base
from sim.diagnosis.feedback import NOT_BEFORE_MOTION, doubt_of_times, nats_one_step
from sim.diagnosis.fit import Fit, fit_effects, start_values, unknowns_for
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.heldout import gain
from sim.diagnosis.ladder import doubt_of, is_worth_it
from sim.diagnosis.thresholds import MIN_NATS_ONE_STEP
from sim.effects.catalogue import named
from sim.effects.effect import Shown
from sim.model import Model
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import STD, sailed
from tests.sim.voyages import WAM_V, in_a_sea, trial_of

DT = 0.2  # s: that of a diagnosis
DELAY = AddedEffect(named("command_delay"), {"delay": 0.2})


def without_and_with_a_delay(late: float) -> tuple[Fit, Fit]:
    """Fits to 250 s in a sea, motors so many seconds late; physics and pilot of other code."""
    *motion, drive = in_a_sea(250.0, DT, late)
    noisy = np.hstack(motion) + np.random.default_rng(5).normal(0.0, STD, (len(drive), 9))
    eta, nu, nu_dot = np.split(noisy, 3, axis=1)
    trial = trial_of(eta, nu, nu_dot, drive, DT, np.diag(STD**2))
    superset = SupersetModel.of(WAM_V, [DELAY.effect])
    base = fit_base(superset, Model.of(WAM_V), [trial], DiagnoseSettings())
    problem = base.renewed_problem
    unknowns = unknowns_for(superset, [DELAY], 1, problem.settings)
    after = fit_effects([DELAY], unknowns, problem, start_values(unknowns, base))
    return fit_effects([], base.unknowns, problem, base.z), after


def ranked(effect: str, left: float) -> Any:
    """A row of a ranking whose fit leaves so much of the yaw rate, over its noise."""
    return SimpleNamespace(effect=named(effect), fit=SimpleNamespace(noise_share=(0.7, 0.7, left)))


@pytest.mark.parametrize(
    ("effect", "left", "nats", "is_doubted"),
    [
        ("command_delay", 20.0, -60.0, True),
        ("thruster_lag", 20.0, 3.0, True),
        ("command_delay", 20.0, 80.0, False),
        ("command_delay", 0.7, -60.0, False),  # nothing shakes the boat
        ("thruster_imbalance", 20.0, -60.0, False),
    ],
)
def test_what_is_told_by_when_commands_act_must_win_one_step_ahead(
    effect: str, left: float, nats: float, is_doubted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing: Any = None
    monkeypatch.setattr(feedback, "nats_one_step", lambda before, after: nats)
    monkeypatch.setattr(ladder, "gain_on_recordings", lambda before, after: None)
    doubt = doubt_of(ranked(effect, left), nothing, nothing)
    assert doubt == (NOT_BEFORE_MOTION if is_doubted else "")


@pytest.mark.parametrize(
    ("effects", "period", "told"),
    [
        (("heading_offset", "command_delay"), 2.0, "that of command_delay with more doubt"),
        (("thruster_lag", "command_delay"), 2.0, "that of thruster_lag and command_delay"),
        (("heading_offset",), 2.0, ""),
        (("command_delay",), None, ""),
    ],
)
def test_the_time_of_a_delay_is_doubted_in_a_sea_alone(
    effects: tuple[str, ...], period: float | None, told: str
) -> None:
    doubt = doubt_of_times([named(name) for name in effects], period)
    assert told in doubt
    assert bool(doubt) is bool(told)


def test_a_diagnosis_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an effect of timing that it found; the period of what is left is told it."""
    cause = named("heading_offset")
    trial = sailed(cause.name, angle=0.2)
    settings = DiagnoseSettings(effects=(replace(cause, shown_by=(Shown.COMMANDS,)),))
    monkeypatch.setattr("sim.diagnosis.diagnose.swing_period", lambda fit: 2.1)
    said = diagnose([trial], WAM_V, settings)
    assert said.effects == (cause.name,)
    assert said.summary.endswith(
        "take that of heading_offset with more doubt than its interval says"
    )
    assert "(some 2.1 s)" in said.summary


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.0, 0.4])
def test_a_delay_is_told_from_an_autopilot_that_answers_waves(late: float) -> None:
    """Runs of six seconds take either for a delay; predictions one step ahead only what is one."""
    before, after = without_and_with_a_delay(late)
    over_runs = gain(before.heldout_residual, after.heldout_residual, before.problem.block)
    assert is_worth_it(over_runs)
    assert (nats_one_step(before, after) > MIN_NATS_ONE_STEP) is (late > 0.0)
