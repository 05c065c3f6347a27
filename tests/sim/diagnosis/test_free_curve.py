"""Which of the curves that are worth it is taken: the simplest that is nearly as good."""

import pytest

from sim.diagnosis.free_curve import _simplest_first
from tests.sim.diagnosis.rankings import SOME, row


def alike(fit: object) -> float:
    """Free runs that tell nothing apart."""
    return 0.3


HISTORY, ONE = row("learned_history", SOME.gain, left=0.95), row("learned", SOME.gain, left=1.0)


@pytest.mark.parametrize(("left", "first"), [(0.97, "learned"), (0.8, "learned_pair")])
def test_two_variables_have_to_be_clearly_better_than_one(left: float, first: str) -> None:
    """Squared errors of 6 and of 36 % less."""
    pair = row("learned_pair", SOME.gain, left=left)
    chosen = _simplest_first([pair, HISTORY, ONE], alike)
    assert chosen[0].name == first
    assert {r.name for r in chosen} == {"learned_pair", "learned_history", "learned"}


def test_other_kinds_keep_their_order() -> None:
    pair = row("learned_pair", SOME.gain, left=0.97)
    assert _simplest_first([HISTORY, pair, ONE], alike) == [HISTORY, pair, ONE]
    assert _simplest_first([pair, HISTORY], alike) == [pair, HISTORY]


@pytest.mark.parametrize(("left", "first"), [(0.98, "learned_spot"), (1.2, "learned_map")])
def test_of_two_curves_over_the_map_that_do_alike_that_of_fewer_numbers(
    left: float, first: str
) -> None:
    """A spot has thirteen, a map thirty-three; a history is of another kind."""
    rows = [row("learned_map", SOME.gain, left=0.95), HISTORY]
    chosen = _simplest_first([*rows, row("learned_spot", SOME.gain, left=left)], alike)
    assert chosen[0].name == first
    assert _simplest_first(rows, alike) == rows


def test_a_simpler_curve_that_errs_more_in_free_runs_comes_behind() -> None:
    pair = row("learned_pair", SOME.gain, left=0.97)
    errors = {id(pair.fit): 0.30, id(ONE.fit): 0.37}
    assert _simplest_first([pair, ONE], lambda fit: errors[id(fit)])[0] is pair
    errors[id(ONE.fit)] = 0.34
    assert _simplest_first([pair, ONE], lambda fit: errors[id(fit)])[0] is ONE
