"""Several recordings: what holds on some of them only, and what none of them can show."""

from dataclasses import replace

import numpy as np
import pytest

from sim.diagnosis.answer import LadderStep, Verdict
from sim.diagnosis.diagnose import DiagnoseSettings, diagnose, fit_base
from sim.diagnosis.fit_problem import SupersetModel
from sim.diagnosis.heldout import Gain, HeldOutScorer, gain_on_recordings
from sim.diagnosis.ladder import holds_on_recordings
from sim.diagnosis.ranking import Ranking, rank
from sim.effects.catalogue import named
from sim.model import Model
from sim.trial import Trial
from tests.sim.diagnosis.sailed import DT, STD, sailed, with_effect
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


def on_recordings(ranking: Ranking) -> Gain:
    """What the best is worth on recordings that were left out."""
    found = gain_on_recordings(ranking.reference, ranking.best.fit)
    assert found is not None
    return found


def test_what_recordings_agree_on_holds_on_each_that_is_left_out() -> None:
    ranking, step = offset_on(days(*AGREEING))
    assert on_recordings(ranking).nats > 100.0
    assert on_recordings(ranking).lost < 0.01
    assert holds_on_recordings(ranking.best, ranking.reference)
    assert step.left_out is not None
    assert step.left_out.nrmse < 1.2 * step.heldout.nrmse


def test_what_holds_on_some_recordings_only_is_not_believed_of_the_boat() -> None:
    """Blocks of each were fitted too: on the rest of their time the offset helps all the same."""
    trials = days(*DIFFERING)
    ranking, step = offset_on(trials)
    assert ranking.best.gain.nats > 0.0
    assert on_recordings(ranking).nats < 0.0
    assert not holds_on_recordings(ranking.best, ranking.reference)
    assert step.left_out is not None
    assert step.left_out.nrmse > 1.5 * step.heldout.nrmse
    found = diagnose(trials, WAM_V, DiagnoseSettings(effects=(OFFSET,)))
    assert "heading_offset" not in found.effects


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
    assert holds_on_recordings(ranking.best, ranking.reference)


def narrow(effect: str, **values: float) -> Trial:
    """A voyage on headings of four sectors of eight: sheers of 70° to either side of north."""
    time = DT * np.arange(int(200.0 / DT))
    turn = 0.17 * np.sign(np.sin(2.0 * np.pi * time / 16.0 + 0.5 * np.pi))
    ahead = 0.5 + 0.2 * np.sin(2.0 * np.pi * time / 37.0)
    drive = np.stack([ahead + turn, ahead - turn], axis=1)
    _, reports = Model.of(with_effect(WAM_V, effect, **values)).simulate(drive, DT)
    motion = reports[0, :-1] + np.random.default_rng(5).normal(0.0, STD, (len(drive), 9))
    return trial_of(motion[:, :3], motion[:, 3:6], motion[:, 6:], drive, DT, np.diag(STD**2))


@pytest.fixture(scope="module")
def of_few_headings() -> Trial:
    return narrow("compass_deviation", b=0.02, c=0.15)


def test_what_these_headings_cannot_show_may_be_it_all_the_same(of_few_headings: Trial) -> None:
    """A compass that deviates, seen on few headings, is as good as one that is turned."""
    both = DiagnoseSettings(effects=(OFFSET, named("compass_deviation")))
    found = diagnose([of_few_headings], WAM_V, both)
    assert {r.effect for r in found.refused} == {"compass_deviation"}
    assert found.effects == ("heading_offset",)
    assert found.verdict is Verdict.CONFOUNDED
    assert "compass_deviation" in found.summary
    assert found.ranking[0].confounded_with == ("compass_deviation",)
    assert ("compass_deviation",) in {step.effects for step in found.alternatives}


def test_what_cannot_be_shown_and_does_not_do_as_well_is_no_rival() -> None:
    trial = narrow("heading_offset", angle=0.1)
    settings = DiagnoseSettings(effects=(OFFSET, named("cg_offset"), named("battery_sag")))
    found = diagnose([trial], WAM_V, settings)
    assert found.effects == ("heading_offset",)
    assert found.verdict is Verdict.EXPLAINED
