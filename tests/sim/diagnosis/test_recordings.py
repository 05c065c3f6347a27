"""Several recordings: what holds on some of them only, and what none of them can show."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis.answer import LadderStep, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose, fit_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.generality import doubt_of, in_words, seen_sectors, unseen_headings
from sim.diagnosis.heldout import (
    Gain,
    HeldOutScorer,
    RankedEffect,
    Ranking,
    gain_on_recordings,
    rank,
)
from sim.effects.catalogue import named
from sim.effects.effect import Shown
from sim.model import Model
from sim.trial import Trial
from sim.vessel import AddedEffect
from tests.sim.diagnosis.sailed import DT, STD, sailed, with_effect
from tests.sim.simulated import on_floats
from tests.sim.voyages import WAM_V, trial_of

OFFSET, CURRENT = named("heading_offset"), named("steady_current")
AGREEING, DIFFERING = (0.2, 0.2, 0.2), (0.2, 0.2, -0.15)  # rad, of three recordings


def days(*angles: float) -> list[Trial]:
    """A recording for each, on which the compass is that far off."""
    return [
        replace(sailed("heading_offset", 100.0, seed, angle=a), name=f"day {seed}")
        for seed, a in enumerate(angles, 1)
    ]


def offset_on(trials: list[Trial]) -> tuple[Ranking, LadderStep]:
    """The offset beside the re-fitted base, and its step of a ladder."""
    superset, plain = SupersetModel.of(WAM_V, [OFFSET], trials), Model.of(WAM_V)
    base = fit_base(superset, plain, trials, DiagnoseSettings())
    ranking, scorer = rank(superset, plain, [OFFSET], base), HeldOutScorer.of(trials, plain)
    fit = ranking.best.fit
    return ranking, LadderStep.of(fit, scorer).with_left_out(fit, scorer)


def doubted(ranking: Ranking) -> str:
    """Why the best is not believed of the boat."""
    scorer = HeldOutScorer.of(ranking.reference.problem.trials, Model.of(WAM_V))
    return doubt_of(ranking.best, ranking.reference, scorer)


def on_recordings(ranking: Ranking) -> Gain:
    """What the best is worth on recordings that were left out."""
    found = gain_on_recordings(ranking.reference, ranking.best.fit)
    assert found is not None
    return found


def test_what_recordings_agree_on_holds_on_each_that_is_left_out() -> None:
    ranking, step = offset_on(days(*AGREEING))
    assert on_recordings(ranking).nats > 100.0
    assert on_recordings(ranking).lost < 0.01
    assert not doubted(ranking)
    assert step.left_out is not None
    assert step.left_out.nrmse < 1.2 * step.heldout.nrmse


@pytest.mark.slow
def test_what_holds_on_some_recordings_only_is_not_believed_of_the_boat() -> None:
    """Blocks of each were fitted too: on the rest of their time the offset helps all the same."""
    ranking, step = offset_on(days(*DIFFERING))
    assert ranking.best.gain.nats > 0.0
    assert on_recordings(ranking).nats < 0.0
    assert "not alike on all" in doubted(ranking)
    assert step.left_out is not None
    assert step.left_out.nrmse > 1.5 * step.heldout.nrmse


@pytest.mark.slow
def test_what_is_not_believed_of_the_boat_is_not_named() -> None:
    found = diagnose(days(*DIFFERING), WAM_V, DiagnoseSettings(effects=(OFFSET,)))
    assert "heading_offset" not in found.effects


@pytest.mark.slow
def test_a_recording_that_is_left_out_keeps_what_is_of_its_day() -> None:
    """Its current is nobody else's: without its rows nothing else could tell it."""
    trials = [
        sailed("steady_current", 100.0, seed, speed=0.3, direction=float(seed))
        for seed in (1, 2, 3)
    ]
    superset, plain = SupersetModel.of(WAM_V, [CURRENT], trials), Model.of(WAM_V)
    base = fit_base(superset, plain, trials, DiagnoseSettings())
    fit = rank(superset, plain, [CURRENT], base).best.fit
    names = [(u.name, u.trial) for u in fit.unknowns.each]
    for k, z in enumerate(fit.recording_fits.z):
        own = [i for i, (_, trial) in enumerate(names) if trial == k]
        assert len(own) == 2
        np.testing.assert_array_equal(z[own], fit.z[own])
        assert np.any(z != fit.z)
    left = fit.left_out_residual
    assert np.sqrt(np.mean(left**2)) < 1.2 * np.sqrt(np.mean(fit.residual**2))


def test_two_recordings_are_too_few_to_leave_one_out() -> None:
    ranking, step = offset_on(days(*DIFFERING[1:]))
    assert step.left_out is None
    assert "left_out_nrmse" not in step.to_dict()
    assert gain_on_recordings(ranking.reference, ranking.best.fit) is None
    assert not doubted(ranking)


def narrow(effect: str, **values: float) -> Trial:
    """A voyage on headings of four sectors of eight: sheers of up to 90° to both sides of north."""
    time = DT * np.arange(int(200.0 / DT))
    turn = 0.2 * np.sign(np.sin(2.0 * np.pi * time / 24.0 + 0.5 * np.pi))
    ahead = 0.5 + 0.2 * np.sin(2.0 * np.pi * time / 37.0)
    drive = np.stack([ahead + turn, ahead - turn], axis=1)
    _, reports = on_floats(with_effect(WAM_V, effect, **values)).simulate(drive, DT)
    motion = reports[0, :-1] + np.random.default_rng(5).normal(0.0, STD, (len(drive), 9))
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, DT, np.diag(STD**2))


@pytest.mark.slow
def test_what_a_recording_cannot_show_may_be_it_all_the_same() -> None:
    twin = replace(OFFSET, name="twin", shown_by=(Shown.VOLTAGE,))
    twin = replace(twin, mistaken_for=("heading_offset",))
    trial = narrow("heading_offset", angle=0.1)
    found = diagnose([trial], WAM_V, DiagnoseSettings(effects=(OFFSET, twin)))
    assert {r.effect for r in found.refused} == {"twin"}
    assert found.effects == ("heading_offset",)
    assert found.verdict is Verdict.CONFOUNDED
    assert "these data cannot tell it from twin" in found.summary
    assert "heading_offset was seen on headings from 270° to 90° alone" in found.summary
    assert found.ranking[0].confounded_with == ("twin",)
    assert ("twin",) in {step.effects for step in found.alternatives}


@pytest.mark.slow
def test_what_cannot_be_shown_and_does_not_do_as_well_is_no_rival() -> None:
    trial = narrow("heading_offset", angle=0.1)
    settings = DiagnoseSettings(effects=(OFFSET, named("cg_offset"), named("battery_sag")))
    found = diagnose([trial], WAM_V, settings)
    assert found.effects == ("heading_offset",)
    assert found.verdict is Verdict.EXPLAINED


def seen_on(won: dict[float, float], effect: str = "heading_offset") -> tuple[Any, Any]:
    """A ranked effect that wins so many nats on each heading [°], and its reference."""
    heading = np.radians(list(won))
    trial = SimpleNamespace(time=np.arange(len(won)), eta=np.outer(heading, [0.0, 0.0, 1.0]))
    places = SimpleNamespace(begin=trial.time, trial=np.zeros(len(won), int))
    problem = SimpleNamespace(trials=(trial,), places=places, vessel=WAM_V)
    nats = np.array(list(won.values()))
    before = np.sqrt(6.0 + 6.0 * np.maximum(nats, 0.0))
    after = np.sqrt(6.0 + 6.0 * np.maximum(-nats, 0.0))
    fit = SimpleNamespace(problem=problem, heldout_residual=after)
    law = named(effect)
    found = AddedEffect(law, {p.name: max(p.start, p.least) for p in law.parameters})
    row = SimpleNamespace(effect=law, name=effect, fit=fit, found=found)
    return row, SimpleNamespace(problem=problem, heldout_residual=before)


def test_what_wins_one_way_only_is_not_believed_of_the_boat_however_long_it_sailed_others() -> None:
    nothing: Any = None

    def doubt(won: dict[float, float], effect: str = "heading_offset") -> str:
        return doubt_of(*seen_on(won, effect), nothing)

    one_way = {10.0: 2.0, 80.0: 3.0, 100.0: 1.0, 200.0: -0.5, 280.0: 0.1, 320.0: 0.0}
    assert "from 0° to 135° alone: sail opposite headings" in doubt(one_way)
    assert not doubt(one_way | {200.0: 1.0})
    for name in ("thruster_imbalance", "steady_current"):  # no heading, or of the day
        assert not doubt(one_way, name)


def test_on_which_headings_a_compass_was_seen_is_told_where_they_are_few() -> None:
    few = {10.0: 2.0, 80.0: 3.0, 200.0: 1.0, 280.0: -1.0, 350.0: 2.0}
    assert seen_sectors(*seen_on(few)) == [0, 1, 4, 7]
    told = unseen_headings(*seen_on(few))
    assert told == "heading_offset was seen on headings from 180° to 225° and 315° to 90° alone"
    assert unseen_headings(*seen_on(few | {280.0: 1.0})) == ""
    assert unseen_headings(*seen_on(few, "thruster_imbalance")) == ""
    assert in_words([0]) == "0° to 45°"


@pytest.mark.parametrize(("moment", "is_told"), [(4.0, False), (60.0, True), (196.0, False)])
@pytest.mark.parametrize("name", ["thruster_fault", "current_change"])
def test_a_change_is_told_only_where_something_was_seen_before_and_after_it(
    name: str, moment: float, is_told: bool
) -> None:
    """A motor that was weak from the first seconds on has not failed while she sailed."""
    values = {p.name: p.start for p in named(name).parameters} | {"time": moment}
    if "later_direction" in values:
        values["later_direction"] = 2.0  # another current
    trials = [SimpleNamespace(time=np.linspace(0.0, end, 50)) for end in (100.0, 200.0)]
    fit: Any = SimpleNamespace(
        values=lambda effect: values, problem=SimpleNamespace(vessel=WAM_V, trials=trials)
    )
    nothing: Any = None
    change = RankedEffect(named(name), fit, Gain(2.0, 0.5, 5.0, 700.0, 0.0), 0.5)
    doubt = doubt_of(change, nothing, nothing)
    assert ("one side of its moment" in doubt) is not is_told
    assert bool(doubt) is not is_told
