"""Which numbers an answer ends with: those under their own noise, or those that were chosen."""

from types import SimpleNamespace
from typing import Any

import pytest

from sim.diagnosis import ladder
from sim.diagnosis.ladder import EffectSearch
from sim.effects.catalogue import EFFECTS
from tests.sim.diagnosis.made_scorer import MadeScorer


@pytest.mark.parametrize(
    ("error", "share", "is_last"),
    [
        (0.41, 0.9, True),  # no more than noise from one moment to the next: a hull may be unstable
        (0.41, 1.2, False),  # it runs away
        (0.302, 1.2, True),  # as good as before
        (0.895, 0.9, False),  # no better than without effects
    ],
)
def test_the_last_numbers_stand_where_they_leave_noise_or_predict_as_well(
    error: float, share: float, is_last: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fit(nrmse: float, left: float) -> Any:
        return SimpleNamespace(nrmse=nrmse, noise_share=(0.6, 0.6, left))

    before, last = fit(0.3, 1.14), fit(error, share)
    monkeypatch.setattr(ladder, "final_fit", lambda fit: last)
    nothing: Any = None
    scorer: Any = MadeScorer(0.1, 0.9)
    search = EffectSearch(nothing, EFFECTS, 4, lambda _: None, map, scorer)
    assert search.settled(fit(0.9, 4.0), before) is (last if is_last else before)
