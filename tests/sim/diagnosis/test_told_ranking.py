"""Probabilities of a ranking, as they are told: among what is believed."""

import pytest

from sim.diagnosis.answer import Candidate, among_believed


def candidate(effect: str, probability: float, general_of: str = "") -> Candidate:
    return Candidate(effect, probability, 1.0, (), general_of=general_of)


RANKING = (
    candidate("steady_current", 0.01),
    candidate("current_change", 0.95, "steady_current"),
    candidate("steady_wind", 0.02),
)


def test_a_change_that_is_none_counts_for_the_steady_effect() -> None:
    told = {row.effect: row for row in among_believed(RANKING, ["current_change"])}
    assert told["steady_current"].probability == pytest.approx(0.96)
    assert told["steady_wind"].probability == pytest.approx(0.02)
    assert told["current_change"].doubted
    assert told["current_change"].to_dict()["doubted"] is True
    assert not told["steady_wind"].doubted
    assert set(told["steady_wind"].to_dict()) == {
        "effect", "probability", "heldout_nrmse", "confounded_with", "alike",
    }  # fmt: skip


def test_the_share_of_what_is_not_believed_is_that_of_all_others() -> None:
    """The base alone has 2 % beside them: it gains as much in proportion."""
    rows = (*RANKING[::2], candidate("tow", 0.95))
    told = {row.effect: row.probability for row in among_believed(rows, ["tow"])}
    assert told == {
        "steady_current": pytest.approx(0.2), "steady_wind": pytest.approx(0.4), "tow": 0.0,
    }  # fmt: skip


def test_where_all_is_believed_nothing_changes() -> None:
    assert among_believed(RANKING, ["cubic_drag"]) == RANKING
    assert among_believed((), []) == ()
