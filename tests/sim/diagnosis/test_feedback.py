"""A delay beside an autopilot that answers waves: believed only where it is there."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis import feedback, generality
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose, fit_base
from sim.diagnosis.feedback import (
    NOT_BEFORE_MOTION,
    nats_one_step,
    said_of_times,
    times_of,
    with_times_one_step,
)
from sim.diagnosis.fit import Fit, fit_effects, start_values, unknowns_for
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.generality import doubt_of
from sim.diagnosis.heldout import gain
from sim.diagnosis.thresholds import MIN_NATS_ONE_STEP
from sim.diagnosis.worth import is_worth_it
from sim.effects.catalogue import named
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
    law, problem = named(effect), SimpleNamespace(vessel=WAM_V)
    found = AddedEffect(law, {p.name: p.start for p in law.parameters})
    fit = SimpleNamespace(noise_share=(0.7, 0.7, left), problem=problem)
    return SimpleNamespace(effect=law, found=found, fit=fit)


def test_a_thrust_that_the_mass_goes_along_with_is_not_believed() -> None:
    row = ranked("thrust_scale", 0.7)
    row.found.values["gain"] = 1.5
    for factor, is_doubted in ((1.4, True), (1.0, False)):
        heavier = replace(WAM_V.dynamics, m11=factor * WAM_V.dynamics.m11)
        row.fit.vessel = lambda d=heavier: replace(WAM_V, dynamics=d)
        assert bool(generality.doubt_of_numbers(row)) is is_doubted


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
    monkeypatch.setattr(generality, "gain_on_recordings", lambda before, after: None)
    doubt = doubt_of(ranked(effect, left), nothing, nothing)
    assert doubt == (NOT_BEFORE_MOTION if is_doubted else "")


@pytest.mark.parametrize(
    ("effects", "told", "believed", "doubted"),
    [
        (["heading_offset", "command_delay"], ["command_delay.delay"], "command_delay", ""),
        (["thruster_lag"], ["thruster_lag.tau"], "thruster_lag", "thruster_lag"),
        (["thruster_lag"], [], "", "thruster_lag"),
        (
            ["thruster_lag", "velocity_latency"],
            ["thruster_lag.tau"],
            "thruster_lag",
            "thruster_lag and velocity_latency",
        ),
        (["command_delay"], [], "", "command_delay"),
        (["heading_offset"], [], "", ""),
    ],
)
def test_what_is_said_of_times_in_a_sea(
    effects: list[str], told: list[str], believed: str, doubted: str
) -> None:
    said = said_of_times([named(name) for name in effects], told, 2.0)
    assert (f"the time of {believed} is the one that predicts" in said) is bool(believed)
    assert (f"take that of {doubted} with more doubt" in said) is bool(doubted)


def test_steering_that_hangs_loose_or_is_slow_has_no_time_that_could_be_wrong() -> None:
    """Of an angle and a rate: "times that were known were found up to 0.3 s wrong"."""
    loose, slow, late = (named(f"steering_{name}") for name in ("play", "rate", "lag"))
    assert said_of_times([loose, slow], [], 2.0) == ""
    assert "take that of steering_lag with more doubt" in said_of_times(
        [loose, slow, late], [], 2.0
    )


def in_a_sea_it_says(monkeypatch: pytest.MonkeyPatch, floor: float, period: float | None) -> str:
    """What a diagnosis that finds a delay says, where what is left swings or does not."""
    trial = sailed("command_delay", delay=0.4)
    monkeypatch.setattr("sim.diagnosis.diagnose.swing_period", lambda fit: period)
    monkeypatch.setattr("sim.diagnosis.diagnose.is_at_floor", lambda share: max(share) < floor)
    said = diagnose([trial], WAM_V, DiagnoseSettings(effects=(named("command_delay"),)))
    assert said.effects == ("command_delay",)
    (found,) = said.ladder[-1].parameters["command_delay"]
    assert found.ci95[0] < 0.4 < found.ci95[1]
    assert found.ci95[1] - found.ci95[0] > 0.01
    return said.summary


def test_a_diagnosis_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where what is left is more than noise and swings, and nowhere else."""
    assert "the time of command_delay is the one" in in_a_sea_it_says(monkeypatch, 0.0, 2.1)
    assert "(some 2.1 s)" in in_a_sea_it_says(monkeypatch, 0.0, 2.1)
    assert "the time of" not in in_a_sea_it_says(monkeypatch, 0.0, None)
    assert "the time of" not in in_a_sea_it_says(monkeypatch, 10.0, 2.1)


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.0, 0.4])
def test_a_delay_is_told_from_an_autopilot_that_answers_waves(late: float) -> None:
    """Runs of six seconds take either for a delay; predictions one step ahead only what is one."""
    before, after = without_and_with_a_delay(late)
    over_runs = gain(before.heldout_residual, after.heldout_residual, before.problem.block)
    assert is_worth_it(over_runs)
    assert (nats_one_step(before, after) > MIN_NATS_ONE_STEP) is (late > 0.0)


@pytest.mark.slow
def test_the_time_of_a_delay_is_told_one_step_ahead() -> None:
    """Runs of six seconds find one too long; its interval one step ahead holds it, is the one that
    is told, and all else is fitted beside it.
    """
    _, fit = without_and_with_a_delay(0.4)
    before, after = (f.estimates()[1]["command_delay"][0] for f in (fit, with_times_one_step(fit)))
    assert not before.ci95[0] < 0.4 < before.ci95[1]
    assert after.ci95[0] < 0.4 < after.ci95[1]
    assert with_times_one_step(fit).values("command_delay")["delay"] == pytest.approx(
        after.value, abs=1e-3
    )


def test_velocities_that_come_late_are_not_told_one_step_ahead() -> None:
    """The runs that would tell it start from them."""
    effects = [named(name) for name in ("velocity_latency", "thruster_lag", "heading_offset")]
    assert times_of(effects) == ["thruster_lag.tau"]
