"""What a gain is, and how sure."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.diagnosis.heldout import (
    HeldOutScorer,
    gain,
    probabilities,
    rank,
    select_finalists,
)
from sim.diagnosis.screening import CATALOGUE
from sim.prediction.free_runs import Ruler
from sim.prediction.segments import CompareSettings, Segments

BLOCK = np.repeat(np.arange(20), 30)


def noise(seed: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.asarray(np.random.default_rng(seed).normal(0.0, 1.0, len(BLOCK)))


def test_a_fit_gains_nothing_over_itself() -> None:
    g = gain(noise(1), noise(1), BLOCK)
    assert (g.ratio, g.log_ratio, g.nats) == (1.0, 0.0, 0.0)


def test_gains_of_there_and_back_are_opposite() -> None:
    there, back = gain(2.0 * noise(1), noise(2), BLOCK), gain(noise(2), 2.0 * noise(1), BLOCK)
    assert np.isclose(there.log_ratio, -back.log_ratio)
    assert np.isclose(there.nats, -back.nats)
    assert there.t > 10.0


def test_one_wild_row_decides_nothing() -> None:
    before = noise(1)
    before[100] = 1e6
    assert gain(before, noise(1), BLOCK).nats < 10.0


def test_what_is_won_in_few_blocks_and_lost_in_none_is_told_from_what_sways() -> None:
    local, even = noise(1), noise(1)
    local[BLOCK < 2] *= 4.0
    assert gain(local, even, BLOCK).lost == 0.0
    assert gain(noise(1), noise(2), BLOCK).lost > 0.3


def test_probabilities_are_shared_by_equals_and_won_by_the_better() -> None:
    even = np.full((3, 20), 60.0)
    even[0] += 40.0
    np.testing.assert_allclose(probabilities(even), [0.0, 0.5, 0.5], atol=1e-9)
    even[1] -= 3.0
    better = probabilities(even)
    assert better[1] > 0.99
    assert np.isclose(better.sum(), 1.0)


def test_nothing_is_missing_until_an_effect_wins_more_than_chance() -> None:
    blocks = np.full((3, 20), 60.0)
    blocks[1] -= 1.5  # 5 nats in all
    assert probabilities(blocks)[0] > 0.9
    blocks[1] -= 6.0
    assert probabilities(blocks)[1] > 0.99


def test_a_lead_that_hangs_on_one_block_is_doubted() -> None:
    blocks = np.full((2, 20), 90.0)
    blocks[1, 0] -= 90.0
    assert 0.4 < probabilities(blocks)[1] < 0.95
    blocks[1] = 90.0 - 90.0 / 20.0
    assert probabilities(blocks)[1] > 0.99


def test_a_gain_is_made_of_plain_numbers_that_go_into_json() -> None:
    assert {type(x) for x in gain(noise(1), noise(2), BLOCK)} == {float}


def test_errors_of_exactly_nothing_are_worth_nothing() -> None:
    nothing = np.zeros(len(BLOCK))
    assert gain(nothing, nothing, BLOCK) == (1.0, 0.0, 0.0, 0.0, 0.0)
    for g in (gain(noise(1), nothing, BLOCK), gain(nothing, noise(1), BLOCK)):
        assert np.isfinite(g).all()


def test_the_few_that_are_fitted_whole() -> None:
    """Those with a tenth of the best one's promise, three at least, and what must be among them."""

    def names(*promises: float, special: str = "", own: str = "") -> list[str]:
        results: Any = [
            SimpleNamespace(
                name=own if own and k == len(promises) - 1 else sorted(CATALOGUE)[k],
                deviance=1000.0 - promise,
                added=SimpleNamespace(effect=SimpleNamespace(general_of=special if k == 0 else "")),
            )
            for k, promise in enumerate(promises)
        ]
        return [r.name for r in select_finalists(results)]

    a, b, c, d, e, f = sorted(CATALOGUE)[:6]
    assert names(100.0, 50.0, 30.0, 20.0, 2.0, 0.0) == [a, b, c, d]
    assert names(100.0, 1.0, 0.5, 0.2, 0.0) == [a, b, c]
    assert names(*(100.0 - k for k in range(8)), 0.0) == [a, b, c, d, e, f]
    assert names(100.0, 50.0, 30.0, 1.0, 0.5, 0.0, special=e) == [a, b, c, e]
    assert names(100.0, 50.0, 30.0, 1.0, 0.0, own="mine") == [a, b, c, "mine"]


class MadeModel(SimpleNamespace):
    """Predicts with the error that its one number says, in all velocities [scales]."""


def made_predict(trial: Any, model: Any, ruler: Any) -> Any:
    """One row of each segment."""
    count = len(ruler.segments.rows)
    error = np.full((count, 6), model.theta[0])
    return SimpleNamespace(predicted_rows=lambda: (np.arange(count), ruler.segments.rows, error))


def scorer_of(*block: list[int], error: float = 5.0) -> HeldOutScorer:
    """Of trials with one segment a row, in these blocks."""
    rulers = [
        Ruler(
            CompareSettings(), Segments(np.arange(len(b)), np.ones(len(b), np.int64), 1), 0.0,
            np.ones(3), np.zeros((len(b), 2, 6)), np.array(b),
        )
        for b in block
    ]  # fmt: skip
    trials: Any = tuple(SimpleNamespace(time=0.1 * np.arange(len(b))) for b in block)
    first: Any = MadeModel(theta=[5.0])
    return HeldOutScorer(trials, tuple(rulers), first, error)


def test_each_block_is_predicted_by_the_fit_that_did_not_see_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Four fits, wrong by 1, 2, 3 and 4 wherever they are asked: each answers for its fold only."""
    monkeypatch.setattr("sim.diagnosis.heldout.predict", made_predict)
    monkeypatch.setattr(
        "sim.diagnosis.heldout.replace", lambda model, theta: MadeModel(theta=theta)
    )
    fold = np.array([0, 1, 1, 2, 3, 3])
    z = np.array([[1.0], [2.0], [3.0], [4.0]])
    fit: Any = SimpleNamespace(
        unknowns=SimpleNamespace(model=None, theta=lambda z, _: z),
        fold_fits=SimpleNamespace(z=z), recording_fits=SimpleNamespace(z=z),
        problem=SimpleNamespace(fold_at=lambda _, time: fold[: len(time)]),
    )  # fmt: skip
    scorer = scorer_of([0, 0, 1, 1, 2, 2])
    assert scorer.score_fit(fit).nrmse ** 2 == pytest.approx((1 + 4 + 4 + 9 + 16 + 16) / 6)
    half = scorer.score_fit(fit, lambda theta: 0.5 * theta)
    assert half.nrmse == pytest.approx(0.5 * scorer.score_fit(fit).nrmse)
    whole: Any = MadeModel(theta=[3.0])
    assert scorer.score_model(whole).nrmse == pytest.approx(3.0)  # not fitted: all time counts
    assert scorer.score_recordings(fit) is None
    left_out = scorer_of([0], [0, 1], [0]).score_recordings(fit)
    assert left_out is not None
    assert left_out.nrmse**2 == pytest.approx((1 + 2 * 4 + 9) / 4)


def test_blocks_of_two_recordings_are_told_apart_and_one_block_has_no_interval(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sim.diagnosis.heldout.predict", made_predict)
    model: Any = MadeModel(theta=[3.0])
    assert scorer_of([5, 5, 5]).score_model(model).ci95 is None
    assert scorer_of([5], [5]).score_model(model).ci95 == pytest.approx((3.0, 3.0))
    both = scorer_of([5], [5])
    too_short = replace(both, rulers=(None, both.rulers[0]))
    assert too_short.score_model(model).ci95 is None


@pytest.mark.parametrize(
    ("own", "noise", "is_shared"), [(0.12, 0.1, True), (0.31, 0.1, False), (0.12, 0.9, False)]
)
def test_the_ruler_is_that_of_the_vessel_which_predicts_best_by_its_own(
    own: float, noise: float, is_shared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The given vessel errs by 0.3 by its own ruler, and the fit by more by that one."""
    before = scorer_of([0, 1], [0], error=0.3)
    loud = np.full((2, 2, 6), noise**2)
    rulers = tuple(replace(r, variance=loud) for r in scorer_of([2, 3], [4, 4]).rulers if r)
    asked: list[Any] = []

    def ruler(trial: Any, model: Any) -> Any:
        asked.append(float(model))
        return rulers[next(i for i, one in enumerate(before.trials) if one is trial)]

    def changed(made: Any, **values: Any) -> Any:
        return values["theta"][0] if made is before.first else replace(made, **values)

    def score(scorer: HeldOutScorer, fit: Any) -> Any:
        return SimpleNamespace(nrmse=own if scorer.rulers[0] is rulers[0] else 0.9)

    monkeypatch.setattr("sim.diagnosis.heldout.replace", changed)
    monkeypatch.setattr("sim.diagnosis.heldout._ruler", ruler)
    monkeypatch.setattr(HeldOutScorer, "score_fit", score)
    fit: Any = SimpleNamespace(
        z=np.array([7.0]),
        noise_share=(0.6, 0.6, 0.7),
        unknowns=SimpleNamespace(model=before.first, theta=lambda z, i: z + 10.0 * i),
    )
    after = before.shared_with(fit)
    assert asked == [7.0, 17.0]  # each trial its own numbers
    assert (after.rulers[0] is rulers[0], after is before) == (is_shared, not is_shared)
    assert after.error == (own if is_shared else 0.3)
    fit.noise_share = (0.6, 0.6, 1.9)  # gusts turn her
    assert before.shared_with(fit).error == after.error
    for of_another in ((1.1, 0.6, 0.7), (0.6, 1.1, 0.7), (0.6, 0.6, 2.1)):
        fit.noise_share = of_another  # a model that is not the boat's
        assert before.shared_with(fit) is before


def test_noise_is_that_of_the_effect_which_comes_first_in_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Fitted anew under the noise that the best leaves, until the best is the one that gave it."""
    asked: list[Any] = []
    leaders: list[Any] = []
    said: list[str] = []
    results = [SimpleNamespace(name=name) for name in ("a", "b", "c", "d")]
    best = {"a": "b", "b": "c", "c": "c"}
    nats = 50.0

    def screen(*given: Any) -> Any:
        asked.append(given)
        return results

    def ranked(reference: Any, found: Any, leader: Any, mapper: Any) -> Any:
        leaders.append(leader.name)
        name = best[leader.name]
        fit, worth = SimpleNamespace(name=name), SimpleNamespace(nats=nats)
        return SimpleNamespace(best=SimpleNamespace(name=name, fit=fit, gain=worth))

    monkeypatch.setattr("sim.diagnosis.heldout.screen", screen)
    monkeypatch.setattr("sim.diagnosis.heldout.select_finalists", lambda found: found[:3])
    monkeypatch.setattr("sim.diagnosis.heldout._rank_finalists", ranked)
    monkeypatch.setattr("sim.diagnosis.heldout.thresholds.MAX_NOISE_ROUNDS", 3)
    nothing: Any = None
    reference: Any = SimpleNamespace(names=())
    assert rank(nothing, nothing, [], reference, said.append).best.name == "c"
    assert leaders == ["a", "b", "c"]
    assert said == ["fitting a, b, c"] * 3
    # no closer look unless asked for, no rival, and no place in question
    assert asked[0][6:] == (False, None, None)
    best["a"] = "a"
    leaders.clear()
    rank(nothing, nothing, [], reference, said.append)
    assert leaders == ["a"]
    best["a"], best["b"] = "b", "a"  # to and fro: a few rounds are enough
    rank(nothing, nothing, [], reference)
    assert leaders == ["a", "a", "b", "a"]
    leaders.clear()
    nats = 1.0  # what is worth nothing gives no other noise
    rank(nothing, nothing, [], reference)
    assert leaders == ["a"]
    results.clear()
    assert rank(nothing, nothing, [], reference).finalists == ()
