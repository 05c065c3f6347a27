"""Which of two vessels is better, by how much, where not, and when nobody can say."""

from dataclasses import replace

import numpy as np
import pytest

from sim.comparison.compare import Comparison, compare
from sim.comparison.improvement import Improvement, improvements
from sim.model import Model
from tests.sim.voyages import WAM_V, simulated


def vessel(name: str, **factors: float):
    """The true vessel with some numbers changed."""
    numbers = {key: getattr(WAM_V.dynamics, key) * factor for key, factor in factors.items()}
    return replace(WAM_V, name=name, dynamics=replace(WAM_V.dynamics, **numbers))


@pytest.fixture(scope="module")
def found() -> dict[str, Comparison]:
    """A boat with truth in four vessels: the truth, a little off twice, far off."""
    trial = simulated(WAM_V, 120.0)
    vessels = [
        vessel("far", X_u=3.0, N_r=2.0), vessel("truth"), vessel("near", X_u=1.2),
        vessel("alike", X_u=1.2001),
    ]  # fmt: skip
    return {c.vessel: c for c in compare(trial, [Model.of(v) for v in vessels])}


def test_the_better_one_is_named_whatever_the_order_and_by_how_much(found) -> None:
    (down,) = improvements([found["far"], found["near"]])
    (up,) = improvements([found["near"], found["far"]])
    fall = 100 * (1.0 - found["near"].nrmse / found["far"].nrmse)
    for one in (down, up):
        says = f"near is better than far on voyage: the error falls by {fall:.0f} % ("
        assert one.sentence.startswith(says)
        assert one.sentence.endswith("%), everywhere")
        assert one.clear
    assert down.ratio == pytest.approx(1.0 / up.ratio)
    low, high = down.ci95
    assert low < down.ratio < high < 1.0


def test_two_that_err_alike_are_not_told_apart(found) -> None:
    (one,) = improvements([found["far"], replace(found["far"], vessel="again")])
    assert not one.clear
    assert one.sentence == "far and again on voyage: no clear difference"


def test_noise_judges_nothing(found) -> None:
    (one,) = improvements([found["truth"], found["alike"]])
    assert one.noise == (found["alike"].nrmse <= 1.2 * found["truth"].noise_floor_nrmse)
    loud = [replace(found[name], noise_floor_nrmse=10.0) for name in ("far", "truth")]
    (one,) = improvements(loud)
    assert "both err by no more than noise" in one.sentence
    assert not one.clear


def test_where_the_better_one_is_worse_is_said(found) -> None:
    """Half of its error in a condition in which the other has next to none."""
    better, worse = found["near"], found["far"]
    k = max(range(len(better.where)), key=lambda i: better.where[i].seconds)
    bad = replace(better.where[k], share=0.9)
    other = [replace(b, share=1e-6) if (b.by, b.start) == (bad.by, bad.start) else b
             for b in worse.where]  # fmt: skip
    (one,) = improvements([replace(worse, where=tuple(other)), replace(better, where=(bad,))])
    name = bad.sentence.partition(":")[0]
    assert one.but == (name,)
    assert one.sentence.endswith(f"everywhere but at {name}")
    short = replace(bad, seconds=5.0)
    (one,) = improvements([replace(worse, where=tuple(other)), replace(better, where=(short,))])
    assert one.but == ()


@pytest.mark.parametrize(("grows", "soon", "unsure"), [
    (True, "as bad", True), (True, "better", False), (False, "as bad", False),
])  # fmt: skip
def test_a_hull_that_is_too_steady_is_not_simply_better(
    found, monkeypatch, grows: bool, soon: str, unsure: bool
) -> None:
    """Of an unstable hull a wrong file was better than the truth "by 14 %, everywhere"."""
    monkeypatch.setattr(Comparison, "cut_text", "an error of the start grows" if grows else "")
    better, worse = found["near"], found["far"]
    if soon == "as bad":
        error, rows = better.prediction.error.copy(), 22  # a second of rows of 0.05 s
        error[:, :rows] = worse.prediction.error[:, :rows]
        better = replace(better, prediction=replace(better.prediction, error=error))
    (one,) = improvements([worse, better])
    assert one.unsure is unsure
    assert ("but hardly in the first half second of each run" in one.sentence) is unsure
    assert ("unsure" in one.to_dict()) is unsure


@pytest.mark.parametrize(
    ("place", "heading", "left", "said"),
    [
        (3.0, 3.0, False, True), (3.0, 1.2, False, False), (1.2, 3.0, False, False),
        (3.0, 3.0, True, False),  # the other one left the track: it errs by more
    ],
)  # fmt: skip
def test_one_that_goes_astray_in_a_free_run_is_not_simply_better(
    found, place: float, heading: float, left: bool, said: bool
) -> None:
    """A wrong file was better than the truth "by 23 %, everywhere", and went 1.5 m astray."""
    better, worse = found["near"], found["far"]
    own = worse.free_run.scores.rmse
    lost = {**own, "x": place * own["x"], "y": place * own["y"], "psi": heading * own["psi"]}
    run = replace(worse.free_run, scores=replace(worse.free_run.scores, rmse=lost))
    other = replace(worse, free_run=replace(worse.free_run, diverged=left))
    (one,) = improvements([other, replace(better, free_run=run)])
    assert one.sentence.startswith("near is better than far")
    assert ("; but in one free run its place is off by " in one.sentence) is said
    assert ("place_of_free_run_m" in one.to_dict()) is said


def test_each_recording_is_judged_by_itself(found) -> None:
    second = [replace(found[name], log="another") for name in ("far", "truth")]
    told = improvements([found["far"], found["truth"], *second])
    assert [one.log for one in told] == ["voyage", "another"]
    namesake = replace(found["truth"], ruler=replace(found["truth"].ruler))  # a trial of its own
    assert improvements([found["far"], namesake]) == []
    entry = told[0].to_dict()
    assert entry["says"] == told[0].sentence
    assert entry["clear"] is True
    assert np.isfinite(entry["ratio_ci95"]).all()


def test_of_a_single_block_of_time_the_errors_are_told_and_no_more() -> None:
    trial = simulated(WAM_V, 12.0)
    vessels = [vessel("truth"), vessel("far", X_u=3.0, N_r=2.0)]
    truth, far = compare(trial, [Model.of(v) for v in vessels])
    (one,) = improvements([replace(truth, nrmse=0.569), replace(far, nrmse=4.156)])
    assert one.ci95 is None
    assert not one.clear
    assert one.sentence == (
        "truth and far on voyage: the errors are 0.57 and 4.16, from too little time to tell how "
        "sure that is"
    )
    assert "ratio_ci95" not in one.to_dict()
    quiet = replace(one, noise=True)
    assert quiet.sentence.endswith("no more than noise, these data cannot tell which is better")


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((0.80, 0.95), "both err by no more than noise, b by 13 % less (5 to 20 %)"),
        ((1.05, 1.25), "both err by no more than noise, a by 13 % less (5 to 20 %)"),
        ((0.80, 1.05), "both err by no more than noise, these data cannot tell which is better"),
    ],
)
def test_of_two_at_the_noise_the_nearer_is_told_where_blocks_of_time_tell_it(ends, said) -> None:
    ratio = 0.87 if ends[0] < 1.0 else 1.0 / 0.87
    one = Improvement("log", "a", "b", (1.0, ratio), ends, True, ())
    assert one.sentence == f"a and b on log: {said}"
    assert not one.clear  # neither is wrong


def test_a_velocity_in_which_the_better_one_errs_more_is_told(found) -> None:
    """ "Better by 44 %, everywhere" was said of a file whose surge had grown from 0.14 to 0.19."""
    rmse = {**found["far"].scores.rmse, "u": 0.5 * found["near"].scores.rmse["u"]}
    far = replace(found["far"], scores=replace(found["far"].scores, rmse=rmse))
    (one,) = improvements([far, found["near"]])
    assert one.worse == (f"surge ({rmse['u']:.2g} → {2 * rmse['u']:.2g} m/s)",)
    assert one.sentence.endswith(f"%), everywhere; but it errs by more in {one.worse[0]}")
    assert one.to_dict()["errs_more_in"] == list(one.worse)
