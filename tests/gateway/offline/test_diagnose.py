"""`shadow diagnose`: what it prints, what it writes, and what follows from it."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.figures import Dots, Level, Line
from gateway.figures.diagnosis import diagnosis_figures
from gateway.figures.matplotlib_draw import save_figure
from gateway.offline.concentrated import concentrated_error
from gateway.offline.diagnose import (
    DIAGNOSIS_TRIALS,
    DiagnosisResult,
    diagnose_logs,
    save_diagnosis,
)
from gateway.terminal.diagnosis import show_diagnosis
from gateway.vessel_file import dump_vessel, load_vessel
from sim.diagnosis.answer import Verdict
from sim.diagnosis.evidence import rivals
from sim.diagnosis.force_terms import GROUPS
from sim.diagnosis.heldout import Gain
from sim.diagnosis.residual_terms import Dependence
from sim.effects.catalogue import named
from sim.identification import BASE
from sim.vessel import AddedEffect
from tests.gateway.offline.diagnosis import FEW, found_current, refused, sailed
from tests.sim.simulated import on_floats
from tests.sim.voyages import WAM_V


@pytest.fixture(autouse=True)
def _evidence_compiles_nothing(monkeypatch):
    """It takes one effect after another out of the vessel: each time a kernel of its own."""
    monkeypatch.setattr("sim.diagnosis.evidence.Model", SimpleNamespace(of=on_floats))


def test_the_json_is_whole_and_names_where_it_comes_from(found):
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert told["verdict"] == "explained"
    assert told["effects"] == ["steady_current"]
    speed = told["ladder"][-1]["parameters"]["steady_current"]["speed"]
    assert speed["ci95"][0] < 0.3 < speed["ci95"][1]
    assert told["recordings"] == [{"name": "voyage", "seconds": 150.0}]
    assert told["vessel"] == "plain"


def test_the_verdict_comes_first_and_the_next_command_last(run, ready, folder):
    status, out, _ = run("diagnose", "voyage.tlog", "--vessel", folder / "boat.toml")
    assert status == 0
    assert out.startswith("A current of 0.3")
    assert out.split("\n\n")[1].startswith("explained: ")
    for part in ("95 % interval", "noise alone", "steady_current.speed", "--refit voyage"):
        assert part in out
    assert out.index("as given") < out.index("base kept") < out.index("+ steady_current")
    assert "shadow add steady_current --vessel" in out.splitlines()[-2]
    assert ready["improve"] is True


def test_only_json_is_printed_where_it_is_asked_for(run, ready, folder):
    status, out, _ = run("diagnose", "a.tlog", "-v", folder / "boat.toml", "--json",
                            "--no-improve", "--prior", "0.3")  # fmt: skip
    assert status == 0
    assert json.loads(out)["verdict"] == "explained"
    assert ready["improve"] is False
    assert ready["prior"] == 0.3


def test_what_was_asked_for_is_written(run, ready, folder, tmp_path):
    status, out, _ = run(
        "diagnose", "a.tlog", "-v", folder / "boat.toml", "--save", tmp_path / "d.json",
        "--out", tmp_path / "better.toml", "--pictures", tmp_path / "pictures",
    )  # fmt: skip
    assert status == 0
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == {
        "ladder.png", "ranking.png", "evidence-steady_current.png",
    }  # fmt: skip
    assert load_vessel(tmp_path / "better.toml").effects[0].effect.name == "steady_current"
    assert "shadow add" not in out.split("next:")[1]


def test_long_work_is_not_begun_for_a_folder_that_cannot_be_made(run, ready, folder, tmp_path):
    (tmp_path / "no").touch()
    done = run("diagnose", "a.tlog", "-v", folder / "boat.toml", "--save",
                  tmp_path / "no" / "d.json")  # fmt: skip
    refused(done, "nothing can be written there")
    assert ready == {}
    refused(run("diagnose", "a.tlog", "-v", folder / "boat.toml", "--prior", "0"), "--prior 0")


def test_look_alikes_are_told_with_what_separates_them(found, capsys):
    tied = tuple(
        replace(c, confounded_with=tuple({"steady_current", "heading_offset"} - {c.effect}))
        for c in found.diagnosis.ranking
    )
    torn = replace(found.diagnosis, verdict=Verdict.CONFOUNDED, ranking=tied)
    show_diagnosis(replace(found, diagnosis=torn), None, None, None)
    out = capsys.readouterr().out
    assert "steady_current or heading_offset? full circles" in out
    assert "--excitation circles" in out


def test_a_rival_that_the_recording_cannot_show_is_told_too(found, capsys):
    """It stands in no ranking: only beside the effect that was found."""
    best = found.diagnosis.ranking[0]
    tied = (replace(best, confounded_with=("compass_deviation",)), *found.diagnosis.ranking[1:])
    torn = replace(found.diagnosis, verdict=Verdict.CONFOUNDED, ranking=tied)
    assert replace(found, diagnosis=torn).rivals == ["steady_current", "compass_deviation"]
    show_diagnosis(replace(found, diagnosis=torn), None, None, None)
    assert "steady_current or compass_deviation?" in capsys.readouterr().out


def test_recordings_that_were_left_out_have_a_column_where_there_are_some(found, capsys):
    show_diagnosis(found, None, None, None)
    assert "left out" not in capsys.readouterr().out
    *below, last = found.diagnosis.ladder
    some = replace(found.diagnosis, ladder=(*below, replace(last, left_out=last.heldout)))
    show_diagnosis(replace(found, diagnosis=some), None, None, None)
    assert "left out" in " ".join(capsys.readouterr().out.split())


def test_a_rival_has_its_evidence_beside_that_of_what_was_chosen(found):
    plain = diagnosis_figures(found.diagnosis, found.trials)
    assert "evidence heading_offset" not in plain
    chosen = found.diagnosis.effects
    of_another = tuple(replace(c, confounded_with=("a third",)) for c in found.diagnosis.ranking)
    same = diagnosis_figures(replace(found.diagnosis, ranking=of_another), found.trials)
    assert set(same) == set(plain)
    tied = tuple(replace(c, confounded_with=chosen) for c in found.diagnosis.ranking)
    torn = diagnosis_figures(replace(found.diagnosis, ranking=tied), found.trials)
    assert set(torn) - set(plain) == {"evidence heading_offset"}
    (other,) = found.diagnosis.alternatives
    later = replace(other, effects=("steady_current", "heading_offset"))
    assert rivals(replace(found.diagnosis, alternatives=(other, later))) == [later]
    curve = next(m for m in torn["evidence heading_offset"].panels[0].marks if isinstance(m, Line))
    assert curve.label == "what heading_offset supplies"
    assert np.abs(curve.y).max() > 0.0


def test_nothing_to_improve_writes_no_vessel(found, tmp_path, capsys):
    whole = replace(
        found.diagnosis, verdict=Verdict.ADEQUATE, effects=(), base_changed=False,
        ladder=found.diagnosis.ladder[:2],
    )  # fmt: skip
    out: DiagnosisResult = replace(found, diagnosis=whole)
    save_diagnosis(out, out=tmp_path / "better.toml")
    show_diagnosis(out, None, tmp_path / "better.toml", None)
    assert not (tmp_path / "better.toml").exists()
    assert "holds as it is" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_two_recordings_have_a_current_each_and_the_vessel_holds_that_of_the_first(
    folder, trial, tmp_path, monkeypatch
):
    days = {
        "a.tlog": [replace(sailed(80.0, (0.0, 0.3), 1), name="a")],
        "b.tlog": [replace(sailed(100.0, (-0.2, 0.0), 2), name="b")],
    }
    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda log, *_: days[log])
    both = diagnose_logs(list(days), folder / "boat.toml", settings=FEW)
    rung = both.to_dict()["ladder"][-1]
    assert rung["parameters"]["steady_current"]["speed"]["value"] == pytest.approx(0.3, abs=0.03)
    other = rung["parameters_of_recordings"]["b"]
    assert other["steady_current.speed"]["value"] == pytest.approx(0.2, abs=0.03)
    save_diagnosis(both, out=tmp_path / "better.toml", pictures=tmp_path)
    values = load_vessel(tmp_path / "better.toml").effects[0].values
    assert values["speed"] == rung["parameters"]["steady_current"]["speed"]["value"]
    assert (tmp_path / "evidence-steady_current.png").is_file()


def test_the_pictures_show_the_numbers_of_the_answer(found, tmp_path):
    pictures = diagnosis_figures(found.diagnosis, found.trials)
    ladder = pictures["ladder"].panels[0]
    dots = next(mark for mark in ladder.marks if isinstance(mark, Dots))
    np.testing.assert_array_equal(dots.y, [r.heldout.nrmse for r in found.diagnosis.ladder])
    assert any(isinstance(m, Level) and m.y == found.diagnosis.noise_floor for m in ladder.marks)
    evidence = pictures["evidence steady_current"].panels[0]
    points = next(mark for mark in evidence.marks if isinstance(mark, Dots))
    curve = next(mark for mark in evidence.marks if isinstance(mark, Line))
    assert np.corrcoef(points.y, curve.y)[0, 1] > 0.95
    for name, figure in pictures.items():
        save_figure(figure, tmp_path / f"{name}.png")


@pytest.mark.slow
def test_compare_refits_what_is_of_the_day(run, trial, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.offline.compare.load_trials", lambda *_: [trial])
    other = replace(WAM_V, name="other day").with_effects(found_current())
    (tmp_path / "other.toml").write_text(dump_vessel(other))
    words = ("compare", "a.tlog", "-v", folder / "boat.toml", "-v", tmp_path / "other.toml")
    status, out, _ = run(*words, "--refit", "voyage", "--json")
    assert status == 0
    plain, day = json.loads(out)["trials"]
    for half in day["refit"]:
        assert half["steady_current.speed"] == pytest.approx(0.3, abs=0.03)
    assert day["nrmse"] < 0.3 * plain["nrmse"]
    assert "estimated anew" in run(*words, "--refit", "voyage")[1]
    refused(run(*words, "--refit", "boat"), "--refit boat: expected voyage")
    short = replace(trial, usable=trial.time < 50.0)
    monkeypatch.setattr("gateway.offline.compare.load_trials", lambda *_: [short])
    status, out, _ = run(*words, "--refit", "voyage", "--json")
    assert status == 0
    for one in json.loads(out)["trials"]:
        assert "refit" not in one
        assert any("not re-estimated for this voyage" in text for text in one["notices"])
    assert "of the 4 blocks of 25 s" in " ".join(run(*words, "--refit", "voyage")[1].split())
    assert "estimated anew" not in run(*words, "--refit", "voyage")[1]


@pytest.mark.slow
@pytest.mark.parametrize("most", [pytest.param(0, id="base"), pytest.param(None, id="effects")])
def test_numbers_that_were_guessed_may_be_far_off(most, trial, tmp_path, monkeypatch):
    """The file says so itself: nobody has to think of --prior."""
    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: [trial])
    d = WAM_V.dynamics
    far = replace(WAM_V, dynamics=replace(d, X_u=2.2 * d.X_u, X_uu=2.0 * d.X_uu, N_r=0.4 * d.N_r))
    mark = '\n[provenance."dynamics.m11"]\nsays = "guessed from size: identify it"\n'
    settings = FEW if most is None else replace(FEW, most=most)
    error, notices = [], []
    for name, more, prior in (("known", "", 0.15), ("guessed", mark, None)):
        (tmp_path / name).write_text(dump_vessel(far) + more)
        answer = diagnose_logs(["voyage.tlog"], tmp_path / name, settings=settings, prior=prior)
        error.append(answer.diagnosis.ladder[-1].heldout.nrmse)
        notices.append(" ".join(answer.notices))
    assert error[1] < 0.8 * error[0]
    assert ["guessed" in says for says in notices] == [False, True]


def test_after_unknown_one_may_begin_an_effect_of_ones_own(found):
    """Like one that ships and asks for what the rest depends on."""
    answer = replace(found.diagnosis, verdict=Verdict.UNKNOWN)
    gain = Gain(1.5, 0.3, 5.0, 90.0, 0.0)
    for left in ((), *((Dependence(on, gain, ("surge",), 90.0),) for on in GROUPS)):
        told = replace(found, diagnosis=replace(answer, depends_on=left), logs=("a.tlog",))
        write, again = told.next_steps("d.json", "better.toml")[-2:]
        assert write.split()[:2] == ["shadow", "effects"]
        assert named(write.split()[2])
        assert again.split()[:3] == ["shadow", "diagnose", "a.tlog"]
        assert again.endswith("--effects own.py")


def test_the_next_commands_name_the_effects_of_ones_own(found):
    told = replace(found, effect_files=("my keel.py",))
    answer = found.diagnosis
    first = replace(answer.ranking[0], confounded_with=("heading_offset",))
    torn = replace(answer, verdict=Verdict.CONFOUNDED, ranking=(first, *answer.ranking[1:]))
    refit = replace(answer, verdict=Verdict.ADEQUATE, effects=(), base_changed=True,
                    ladder=answer.ladder[:2])  # fmt: skip
    lines = [
        line
        for one in (answer, torn, refit)
        for line in replace(told, diagnosis=one).next_steps("d.json", None)
    ]
    assert {line.split()[1] for line in lines} >= {"plan", "add", "compare", "identify"}
    assert all("--effects 'my keel.py'" in line for line in lines)
    assert not any("--effects" in line for line in found.next_steps("d.json", None))


def test_a_file_that_may_hold_is_not_sent_to_be_fitted(found):
    """ "next: identify" spoiled an exact file: m33 6.7 where 5.2 was true."""
    bare = replace(found.diagnosis, verdict=Verdict.ADEQUATE, effects=(), base_changed=True,
                   ladder=found.diagnosis.ladder[:2])  # fmt: skip
    error = bare.ladder[0].heldout.nrmse
    for floor, holds in ((0.6 * error, True), (0.4 * error, False)):
        told = replace(found, diagnosis=replace(bare, noise_floor=floor))
        lines = told.next_steps("d.json", None)
        assert any(line.startswith("shadow identify") for line in lines) is not holds
        assert told.improves is not holds


@pytest.mark.parametrize(
    ("verdict", "share", "time", "told"),
    [
        (Verdict.ADEQUATE, 0.41, 0.03, True),
        (Verdict.ADEQUATE, 0.41, 0.15, False),  # as in exact files
        (Verdict.ADEQUATE, 0.1, 0.01, False),  # one moment
        (Verdict.UNKNOWN, 0.41, 0.03, False),
    ],
)
def test_an_error_in_little_of_the_time_is_told_of_a_model_that_is_right(
    found, monkeypatch, verdict, share, time, told
):
    """A motor that is dead astern: "adequate" here, 42 % of the error in 3 % by compare."""
    one = SimpleNamespace(share=share, time_share=time, sentence="hardest reverse 25 to 50 %: …")
    answer = [SimpleNamespace(worst=lambda: (one,))]
    monkeypatch.setattr("gateway.offline.concentrated.compare", lambda *_: answer)
    monkeypatch.setattr(
        "gateway.offline.concentrated.Model", SimpleNamespace(of=lambda vessel: None)
    )
    said = concentrated_error(replace(found.diagnosis, verdict=verdict), found.trials)
    assert bool(said) is told
    if told:
        assert said == [
            "voyage: what is left is not spread as noise is: hardest reverse 25 to 50 %: …"
        ]


def test_the_next_commands_read_the_recordings_as_they_were_read(found):
    options = replace(DIAGNOSIS_TRIALS, mapping=Path("my map.toml"), system=3, anyway=True)
    told = replace(found, flags=options.flags)
    lines = told.next_steps(None, None)
    read = [line for line in lines if line.startswith(("shadow diagnose", "shadow compare"))]
    assert len(read) > 1
    assert all(" --mapping 'my map.toml' --system 3 --anyway" in line for line in read)
    assert not any("--mapping" in line for line in lines if line not in read)
    assert DIAGNOSIS_TRIALS.flags == ""


def test_a_curve_is_added_from_an_answer_that_was_kept(found):
    """Also where no effect was found beside it."""
    alone = replace(found.diagnosis, verdict=Verdict.UNKNOWN, ladder=found.diagnosis.ladder[:2],
                    effects=(), curve=found.diagnosis.ladder[-1])  # fmt: skip
    told = replace(found, diagnosis=alone)
    lines = told.next_steps(None, None)
    kept = next(i for i, line in enumerate(lines) if line.endswith("--save diagnosis.json"))
    used = next(i for i, line in enumerate(lines) if "--from diagnosis.json" in line)
    assert kept < used
    assert not any("--save" in line for line in told.next_steps("d.json", None))


@pytest.mark.parametrize("beside", [False, True])
def test_a_curve_comes_before_what_helps_but_not_enough(found, beside, capsys):
    """`add cubic_drag` stood first, and the curve that did far better third, without a compare."""
    answer, last = found.diagnosis, found.diagnosis.ladder[-1]
    table = named("learned")
    learned = AddedEffect(table, {p.name: p.start for p in table.parameters})
    effects = (*answer.effects, "learned") if beside else ("learned",)
    vessel = replace(last.vessel, effects=(*(last.vessel.effects if beside else ()), learned))
    curve = replace(last, effects=effects, vessel=vessel)
    told = replace(found, diagnosis=replace(answer, verdict=Verdict.UNKNOWN, curve=curve))
    added, compared, *rest = told.next_steps("d.json", None)
    assert added.startswith(f"shadow add {' '.join(effects)} --vessel ")
    file = added.split("--out ")[1]
    assert file.endswith("-curve.toml")
    assert compared.startswith("shadow compare ANOTHER_LOG ")
    assert f"--vessel {file}" in compared
    assert not any(line.startswith("shadow add") for line in rest)
    assert told.next_steps("d.json", "mine.toml")[0].split("--vessel ")[2].startswith("mine.toml")
    assert told.diagnosis.curve_stands_alone is not beside
    show_diagnosis(told, None, None, None)
    assert ("what was found" in squeezed(capsys)) is beside


def test_manoeuvres_come_with_the_diagnosis_that_uses_them(found):
    first = replace(found.diagnosis.ranking[0], confounded_with=("heading_offset",))
    torn = replace(found.diagnosis, verdict=Verdict.CONFOUNDED,
                   ranking=(first, *found.diagnosis.ranking[1:]))  # fmt: skip
    lines = replace(found, diagnosis=torn).next_steps("d.json", None)
    assert lines[0].startswith("shadow add")
    plans = [i for i, line in enumerate(lines) if line.startswith("shadow plan")]
    assert plans
    assert " THE_NEW_LOG --vessel" in lines[plans[-1] + 1]
    assert not any("THE_NEW_LOG" in line for line in found.next_steps("d.json", None))


def test_no_effect_is_begun_where_sensors_contradict_one_another(found):
    trials = tuple(replace(t, contradictions=("a lag",)) for t in found.trials)
    answer = replace(found.diagnosis, verdict=Verdict.UNKNOWN)
    assert any("--write" in line for line in replace(found, diagnosis=answer).next_steps("d", None))
    odd = replace(found, diagnosis=answer, trials=trials, logs=("a log.tlog",), flags=" --anyway")
    assert odd.next_steps("d", None) == ["shadow info 'a log.tlog' --anyway"]
    curve = replace(odd, diagnosis=replace(answer, curve=found.diagnosis.ladder[-1]))
    info, kept, added = curve.next_steps(None, None)
    assert info == "shadow info 'a log.tlog' --anyway"
    assert kept.endswith("--save diagnosis.json")
    last = found.diagnosis.ladder[-1].effects[-1]
    assert added.startswith(f"shadow add {last} --vessel ")
    assert "--from diagnosis.json" in added


def test_base_numbers_that_went_as_far_as_they_may_are_told(found, capsys):
    *before, last = found.diagnosis.ladder
    assert found.at_limit == []
    first = next(e for e in last.base_parameters if e.name in BASE)
    far = replace(first, before=10.0, value=10.0 * (1.0 + 3.0 * found.diagnosis.prior))
    ladder = (*before, replace(last, base_parameters=(far,)))
    off = replace(found, diagnosis=replace(found.diagnosis, ladder=ladder))
    assert off.at_limit == [first.name]
    show_diagnosis(off, None, None, None)
    said = " ".join(capsys.readouterr().out.split())
    assert f"{first.name}: as far from the file as is allowed (45 %)" in said
    assert "add --prior 1" in said
    show_diagnosis(replace(off, diagnosis=replace(off.diagnosis, prior=1.0)), None, None, None)
    assert "add --prior 1" not in " ".join(capsys.readouterr().out.split())


def test_an_effect_found_only_beside_another_is_told(found, capsys):
    assert found.found_beside == []
    without = replace(found, diagnosis=replace(found.diagnosis, ranking=()))
    show_diagnosis(without, None, None, None)
    assert "steady_current: it took the place of another" in squeezed(capsys)
    two = replace(without.diagnosis, effects=("steady_current", "heading_offset"), ranking=())
    show_diagnosis(replace(found, diagnosis=two), None, None, None)
    assert "heading_offset: found beside what else was found" in squeezed(capsys)


def squeezed(capsys) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_where_nothing_is_missing_no_probability_of_an_effect_is_told(found, capsys):
    show_diagnosis(found, None, None, None)
    said = squeezed(capsys)
    assert "probability" in said
    assert "the base alone" in said
    nothing = replace(found.diagnosis, verdict=Verdict.ADEQUATE, effects=())
    show_diagnosis(replace(found, diagnosis=nothing), None, None, None)
    said = squeezed(capsys)
    assert "probability" not in said
    assert "the base alone" not in said


def test_rivals_of_what_was_not_chosen_are_none_of_the_answer(found):
    others = [replace(c, effect=n, confounded_with=(m,)) for c, n, m in
              ((found.diagnosis.ranking[0], "hull_lift", "cg_offset"),)]  # fmt: skip
    torn = replace(found.diagnosis, verdict=Verdict.CONFOUNDED, ranking=tuple(others))
    assert replace(found, diagnosis=torn).rivals == []


@pytest.mark.parametrize(("recordings", "told"), [(1, False), (2, True)])
def test_one_moment_for_several_recordings_is_told(found, capsys, recordings, told):
    fault = named("thruster_fault")
    values = {"thruster": 1.0, "gain": 0.7, "time": 1.3}
    last = found.diagnosis.ladder[-1]
    vessel = last.vessel.with_effects(AddedEffect(fault, values))
    step = replace(last, effects=("thruster_fault",), vessel=vessel, parameters={})
    d = replace(found.diagnosis, effects=("thruster_fault",),
                ladder=(*found.diagnosis.ladder[:-1], step))  # fmt: skip
    show_diagnosis(replace(found, diagnosis=d, trials=found.trials * recordings), None, None, None)
    assert ("its moment is one for all recordings" in squeezed(capsys)) is told


@pytest.mark.slow
def test_the_demo_tells_the_story_to_its_end(run, tmp_path):
    status, out, _ = run("demo", "--out", tmp_path)
    assert status == 0
    last = out.strip().splitlines()[-1].split()
    before, after = float(last[2]), float(last[4])
    assert after < 0.5 * before
    assert (tmp_path / "demo_boat-better.toml").is_file()
    assert list(Path(tmp_path).glob("*.mcap"))
    assert (tmp_path / "diagnosis" / "ladder.png").is_file()
