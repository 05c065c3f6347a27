"""The scorer on made-up answers: every figure is right where all is right, and can fail."""

import math

import pytest

from benchmarks.hidden import run, score, tables
from benchmarks.hidden.boats import BOATS
from benchmarks.hidden.judge import improved
from benchmarks.hidden.score import Row
from benchmarks.hidden.vessel_toml import vessel_toml
from gateway.vessel_file import load_vessel


def diagnosis(*effects, verdict="explained", ranking=(), with_=(), value=0.3, half=0.05):
    """What a diagnosis says that names these effects."""
    ranked = ranking or effects
    parameters = {
        "heading_offset": {"angle": {"value": value, "ci95": [value - half, value + half]}}
    }
    return {
        "verdict": verdict,
        "base_changed": False,
        "effects": list(effects),
        "ladder": [
            {"effects": [], "base": "plain", "heldout_nrmse": 0.4},
            {
                "effects": list(effects),
                "base": "refitted",
                "base_parameters": {"m11": {"value": 50.0}},
                "parameters": {e: parameters[e] for e in effects if e in parameters},
            },
        ],
        "ranking": [
            {"effect": e, "probability": 0.9 if i == 0 else 0.05, "confounded_with": list(with_)}
            for i, e in enumerate(ranked)
        ],
    }


def row(truth=("heading_offset",), said=None, family="excitation", gain=5.0, **more):
    """A case; `more` overrides what is judged."""
    answer = {
        "name": "-".join((*truth, family)),
        "family": family,
        "effects": list(truth),
        "unknown": family == "unknown",
        "misjudged": False,
    }
    result = {"seconds": 10.0, **({} if said is None else {"diagnosis": said})}
    oracle = {
        "gain": gain,
        "refit": 0.4,
        "complete": 0.1,
        "truth": {"heading_offset": {"angle": 0.3}},
        "parameters": {"heading_offset.angle": {"value": 0.3, "ci95": [0.28, 0.32]}},
        "worth": more.pop("worth", {}),
    }
    judged = {"before": 0.4, "after": 0.1, "oracle": 0.1} | more
    return Row(answer, result, oracle, judged)


RIGHT = row(said=diagnosis("heading_offset"))
WRONG = row(said=diagnosis("steady_current", ranking=("steady_current", "a", "heading_offset")))
SILENT = row(said=diagnosis(verdict="adequate"))
FAILED = row()


def test_the_right_effect_is_right():
    for what in (score.top_1, score.exact, score.top_3, score.with_confounded):
        assert what(RIGHT)
        assert not what(SILENT)
        assert not what(FAILED)
    assert not score.top_1(WRONG)
    assert score.top_3(WRONG)


def test_one_effect_too_many_is_not_exact():
    extra = row(said=diagnosis("heading_offset", "cubic_drag"))
    assert score.top_1(extra)
    assert not score.exact(extra)


def test_a_verdict_that_names_nothing_is_not_right_by_its_ranking():
    for verdict in ("unknown", "adequate"):
        assert not score.top_1(row(said=diagnosis("heading_offset", verdict=verdict)))


def test_confounded_counts_with_the_truth_among_three():
    near = diagnosis("steady_current", verdict="confounded", with_=("heading_offset",))
    assert score.confounded(row(said=near))
    assert score.with_confounded(row(said=near))
    assert not score.top_1(row(said=near))
    many = diagnosis("a", verdict="confounded", with_=("b", "c", "heading_offset"))
    assert not score.with_confounded(row(said=many))
    none = diagnosis("a", verdict="confounded", with_=("b",))
    assert not score.with_confounded(row(said=none))


def test_adequate_is_right_where_the_base_absorbs_the_effect():
    assert score.top_1(row(said=diagnosis(verdict="adequate"), gain=1.1))
    assert not score.top_1(row(said=diagnosis(verdict="adequate"), gain=1.3))
    assert score.top_1(row(said=diagnosis("heading_offset"), gain=1.1))
    assert not score.top_1(row(said=diagnosis("steady_current"), gain=1.1))


def test_a_pair_needs_both_unless_one_is_absorbed():
    truth = ("heading_offset", "cubic_drag")
    whole, half = diagnosis(*truth), diagnosis("heading_offset")
    assert score.both(row(truth, whole, "pair"))
    assert not score.both(row(truth, half, "pair"))
    assert score.some(row(truth, half, "pair"))
    assert score.both(row(truth, half, "pair", worth={"cubic_drag": 1.1, "heading_offset": 3.0}))
    assert not score.both(row(truth, diagnosis(*truth, "steady_current"), "pair"))


def test_alarms_and_strangers():
    assert not score.alarm(row((), diagnosis(verdict="adequate"), "none"))
    for said in (diagnosis("cubic_drag"), diagnosis(verdict="unknown"), None):
        assert score.alarm(row((), said, "none"))
    assert score.recognised(row(("tether",), diagnosis(verdict="unknown"), "unknown"))
    assert not score.recognised(row(("tether",), diagnosis("cubic_drag"), "unknown"))
    assert not score.recognised(row(("tether",), diagnosis(verdict="adequate"), "unknown"))


def test_of_a_day_what_matters_is_to_be_named_and_nothing_else():
    truth = ("heading_offset", "cubic_drag", "current_change")
    whole, part = row(truth, diagnosis(*truth), "day"), diagnosis(*truth[:2])
    more = row(truth, diagnosis(*truth, "hull_lift"), "day")
    less = row(truth, part, "day")
    small = row(truth, part, "day", worth={"current_change": 1.1})
    lost = row(truth, diagnosis(*truth, verdict="unknown"), "day")
    days = (whole, more, less, small, lost)
    assert [score.all_named(r) for r in days] == [True, True, False, True, False]
    assert [score.invented(r) for r in days] == [False, True, False, False, False]


def test_at_sea_waves_may_be_named_and_nothing_else_that_is_not_there():
    truth = ("sea", "heading_offset")
    right, named = row(truth, diagnosis("heading_offset", "wave_motion"), "sea"), "hull_lift"
    wrong = row(truth, diagnosis("heading_offset", named), "sea")
    calm = row(("sea",), diagnosis(verdict="adequate"), "sea")
    assert [score.beside_the_sea(r) for r in (right, wrong, calm)] == [True, False, True]
    assert [score.invented_at_sea(r) for r in (right, wrong, calm)] == [False, True, False]
    silent = row(truth, diagnosis("wave_motion"), "sea")
    assert not score.beside_the_sea(silent)
    assert not score.invented_at_sea(silent)


def test_as_good_as_who_knew():
    assert score.within(row(said=diagnosis("heading_offset"), after=0.12))
    assert not score.within(row(said=diagnosis("heading_offset"), after=0.13))
    assert score.errors([RIGHT])["oracle"] == 0.1
    assert math.isnan(score.errors([Row({}, {})])["within"])


def test_intervals_hold_the_truth_or_not():
    (good,) = score.told(RIGHT)
    assert good.covered
    assert good.error == pytest.approx(0.0)
    assert good.width == pytest.approx(2.5)
    (off,) = score.told(row(said=diagnosis("heading_offset", value=0.36)))
    assert not off.covered
    assert off.error == pytest.approx(0.2)
    assert score.told(WRONG) == []


def test_a_direction_is_near_its_own_other_side():
    said = diagnosis("steady_current")
    said["ladder"][-1]["parameters"] = {
        "steady_current": {"direction": {"value": 3.1, "ci95": [3.0, 3.2]}}
    }
    one = row(("steady_current",), said)
    one.oracle["truth"]["steady_current"] = {"direction": -3.1}
    (told,) = score.told(one)
    assert told.error == pytest.approx(2.0 * math.pi - 6.2)
    assert told.covered


def test_a_tide_that_runs_the_other_way_half_a_period_later_is_the_same_tide():
    true = {"speed": 0.3, "direction": -2.0, "period": 300.0, "phase": 1.0}
    said = {key: {"value": value, "ci95": [value - 0.1, value + 0.1]} for key, value in {
        **true, "direction": true["direction"] + math.pi, "phase": true["phase"] - math.pi,
    }.items()}  # fmt: skip
    answer = diagnosis("varying_current")
    answer["ladder"][-1]["parameters"] = {"varying_current": said}
    one = row(("varying_current",), answer)
    one.oracle["truth"]["varying_current"] = true
    assert [t.covered for t in score.told(one)] == [True] * 4
    said["phase"] = {"value": 1.0, "ci95": [0.9, 1.1]}  # one of the two turned about alone is not
    assert sum(t.covered for t in score.told(one)) == 3


def test_probabilities_are_held_against_the_truth():
    bins = {b["from"]: b for b in score.reliability([RIGHT, WRONG])}
    assert bins[0.9]["true"] == 0.5
    assert bins[0.9]["cases"] == 2
    assert bins[0.02]["true"] == 0.5  # third in the ranking of WRONG


def test_the_table_tells_goals_that_are_missed(tmp_path):
    rows = [RIGHT, WRONG, SILENT, FAILED, row((), diagnosis(verdict="adequate"), "none")]
    text = tables.report(rows, "made up")
    assert "**no**" in text
    assert "heading_offset | 4     | heading_offset 1, steady_current 1" in text
    assert "adequate (excitation), failed (excitation)" in text
    tables.picture(rows, tmp_path / "confusion.png")
    assert (tmp_path / "confusion.png").stat().st_size > 1000
    pairs = [row(("heading_offset", "cubic_drag"), diagnosis("cubic_drag"), "pair")]
    tables.picture(pairs, tmp_path / "nothing.png")
    assert not (tmp_path / "nothing.png").exists()
    assert "**no**" not in tables.goals(
        {k: 1.0 if more else 0.0 for k, (_, _, more) in tables.GOALS.items()}
    )


def test_peers_are_shown_where_they_win():
    who = {"ours": [WRONG], "theirs": [RIGHT], "thirds": [WRONG]}
    text = tables.side_by_side(who)
    assert "| top-1, excitation | 1     | 0 %  | 100 %  | 0 %    |" in text
    assert "theirs is right on heading_offset" in text
    assert "thirds is right" not in text


class Said:
    """What a diagnosis returns."""

    def to_dict(self):
        return diagnosis("heading_offset")


def test_the_runner_shows_log_and_vessel_alone_and_keeps_what_fails(tmp_path, monkeypatch):
    seen = []

    def found(logs, vessel, *, improve):
        seen.append((logs, vessel))
        if "bad" in str(vessel):
            raise ValueError("cannot")
        return Said()

    monkeypatch.setattr(run, "diagnosis_of", lambda by: found)
    run.asked("good", tmp_path / "questions" / "good", tmp_path, "made:up")
    run.asked("bad", tmp_path / "questions" / "bad", tmp_path, "made:up")
    assert all("answers" not in str(path) for logs, vessel in seen for path in (*logs, vessel))
    results = {n: run.read_json(run.result_of(n, tmp_path, "made:up")) for n in ("good", "bad")}
    assert results["good"]["diagnosis"]["effects"] == ["heading_offset"]
    assert "ValueError: cannot" in results["bad"]["error"]


def test_what_is_not_there_is_told():
    with pytest.raises(run.NoDiagnosisError, match="no_such_module"):
        run.diagnosis_of("no_such_module:function")


def test_what_a_result_holds_is_not_asked_again(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(run, "diagnosis_of", lambda by: None)
    monkeypatch.setattr(run, "in_workers", lambda work, todo, *_: asked.extend(t[0] for t in todo))
    run.write_json(run.result_of("one", tmp_path), {})
    run.diagnose(["one", "two"], tmp_path, 1, print)
    assert asked == ["two"]


def test_the_improved_vessel_is_the_step_that_the_answer_stands_by(tmp_path):
    file = tmp_path / "boat.toml"
    file.write_text(vessel_toml(BOATS["grebe"]), encoding="utf-8")
    plain = load_vessel(file)
    found = improved(plain, diagnosis("heading_offset"))
    assert found.dynamics.m11 == 50.0
    assert found.effects[0].values == {"angle": 0.3}
    assert improved(plain, diagnosis(verdict="adequate")) == plain
