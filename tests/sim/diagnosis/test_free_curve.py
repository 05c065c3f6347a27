"""Which of the curves that are worth it is taken: the simplest that is nearly as good."""

import pytest

from sim.diagnosis.free_curve import _simplest_first
from tests.sim.diagnosis.rankings import SOME, row

HISTORY, ONE = row("learned_history", SOME.gain, left=0.95), row("learned", SOME.gain, left=1.0)


@pytest.mark.parametrize(("left", "first"), [(0.97, "learned"), (0.8, "learned_pair")])
def test_two_variables_have_to_be_clearly_better_than_one(left: float, first: str) -> None:
    """Squared errors of 6 and of 36 % less."""
    pair = row("learned_pair", SOME.gain, left=left)
    chosen = _simplest_first([pair, HISTORY, ONE])
    assert chosen[0].name == first
    assert {r.name for r in chosen} == {"learned_pair", "learned_history", "learned"}


def test_other_kinds_keep_their_order() -> None:
    pair = row("learned_pair", SOME.gain, left=0.97)
    assert _simplest_first([HISTORY, pair, ONE]) == [HISTORY, pair, ONE]
    assert _simplest_first([pair, HISTORY]) == [pair, HISTORY]


@pytest.mark.parametrize(("left", "first"), [(0.98, "learned_spot"), (1.2, "learned_map")])
def test_of_two_curves_over_the_map_that_do_alike_that_of_fewer_numbers(
    left: float, first: str
) -> None:
    """A spot has thirteen, a map thirty-three; a history is of another kind."""
    rows = [row("learned_map", SOME.gain, left=0.95), HISTORY]
    chosen = _simplest_first([*rows, row("learned_spot", SOME.gain, left=left)])
    assert chosen[0].name == first
    assert _simplest_first(rows) == rows
