"""From what was found to an answer: the rules, one by one, on made-up findings."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim.diagnosis.answer import LadderStep, Verdict
from sim.diagnosis.heldout import Gain, HeldOut
from sim.diagnosis.verdict import matters, stands_open, summary_of, unexplained, verdict_of
from sim.effects.catalogue import named
from tests.sim.voyages import WAM_V


def climb(won: float = 100.0, name: str = "hull_lift", steps: int = 1) -> Any:
    gain = SimpleNamespace(nats=won)
    step = SimpleNamespace(chosen=SimpleNamespace(gain=gain))
    added = (SimpleNamespace(effect=named(name)),)
    return SimpleNamespace(steps=(step,) * steps, fit=SimpleNamespace(added=added))


def gained(nats: float, lost: float = 0.0, t: float = 5.0) -> Gain:
    return Gain(1.2, 0.1, t, nats, lost)


def rung(nrmse: float, *effects: str) -> LadderStep:
    return LadderStep(effects, "refitted", HeldOut(nrmse, None), (), {}, WAM_V)


LEFT: Any = SimpleNamespace(says="it follows the heading")
RIVAL: Any = SimpleNamespace(name="cg_offset")


def test_what_is_left_makes_it_unknown_whatever_was_found() -> None:
    assert verdict_of(climb(), [[RIVAL]], [LEFT], False) is Verdict.UNKNOWN
    assert verdict_of(climb(steps=0), [], [LEFT], False) is Verdict.UNKNOWN
    assert verdict_of(climb(steps=0), [], [], True) is Verdict.UNKNOWN
    assert verdict_of(climb(steps=0), [], [], False) is Verdict.ADEQUATE
    assert verdict_of(climb(), [[RIVAL]], [], False) is Verdict.CONFOUNDED
    assert verdict_of(climb(), [[]], [], False) is Verdict.EXPLAINED


def test_an_error_far_above_the_noise_is_not_explained() -> None:
    found, names = [named("hull_lift")], ("hull_lift",)
    assert stands_open((), [rung(0.5), rung(0.5)], 0.2)
    assert not stands_open((), [rung(0.5), rung(0.13)], 0.1)
    assert stands_open(found, [rung(0.9), rung(0.9), rung(0.6, *names)], 0.1)
    assert not stands_open(found, [rung(0.9), rung(0.9), rung(0.4, *names)], 0.1)  # its form
    assert not stands_open(found, [rung(9.0), rung(9.0), rung(0.6, *names)], 0.1)  # nearly all
    assert not stands_open([named("wave_motion")], [rung(0.9), rung(0.9), rung(0.6, *names)], 0.1)


def test_little_is_left_by_a_form_that_nature_chose_differently() -> None:
    assert matters(gained(30.0), climb(won=100.0), above=False)
    assert not matters(gained(20.0), climb(won=100.0), above=False)
    assert not matters(gained(30.0), climb(won=1000.0), above=False)
    assert matters(gained(30.0), climb(won=1000.0), above=True)
    assert not matters(gained(90.0), climb(won=100.0, name="wave_motion"), above=True)
    assert matters(gained(300.0, lost=0.1, t=1.0), climb(won=100.0), above=True)  # in few blocks
    assert not matters(gained(300.0, lost=0.5, t=1.0), climb(won=100.0), above=True)


@pytest.mark.parametrize(("last", "share"), [(0.5, 1.0), (0.1, 0.0), (0.05, 0.0), (0.13**0.5, 0.5)])
def test_the_share_unexplained_runs_from_all_to_none(last: float, share: float) -> None:
    assert unexplained([rung(0.5), rung(last)], 0.1) == pytest.approx(share)


def test_a_vessel_at_the_floor_leaves_nothing_unexplained() -> None:
    assert unexplained([rung(0.08), rung(0.08)], 0.1) == 0.0


def test_the_sentence_names_what_was_found_and_what_it_may_be_taken_for() -> None:
    rungs = [rung(0.5), rung(0.4), rung(0.1, "hull_lift")]
    explained = summary_of(Verdict.EXPLAINED, rungs, [[]], [], 0.09)
    assert explained.startswith("hull_lift: the error on unseen time falls from 0.500 to 0.100")
    assert "cannot tell it from cg_offset" in summary_of(
        Verdict.CONFOUNDED, rungs, [[RIVAL]], [], 0.09
    )
    assert summary_of(Verdict.UNKNOWN, rungs, [[]], [LEFT], 0.09).endswith("follows the heading")
    assert summary_of(Verdict.UNKNOWN, rungs, [[]], [], 0.05).endswith("that was looked for")
    assert "no effect" in summary_of(Verdict.ADEQUATE, rungs[:2], [], [], 0.09)
