"""From what was found to an answer: the rules, one by one, on made-up findings."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim.diagnosis.answer import LadderStep, Verdict
from sim.diagnosis.heldout import Gain, HeldOutScore
from sim.diagnosis.verdict import (
    is_above_noise,
    is_more_than_form,
    summary_of,
    unexplained_share,
    verdict_of,
)
from sim.effects.catalogue import named
from tests.sim.voyages import WAM_V


def selection(won: float = 100.0, name: str = "hull_lift", steps: int = 1) -> Any:
    gain = SimpleNamespace(nats=won)
    step = SimpleNamespace(best=SimpleNamespace(gain=gain))
    added = (SimpleNamespace(effect=named(name)),)
    return SimpleNamespace(steps=(step,) * steps, fit=SimpleNamespace(added=added))


def gained(nats: float, lost: float = 0.0, t: float = 5.0) -> Gain:
    return Gain(1.2, 0.1, t, nats, lost)


def step(nrmse: float, *effects: str) -> LadderStep:
    return LadderStep(effects, "refitted", HeldOutScore(nrmse, None), (), {}, WAM_V)


LEFT: Any = SimpleNamespace(description="it follows the heading")
RIVAL: Any = SimpleNamespace(name="cg_offset")


def test_what_is_left_makes_it_unknown_whatever_was_found() -> None:
    assert verdict_of(selection(), [[RIVAL]], [LEFT], False) is Verdict.UNKNOWN
    assert verdict_of(selection(steps=0), [], [LEFT], False) is Verdict.UNKNOWN
    assert verdict_of(selection(steps=0), [], [], True) is Verdict.UNKNOWN
    assert verdict_of(selection(steps=0), [], [], False) is Verdict.ADEQUATE
    assert verdict_of(selection(), [[RIVAL]], [], False) is Verdict.CONFOUNDED
    assert verdict_of(selection(), [[]], [], False) is Verdict.EXPLAINED


def test_an_error_far_above_the_noise_is_not_explained() -> None:
    found, names = [named("hull_lift")], ("hull_lift",)
    assert is_above_noise((), [step(0.5), step(0.5)], 0.2)
    assert not is_above_noise((), [step(0.5), step(0.13)], 0.1)
    assert is_above_noise(found, [step(0.9), step(0.9), step(0.6, *names)], 0.1)
    assert not is_above_noise(found, [step(0.9), step(0.9), step(0.4, *names)], 0.1)  # its form
    assert not is_above_noise(found, [step(9.0), step(9.0), step(0.6, *names)], 0.1)  # nearly all
    assert not is_above_noise(
        [named("wave_motion")], [step(0.9), step(0.9), step(0.6, *names)], 0.1
    )


def test_little_is_left_by_a_form_that_nature_chose_differently() -> None:
    def matters(g: Gain, above_noise: bool, **found: Any) -> bool:
        return is_more_than_form(g, selection(**found), above_noise)

    assert matters(gained(30.0), False, won=100.0)
    assert not matters(gained(20.0), False, won=100.0)
    assert not matters(gained(30.0), False, won=1000.0)
    assert matters(gained(30.0), True, won=1000.0)
    assert not matters(gained(90.0), True, won=100.0, name="wave_motion")
    assert matters(gained(300.0, lost=0.1, t=1.0), True, won=100.0)  # in few blocks
    assert not matters(gained(300.0, lost=0.5, t=1.0), True, won=100.0)


@pytest.mark.parametrize(("last", "share"), [(0.5, 1.0), (0.1, 0.0), (0.05, 0.0), (0.13**0.5, 0.5)])
def test_the_share_unexplained_runs_from_all_to_none(last: float, share: float) -> None:
    assert unexplained_share([step(0.5), step(last)], 0.1) == pytest.approx(share)


def test_a_vessel_at_the_floor_leaves_nothing_unexplained() -> None:
    assert unexplained_share([step(0.08), step(0.08)], 0.1) == 0.0


def test_the_sentence_names_what_was_found_and_what_it_may_be_taken_for() -> None:
    ladder = [step(0.5), step(0.4), step(0.1, "hull_lift")]
    explained = summary_of(Verdict.EXPLAINED, ladder, [[]], [], 0.09)
    assert explained.startswith("hull_lift: the error on unseen time falls from 0.500 to 0.100")
    assert "cannot tell it from cg_offset" in summary_of(
        Verdict.CONFOUNDED, ladder, [[RIVAL]], [], 0.09
    )
    assert summary_of(Verdict.UNKNOWN, ladder, [[]], [LEFT], 0.09).endswith("follows the heading")
    assert summary_of(Verdict.UNKNOWN, ladder, [[]], [], 0.05).endswith("that was looked for")
    assert "no effect" in summary_of(Verdict.ADEQUATE, ladder[:2], [], [], 0.09)
