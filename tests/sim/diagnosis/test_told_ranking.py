"""Probabilities of a ranking, as they are told: among what is believed."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from sim.diagnosis.answer import Candidate, Diagnosis, among_believed, with_general_in


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


def test_what_is_left_of_next_to_nothing_is_still_one_in_all() -> None:
    """100.0 % stood twice in one column, beside a rival that was not believed."""
    rows = (candidate("curve", 3e-20), candidate("band", 1e-20), candidate("load", 1.0))
    told = {row.effect: row.probability for row in among_believed(rows, ["load"])}
    assert told == {"curve": pytest.approx(0.75), "band": pytest.approx(0.25), "load": 0.0}
    alone = among_believed((candidate("load", 1.0),), ["load"])
    assert [row.probability for row in alone] == [0.0]


def test_where_all_is_believed_nothing_changes() -> None:
    assert among_believed(RANKING, ["cubic_drag"]) == RANKING
    assert among_believed((), []) == ()


def test_what_can_stand_in_for_what_was_found_is_no_rival_of_it() -> None:
    """A varying current stood with 87.5 % beside the steady one of the verdict with 12.5 %."""
    told = {row.effect: row.probability for row in with_general_in(RANKING, ["steady_current"])}
    assert told == {
        "steady_current": pytest.approx(0.96), "current_change": 0.0, "steady_wind": 0.02,
    }  # fmt: skip
    assert with_general_in(RANKING, ["current_change"]) == RANKING
    assert with_general_in(RANKING[1:], ["steady_current"]) == RANKING[1:]


def told_beside(effects: tuple[str, ...], *errors: float) -> dict[str, float]:
    """Probabilities, as told, of three effects with these errors beside a base of 0.286."""
    rows = tuple(
        replace(candidate(name, chance), heldout_nrmse=error)
        for (name, chance), error in zip(
            (("advance_loss", 1e-13), ("crossflow_drag", 0.8), ("tow", 0.1)), errors, strict=True
        )
    )
    base = [SimpleNamespace(heldout=SimpleNamespace(nrmse=e)) for e in (0.344, 0.286)]
    found: Any = SimpleNamespace(ranking=rows, refused=(), effects=effects, ladder=base)
    return {row.effect: row.probability for row in Diagnosis.told_ranking.fget(found)}


def test_what_lowers_no_error_is_not_the_most_probable_beside_what_was_found() -> None:
    told = told_beside(("advance_loss",), 0.281, 0.301, 0.28)
    assert told["crossflow_drag"] == 0.0
    assert told["tow"] == pytest.approx(0.5)
    assert told_beside(("advance_loss",), 0.281, 0.283, 0.28)["crossflow_drag"] == 0.8
    assert told_beside((), 0.281, 0.301, 0.28)["crossflow_drag"] == 0.8  # nothing was found
    # what was found itself is told, whatever it does alone: it was found beside others
    assert told_beside(("crossflow_drag",), 0.281, 0.301, 0.28)["crossflow_drag"] == 0.8
