"""diagnose, add, compare --refit: what is said, what is kept, and one line for what is wrong."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway import cli
from gateway.figures.diagnosis import diagnosis_figures, rivals
from gateway.figures.figure_data import Dots, Level, Line
from gateway.figures.matplotlib_draw import save_figure
from gateway.offline.diagnose import DiagnosisResult, diagnose_logs, save_diagnosis
from gateway.user_effects import load_effects
from gateway.vessel_file import dump_vessel, load_vessel, read_vessel_file
from sim.diagnosis.answer import Verdict
from sim.diagnosis.diagnose import DiagnoseSettings
from sim.diagnosis.force_terms import SAYS
from sim.diagnosis.heldout import Gain
from sim.diagnosis.residual_terms import Dependence
from sim.effects.catalogue import EFFECTS, named
from sim.vessel import AddedEffect
from tests.sim.voyages import WAM_V, trial_of, voyage

NOISE = np.array([0.02, 0.02, 0.003, 0.01, 0.01, 0.003, 0.03, 0.03, 0.01])
FEW = DiagnoseSettings(effects=tuple(map(named, ("steady_current", "heading_offset"))))
KEEL = """
from sim.effects.effect import Effect, Parameter, Scope
from sim.state import Wrench


def force(flow, p):
    return Wrench(0.0, 0.0, -p.k * flow.u * flow.r)


EFFECT = Effect(
    name="keel", scope=Scope.BOAT, force=force, looks_like="turns too fast at speed",
    parameters=(Parameter("k", unit="N s²", lower=0.0, upper=500.0, start=10.0),),
)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("diagnosed")
    (path / "boat.toml").write_text(dump_vessel(WAM_V))
    return path


def sailed(seconds, current, seed):
    """A voyage in a current towards (north, east), by physics of its own."""
    *motion, drive = voyage(seconds, 0.1, seed=seed, current=current)
    rng = np.random.default_rng(seed)
    noisy = [m + rng.normal(size=m.shape) * NOISE[3 * i : 3 * i + 3] for i, m in enumerate(motion)]
    return trial_of(*noisy, drive, 0.1, np.diag(NOISE**2))


@pytest.fixture(scope="module")
def trial():
    """Half a knot of current to the east."""
    return sailed(150.0, (0.0, 0.3), 1)


@pytest.fixture(scope="module")
def found(folder, trial):
    """A real diagnosis, of two effects only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gateway.offline.trials.load_trials", lambda *_: [trial])
        return diagnose_logs(["voyage.tlog"], folder / "boat.toml", settings=FEW)


@pytest.fixture(scope="module")
def saved(found, folder):
    save_diagnosis(found, save=folder / "diagnosis.json")
    return folder / "diagnosis.json"


@pytest.fixture
def shadow(monkeypatch, capfd):
    """The command line -> status, standard output, standard error."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["shadow", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, *capfd.readouterr()

    return run


@pytest.fixture
def ready(found, monkeypatch):
    """`shadow diagnose` without the minute of work."""
    asked = {}

    def instead(*given, **options):
        asked.update(options, given=given)
        return found

    monkeypatch.setattr("gateway.offline.diagnose.diagnose_logs", instead)
    return asked


def refused(done, *expected):
    status, out, err = done
    assert (status, out) == (2, "")
    assert err.count("\n") == 1, err
    for part in expected:
        assert part in err, err


def test_the_json_is_whole_and_names_where_it_comes_from(found):
    told = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert told["verdict"] == "explained"
    assert told["effects"] == ["steady_current"]
    speed = told["ladder"][-1]["parameters"]["steady_current"]["speed"]
    assert speed["ci95"][0] < 0.3 < speed["ci95"][1]
    assert told["recordings"] == [{"name": "voyage", "date": "1970-01-01", "seconds": 150.0}]
    assert told["vessel"] == "plain"


def test_the_verdict_comes_first_and_the_next_command_last(shadow, ready, folder):
    status, out, _ = shadow("diagnose", "voyage.tlog", "--vessel", folder / "boat.toml")
    assert status == 0
    assert out.startswith("explained: ")
    for part in ("95 % interval", "noise alone", "steady_current.speed", "--refit voyage"):
        assert part in out
    assert out.index("as given") < out.index("base re-fitted") < out.index("+ steady_current")
    assert "shadow add steady_current --vessel" in out.splitlines()[-2]
    assert ready["improve"] is True


def test_only_json_is_printed_where_it_is_asked_for(shadow, ready, folder):
    status, out, _ = shadow("diagnose", "a.tlog", "-v", folder / "boat.toml", "--json",
                            "--no-improve", "--prior", "0.3")  # fmt: skip
    assert status == 0
    assert json.loads(out)["verdict"] == "explained"
    assert ready["improve"] is False
    assert ready["prior"] == 0.3


def test_what_was_asked_for_is_written(shadow, ready, folder, tmp_path):
    status, out, _ = shadow(
        "diagnose", "a.tlog", "-v", folder / "boat.toml", "--save", tmp_path / "d.json",
        "--out", tmp_path / "better.toml", "--pictures", tmp_path / "pictures",
    )  # fmt: skip
    assert status == 0
    assert {p.name for p in (tmp_path / "pictures").iterdir()} == {
        "ladder.png", "ranking.png", "evidence-steady_current.png",
    }  # fmt: skip
    assert load_vessel(tmp_path / "better.toml").effects[0].effect.name == "steady_current"
    assert "shadow add" not in out.split("next:")[1]


def test_what_is_added_is_the_vessel_of_the_ladder_with_its_provenance(
    shadow, found, saved, folder, tmp_path
):
    better = tmp_path / "better.toml"
    status, out, _ = shadow("add", "steady_current", "-v", folder / "boat.toml", "--from", saved,
                            "--out", better)  # fmt: skip
    assert status == 0
    assert "--refit voyage" in out
    vessel, best = load_vessel(better), found.diagnosis.vessel
    assert vars(vessel.dynamics) == pytest.approx(vars(best.dynamics))
    assert vessel.effects[0].values == pytest.approx(best.effects[0].values)
    origin = read_vessel_file(better).provenance
    assert set(origin) >= {"dynamics.m11", "steady_current.speed", "steady_current.direction"}
    speed = origin["steady_current.speed"]
    assert (speed.recording, speed.date) == ("voyage", "1970-01-01")
    assert speed.version
    assert speed.ci95 is not None
    assert speed.ci95[0] < vessel.effects[0].values["speed"] < speed.ci95[1]


def test_what_was_ranked_but_not_chosen_is_added_with_numbers_of_its_own(
    shadow, saved, found, folder, tmp_path
):
    (rival,) = found.diagnosis.alternatives
    assert rival.effects == ("heading_offset",)
    better = tmp_path / "better.toml"
    status, _, _ = shadow("add", "heading_offset", "-v", folder / "boat.toml", "--from", saved,
                          "--out", better)  # fmt: skip
    assert status == 0
    vessel = load_vessel(better)
    assert vars(vessel.dynamics) == pytest.approx(vars(rival.vessel.dynamics))
    assert vessel.effects[0].values == pytest.approx(rival.vessel.effects[0].values)
    assert read_vessel_file(better).provenance["heading_offset.angle"].recording == "voyage"


WRONG = {
    "an effect that there is not": (["tide"], {}, "no effect named 'tide'", "shadow effects"),
    "one that was not looked for": (
        ["cubic_drag"], {}, "no numbers of cubic_drag", "shadow identify",
        "`steady_current` or `heading_offset`",
    ),
    "too many": (["steady_current", "cubic_drag"], {}, "steady_current with cubic_drag"),
    "two that were ranked": (["steady_current", "heading_offset"], {}, "no numbers of"),
    "another vessel": (["steady_current"], {"name": "other"}, "it is about plain", "is other"),
    "one that has it": (
        ["steady_current"], {"effects": FEW.effects[:1]}, "has steady_current already",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_what_cannot_be_added_is_one_line_and_writes_nothing(shadow, saved, tmp_path, case):
    names, change, *expected = WRONG[case]
    vessel = replace(WAM_V, name=change.get("name", WAM_V.name))
    if "effects" in change:
        vessel = vessel.with_effects(found_current())
    (tmp_path / "boat.toml").write_text(dump_vessel(vessel))
    done = shadow("add", *names, "-v", tmp_path / "boat.toml", "--from", saved,
                  "--out", tmp_path / "better.toml")  # fmt: skip
    refused(done, *expected)
    assert not (tmp_path / "better.toml").exists()


def found_current():
    return AddedEffect(FEW.effects[0], {"speed": 0.1, "direction": 0.0})


@pytest.mark.parametrize(
    ("text", "expected"),
    [("not JSON", "not JSON"), ("{}", "missing key"), ("[1]", "expected"), (None, "cannot read")],
)
def test_a_file_that_is_no_diagnosis_is_one_line(shadow, folder, tmp_path, text, expected):
    file = tmp_path / "d.json"
    if text is not None:
        file.write_text(text)
    done = shadow("add", "steady_current", "-v", folder / "boat.toml", "--from", file,
                  "--out", tmp_path / "better.toml")  # fmt: skip
    refused(done, str(file), expected)


def test_long_work_is_not_begun_for_a_folder_that_is_not_there(shadow, ready, folder, tmp_path):
    done = shadow("diagnose", "a.tlog", "-v", folder / "boat.toml", "--save",
                  tmp_path / "no" / "d.json")  # fmt: skip
    refused(done, "no such folder")
    assert ready == {}
    refused(shadow("diagnose", "a.tlog", "-v", folder / "boat.toml", "--prior", "0"), "--prior 0")


def test_the_file_of_a_users_effect_is_found_from_the_new_vessel_too(shadow, saved, tmp_path):
    (tmp_path / "keel.py").write_text(KEEL)
    (tmp_path / "out").mkdir()
    own = '[[effects]]\ntype = "keel"\nk = 12.0\nfile = "keel.py"\n'
    (tmp_path / "boat.toml").write_text(dump_vessel(WAM_V) + own)
    better = tmp_path / "out" / "better.toml"
    status, _, _ = shadow("add", "steady_current", "-v", tmp_path / "boat.toml", "--from", saved,
                          "--out", better)  # fmt: skip
    assert status == 0
    assert [a.effect.name for a in load_vessel(better).effects] == ["keel", "steady_current"]


def test_a_users_effect_that_was_found_is_named_with_its_file(shadow, saved, folder, tmp_path):
    (tmp_path / "keel.py").write_text(KEEL)
    told = json.loads(saved.read_text())
    told["ladder"][-1] |= {
        "effects": ["keel"], "parameters": {"keel": {"k": {"value": 9.0, "ci95": [8.0, 10.0]}}}
    }  # fmt: skip
    (tmp_path / "d.json").write_text(json.dumps(told))
    words = ("add", "keel", "-v", folder / "boat.toml", "--from", tmp_path / "d.json")
    refused(shadow(*words, "--out", tmp_path / "better.toml"), "'keel'", "--effects FILE")
    status, _, _ = shadow(*words, "--out", tmp_path / "better.toml", "--effects",
                          tmp_path / "keel.py")  # fmt: skip
    assert status == 0
    assert load_vessel(tmp_path / "better.toml").effects[0].values == {"k": 9.0}


def test_look_alikes_are_told_with_what_separates_them(found, capsys):
    from gateway.terminal.diagnosis import show_diagnosis

    tied = tuple(
        replace(c, confounded_with=tuple({"steady_current", "heading_offset"} - {c.effect}))
        for c in found.diagnosis.ranking
    )
    torn = replace(found.diagnosis, verdict=Verdict.CONFOUNDED, ranking=tied)
    show_diagnosis(replace(found, diagnosis=torn), None, None, None)
    out = capsys.readouterr().out
    assert "steady_current or heading_offset? full circles" in out
    assert "--excitation circles" in out


def test_a_rival_has_its_evidence_beside_that_of_what_was_chosen(found):
    plain = diagnosis_figures(found.diagnosis, found.trials)
    assert "evidence heading_offset" not in plain
    tied = tuple(replace(c, confounded_with=("the other",)) for c in found.diagnosis.ranking)
    torn = diagnosis_figures(replace(found.diagnosis, ranking=tied), found.trials)
    assert set(torn) - set(plain) == {"evidence heading_offset"}
    (other,) = found.diagnosis.alternatives
    later = replace(other, effects=("steady_current", "heading_offset"))
    assert rivals(replace(found.diagnosis, alternatives=(other, later))) == [later]
    curve = next(m for m in torn["evidence heading_offset"].panels[0].marks if isinstance(m, Line))
    assert curve.label == "what heading_offset supplies"
    assert np.abs(curve.y).max() > 0.0


def test_nothing_to_improve_writes_no_vessel(found, tmp_path, capsys):
    from gateway.terminal.diagnosis import show_diagnosis

    whole = replace(
        found.diagnosis, verdict=Verdict.ADEQUATE, effects=(), base_changed=False,
        ladder=found.diagnosis.ladder[:2],
    )  # fmt: skip
    out: DiagnosisResult = replace(found, diagnosis=whole)
    save_diagnosis(out, out=tmp_path / "better.toml")
    show_diagnosis(out, None, tmp_path / "better.toml", None)
    assert not (tmp_path / "better.toml").exists()
    assert "holds as it is" in " ".join(capsys.readouterr().out.split())


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
    assert any(isinstance(m, Level) and m.y == found.diagnosis.floor for m in ladder.marks)
    evidence = pictures["evidence steady_current"].panels[0]
    points = next(mark for mark in evidence.marks if isinstance(mark, Dots))
    curve = next(mark for mark in evidence.marks if isinstance(mark, Line))
    assert np.corrcoef(points.y, curve.y)[0, 1] > 0.95
    for name, figure in pictures.items():
        save_figure(figure, tmp_path / f"{name}.png")


def test_compare_refits_what_is_of_the_day(shadow, trial, folder, tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.offline.compare.load_trials", lambda *_: [trial])
    other = replace(WAM_V, name="other day").with_effects(found_current())
    (tmp_path / "other.toml").write_text(dump_vessel(other))
    words = ("compare", "a.tlog", "-v", folder / "boat.toml", "-v", tmp_path / "other.toml")
    status, out, _ = shadow(*words, "--refit", "voyage", "--json")
    assert status == 0
    plain, day = json.loads(out)["trials"]
    for half in day["refit"]:
        assert half["steady_current.speed"] == pytest.approx(0.3, abs=0.03)
    assert day["nrmse"] < 0.3 * plain["nrmse"]
    assert "estimated anew" in shadow(*words, "--refit", "voyage")[1]
    refused(shadow(*words, "--refit", "boat"), "--refit boat: expected voyage")
    short = replace(trial, usable=trial.time < 50.0)
    monkeypatch.setattr("gateway.offline.compare.load_trials", lambda *_: [short])
    refused(shadow(*words, "--refit", "voyage"), "--refit needs 4 blocks of 25 s")


def test_an_effect_draws_itself(shadow, tmp_path):
    picture = tmp_path / "lag.svg"
    status, out, _ = shadow("effects", "thruster_lag", "--picture", picture)
    assert status == 0
    assert picture.is_file()
    assert any(0x2801 <= ord(letter) <= 0x28FF for letter in out)
    assert "surge u" in out
    refused(shadow("effects", "--picture", picture), "of which effect?")


def test_numbers_that_were_guessed_may_be_far_off(trial, tmp_path, monkeypatch):
    """The file says so itself: nobody has to think of --prior."""
    monkeypatch.setattr("gateway.offline.trials.load_trials", lambda *_: [trial])
    d = WAM_V.dynamics
    far = replace(WAM_V, dynamics=replace(d, X_u=2.2 * d.X_u, X_uu=2.0 * d.X_uu, N_r=0.4 * d.N_r))
    mark = '\n[provenance."dynamics.m11"]\nsays = "guessed from size: identify it"\n'
    error, notices = [], []
    for name, text in (("known", dump_vessel(far)), ("guessed", dump_vessel(far) + mark)):
        (tmp_path / name).write_text(text)
        answer = diagnose_logs(["voyage.tlog"], tmp_path / name, settings=FEW)
        error.append(answer.diagnosis.ladder[-1].heldout.nrmse)
        notices.append(" ".join(answer.notices))
    assert error[1] < 0.8 * error[0]
    assert ["guessed" in says for says in notices] == [False, True]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_any_effect_begins_one_of_your_own(effect, shadow, tmp_path):
    file = tmp_path / "own.py"
    status, out, _ = shadow("effects", effect.name, "--write", file)
    assert status == 0
    assert "--effects" in out
    (own,) = load_effects(file)
    assert (own.name, own.scope, list(own.laws)) == ("own", effect.scope, list(effect.laws))
    assert (own.parameters, own.needs) == (effect.parameters, effect.needs)


def test_an_effect_of_your_own_is_never_written_over(shadow, tmp_path):
    file = tmp_path / "keel.py"
    file.write_text(KEEL)
    refused(shadow("effects", "hull_lift", "--write", file), "is there already")
    assert file.read_text() == KEEL
    refused(shadow("effects", "--write", file), "like which effect?")
    refused(shadow("effects", "hull_lift", "--write", tmp_path / "cg_offset.py"), "another name")
    refused(shadow("effects", "hull_lift", "--write", tmp_path / "my keel.py"), "keel.py")


def test_after_unknown_one_may_begin_an_effect_of_ones_own(found):
    """Like one that ships and asks for what the rest depends on."""
    answer = replace(found.diagnosis, verdict=Verdict.UNKNOWN)
    gain = Gain(1.5, 0.3, 5.0, 90.0, 0.0)
    for left in ((), *((Dependence(on, gain, ("surge",)),) for on in SAYS)):
        told = replace(found, diagnosis=replace(answer, depends_on=left), logs=("a.tlog",))
        write, again = told.next_steps("d.json", "better.toml")[-2:]
        assert write.split()[:2] == ["shadow", "effects"]
        assert named(write.split()[2])
        assert again.split()[:3] == ["shadow", "diagnose", "a.tlog"]
        assert again.endswith("--effects own.py")


@pytest.mark.slow
def test_the_demo_tells_the_story_to_its_end(shadow, tmp_path):
    status, out, _ = shadow("demo", "--out", tmp_path)
    assert status == 0
    last = out.strip().splitlines()[-1].split()
    before, after = float(last[2]), float(last[4])
    assert after < 0.5 * before
    assert (tmp_path / "demo_boat-better.toml").is_file()
    assert list(Path(tmp_path).glob("*.mcap"))
    assert (tmp_path / "diagnosis" / "ladder.png").is_file()
