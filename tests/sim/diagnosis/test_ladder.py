"""Which effect comes next on the ladder: the rules, on made-up rankings."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis.heldout import Gain
from sim.diagnosis.ladder import EffectSearch
from sim.diagnosis.ranking import RankedEffect, Ranking
from sim.diagnosis.thresholds import MIN_NATS_IN_FEW_BLOCKS, MIN_SHARE_OF_EARLIER
from sim.diagnosis.verdict import rivals_of
from sim.effects.catalogue import named

HIDDEN = "steering_lag"  # worth most, and yet no prediction is better with it
FIRST: Any = SimpleNamespace(names=())
BLOCK = np.repeat(np.arange(8), 10)


def row(name: str, gain: Gain, left: float = 1.0) -> RankedEffect:
    """One of a ranking; `left` of the residual on unseen time."""
    residual = np.full(len(BLOCK), left)
    problem = SimpleNamespace(block=BLOCK)
    fit: Any = SimpleNamespace(name=name, problem=problem, heldout_residual=residual)
    return RankedEffect(named(name), fit, gain, 0.5)


class Made(EffectSearch):
    """Ranks what it is given; all but one effect help."""

    rows: tuple[RankedEffect, ...]

    def rank(self, fit: Any) -> Ranking:
        return Ranking(FIRST, self.rows)

    def helps(self, before: Any, after: Any) -> bool:
        return bool(after.name != HIDDEN)


def made(*rows: RankedEffect) -> Made:
    nothing: Any = None
    search = Made(nothing, (), 4, lambda _: None, map, nothing)
    object.__setattr__(search, "rows", rows)
    return search


def names(ranking: Ranking) -> list[str]:
    return [r.name for r in ranking.finalists]


MUCH = row(HIDDEN, Gain(2.0, 0.5, 5.7, 700.0, 0.0))
SOME = row("heading_offset", Gain(1.1, 0.075, 4.1, 104.0, 0.06))
LITTLE = row("cg_offset", Gain(1.01, 0.005, 1.2, 15.0, 0.5))


def test_what_a_larger_error_hides_waits_for_its_turn() -> None:
    ranking, more = made(MUCH, SOME).ranked(FIRST, [])
    assert names(ranking) == ["heading_offset", HIDDEN]
    assert more


def test_where_none_is_worth_it_the_best_stays_first() -> None:
    search = made(MUCH, LITTLE)
    ranking, more = search.ranked(FIRST, [])
    assert names(ranking) == [HIDDEN, "cg_offset"]
    assert not more
    assert not search.justified(ranking.best, [], FIRST)


@pytest.mark.parametrize(
    ("won", "enough"), [(100.0, True), (104.0 / MIN_SHARE_OF_EARLIER + 1.0, False)]
)
def test_a_later_effect_is_more_than_the_form_of_an_earlier_one(won: float, enough: bool) -> None:
    search = made(SOME)
    earlier = row("hull_lift", Gain(2.0, 0.5, 5.0, won, 0.0))
    steps = [search.rank(FIRST).led_by(earlier)]
    assert search.justified(SOME, steps, FIRST) is enough


def test_few_blocks_may_tell_if_hardly_any_contradicts() -> None:
    search = made()
    for nats, lost, enough in (
        (MIN_NATS_IN_FEW_BLOCKS + 1, 0.1, True),
        (MIN_NATS_IN_FEW_BLOCKS - 1, 0.1, False),
        (90, 0.3, False),
    ):
        braking = row("astern_stall", Gain(1.1, 0.01, 1.0, nats, lost))
        assert search.justified(braking, [], FIRST) is enough


def test_what_was_found_beside_it_is_no_rival() -> None:
    ranking = made(SOME, MUCH).rank(FIRST)
    assert [r.name for r in rivals_of(ranking)] == [HIDDEN]
    assert rivals_of(ranking, ("heading_offset", HIDDEN)) == []
