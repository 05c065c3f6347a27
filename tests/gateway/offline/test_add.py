"""`shadow add`: the vessel of a diagnosis, and one line for what cannot be added."""

import json
from dataclasses import replace

import pytest

from gateway.errors import BadInput
from gateway.offline.add import add_effects
from gateway.user_effects import trust
from gateway.vessel_file import dump_vessel, load_vessel, read_vessel_file
from tests.gateway.offline.diagnosis import FEW, KEEL, found_current, refused
from tests.sim.voyages import WAM_V


def test_what_is_added_is_the_vessel_of_the_ladder_with_its_provenance(
    run, found, saved, folder, tmp_path
):
    better = tmp_path / "better.toml"
    status, out, _ = run("add", "steady_current", "-v", folder / "boat.toml", "--from", saved,
                            "--out", better)  # fmt: skip
    assert status == 0
    assert "--refit voyage" in out
    vessel, best = load_vessel(better), found.diagnosis.vessel
    assert vars(vessel.dynamics) == pytest.approx(vars(best.dynamics))
    assert vessel.effects[0].values == pytest.approx(best.effects[0].values)
    origin = read_vessel_file(better).provenance
    assert set(origin) >= {"dynamics.m11", "steady_current.speed", "steady_current.direction"}
    speed = origin["steady_current.speed"]
    assert (speed.recording, speed.date) == ("voyage", "")
    assert speed.version
    assert speed.ci95 is not None
    assert speed.ci95[0] < vessel.effects[0].values["speed"] < speed.ci95[1]


def test_what_was_ranked_but_not_chosen_is_added_with_numbers_of_its_own(
    run, saved, found, folder, tmp_path
):
    (rival,) = found.diagnosis.alternatives
    assert rival.effects == ("heading_offset",)
    better = tmp_path / "better.toml"
    status, out, _ = run("add", "heading_offset", "-v", folder / "boat.toml", "--from", saved,
                          "--out", better, "--json")  # fmt: skip
    assert status == 0
    answer = json.loads(out)
    angle = answer["effects"]["heading_offset"]["angle"]
    assert angle["ci95"][0] < angle["value"] < angle["ci95"][1]
    first = found.diagnosis.ladder[0].heldout.nrmse
    assert answer["heldout_nrmse_before"] == pytest.approx(first)
    assert answer["heldout_nrmse_after"] == pytest.approx(rival.heldout.nrmse)
    vessel = load_vessel(better)
    assert vars(vessel.dynamics) == pytest.approx(vars(rival.vessel.dynamics))
    assert vessel.effects[0].values == pytest.approx(rival.vessel.effects[0].values)
    assert read_vessel_file(better).provenance["heading_offset.angle"].recording == "voyage"


@pytest.mark.parametrize("verdict", ["unknown", "explained"])
def test_what_only_comes_near_is_added_with_a_warning(run, saved, folder, tmp_path, verdict):
    told = json.loads(saved.read_text()) | {"verdict": verdict}
    answer = tmp_path / "answer.json"
    answer.write_text(json.dumps(told))
    status, out, _ = run("add", "steady_current", "-v", folder / "boat.toml", "--from", answer,
                            "--out", tmp_path / "better.toml")  # fmt: skip
    assert status == 0
    assert ("may do harm on another" in " ".join(out.split())) == (verdict == "unknown")


@pytest.mark.parametrize("alike", [True, False])
def test_what_all_recordings_have_alike_is_added_as_the_boats(run, saved, folder, tmp_path, alike):
    told = json.loads(saved.read_text())
    last, number = told["ladder"][-1], {"ci95": [0.0, 9.0], "unit": ""}
    last["effects"] = ["towed_load"]
    last["parameters"] = {
        "towed_load": {"drag": number | {"value": 4.0}, "x": number | {"value": -1.0}}
    }
    last |= {"alike": ["towed_load"]} if alike else {}
    (tmp_path / "d.json").write_text(json.dumps(told))
    status, out, _ = run("add", "towed_load", "-v", folder / "boat.toml", "--from",
                         tmp_path / "d.json", "--out", tmp_path / "b.toml")  # fmt: skip
    assert status == 0
    assert ("--refit voyage" in out) is not alike  # what is the boat's needs no other day
    (added,) = load_vessel(tmp_path / "b.toml").effects
    assert added.effect.is_alike is alike
    assert ('of = "boat"' in (tmp_path / "b.toml").read_text()) is alike


@pytest.mark.parametrize(
    ("share", "warned"), [(None, False), (0.6, False), (1.0, True), (1.2, True)]
)
def test_what_recordings_that_were_left_out_said_is_told(
    run, saved, folder, tmp_path, share, warned
):
    told = json.loads(saved.read_text())
    before = told["ladder"][0]["heldout_nrmse"]
    if share is not None:
        told["ladder"][-1]["left_out_nrmse"] = share * before
    (tmp_path / "d.json").write_text(json.dumps(told))
    words = ("add", "steady_current", "-v", folder / "boat.toml", "--from", tmp_path / "d.json")
    status, out, _ = run(*words, "--out", tmp_path / "b.toml")
    assert status == 0
    assert ("by a fit without it" in out) is (share is not None)
    assert ("no better than before" in " ".join(out.split())) is warned
    _, out, _ = run(*words, "--out", tmp_path / "b.toml", "--json", "--force")
    assert json.loads(out).get("left_out_nrmse") == (None if share is None else share * before)


def test_areas_that_were_fitted_go_into_the_hull_with_their_origin(run, saved, folder, tmp_path):
    told = json.loads(saved.read_text())
    numbers = told["ladder"][-1]["base_parameters"]
    numbers["area_front"] = {"value": 0.8, "ci95": [0.7, 0.9]}
    numbers["area_side"] = {"value": 1.6, "ci95": [1.4, 1.75]}
    (tmp_path / "d.json").write_text(json.dumps(told))
    words = ("add", "steady_current", "-v", folder / "boat.toml", "--out", tmp_path / "b.toml")
    assert run(*words, "--from", tmp_path / "d.json")[0] == 0
    file = read_vessel_file(tmp_path / "b.toml")
    assert file.hull.wind_area == load_vessel(tmp_path / "b.toml").hull.wind_area == (0.8, 1.6)
    origin = file.provenance["hull.wind_area"]
    assert origin.says == (
        "fitted to the measured wind, 95 % intervals 0.7 … 0.9 and 1.4 … 1.75 m²"
    )
    assert origin.recording == "voyage"
    assert not {key for key in file.provenance if "area_" in key}
    assert run(*words, "--from", saved)[0] == 0
    assert "hull.wind_area" not in read_vessel_file(tmp_path / "b.toml").provenance


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
def test_what_cannot_be_added_is_one_line_and_writes_nothing(run, saved, tmp_path, case):
    names, change, *expected = WRONG[case]
    vessel = replace(WAM_V, name=change.get("name", WAM_V.name))
    if "effects" in change:
        vessel = vessel.with_effects(found_current())
    (tmp_path / "boat.toml").write_text(dump_vessel(vessel))
    done = run("add", *names, "-v", tmp_path / "boat.toml", "--from", saved,
                  "--out", tmp_path / "better.toml")  # fmt: skip
    refused(done, *expected)
    assert not (tmp_path / "better.toml").exists()


def test_another_vessel_of_that_name_is_refused_by_its_numbers(run, saved, tmp_path):
    other = replace(WAM_V, dynamics=replace(WAM_V.dynamics, m11=2.0 * WAM_V.dynamics.m11))
    (tmp_path / "boat.toml").write_text(dump_vessel(other))
    words = ("add", "steady_current", "-v", tmp_path / "boat.toml", "--out", tmp_path / "b.toml")
    refused(
        run(*words, "--from", saved),
        f"has m11 {other.dynamics.m11:g} instead of {WAM_V.dynamics.m11:g}: give the vessel file",
    )
    assert not (tmp_path / "b.toml").exists()
    older = json.loads(saved.read_text())
    del older["vessel_numbers"]
    (tmp_path / "older.json").write_text(json.dumps(older))
    assert run(*words, "--from", tmp_path / "older.json")[0] == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [("not JSON", "not JSON"), ("{}", "missing key"), ("[1]", "expected"), (None, "cannot read")],
)
def test_a_file_that_is_no_diagnosis_is_one_line(run, folder, tmp_path, text, expected):
    file = tmp_path / "d.json"
    if text is not None:
        file.write_text(text)
    done = run("add", "steady_current", "-v", folder / "boat.toml", "--from", file,
                  "--out", tmp_path / "better.toml")  # fmt: skip
    refused(done, str(file), expected)


@pytest.mark.parametrize("place", [".", "out"])
def test_the_file_of_a_users_effect_is_named_by_the_new_vessel_in_the_same_folder(
    run, saved, tmp_path, place
):
    (tmp_path / "keel.py").write_text(f"{KEEL}# {tmp_path}\n")  # a module of its own
    (own_effect,) = trust(tmp_path / "keel.py")
    (tmp_path / "out").mkdir()
    own = '[[effects]]\ntype = "keel"\nk = 12.0\nfile = "keel.py"\n'
    (tmp_path / "boat.toml").write_text(dump_vessel(WAM_V) + own)
    better = tmp_path / place / "better.toml"
    status, _, _ = run("add", "steady_current", "-v", tmp_path / "boat.toml", "--from", saved,
                          "--out", better)  # fmt: skip
    assert status == 0
    named = [] if place == "." else [own_effect]  # a vessel file reaches its own folder alone
    assert [a.effect.name for a in load_vessel(better, named).effects] == ["keel", "steady_current"]
    assert ('file = "keel.py"' in better.read_text()) is (place == ".")


def test_a_users_effect_that_was_found_is_named_with_its_file(run, saved, folder, tmp_path):
    (tmp_path / "keel.py").write_text(f"{KEEL}# {tmp_path}\n")  # a module of its own
    told = json.loads(saved.read_text())
    told["ladder"][-1] |= {
        "effects": ["keel"], "parameters": {"keel": {"k": {"value": 9.0, "ci95": [8.0, 10.0]}}}
    }  # fmt: skip
    (tmp_path / "d.json").write_text(json.dumps(told))
    words = ("add", "keel", "-v", folder / "boat.toml", "--from", tmp_path / "d.json")
    refused(run(*words, "--out", tmp_path / "better.toml"), "'keel'", "--effects FILE")
    status, out, _ = run(*words, "--out", tmp_path / "better.toml", "--effects",
                          tmp_path / "keel.py")  # fmt: skip
    assert status == 0
    assert f" --effects {tmp_path / 'keel.py'}" in out  # the next command can be run as it stands
    with pytest.raises(BadInput, match="was not trusted as it is now"):
        load_vessel(tmp_path / "better.toml")
    trust(tmp_path / "keel.py")
    assert load_vessel(tmp_path / "better.toml").effects[0].values == {"k": 9.0}


def test_without_names_a_base_that_was_kept_is_nothing_to_add(saved, folder, tmp_path):
    diagnosis = json.loads(saved.read_text())
    diagnosis["ladder"] = [{**s, "base": "given"} for s in diagnosis["ladder"] if not s["effects"]]
    source = tmp_path / "kept.json"
    source.write_text(json.dumps(diagnosis))
    with pytest.raises(BadInput, match="it kept the base as it is: there is nothing to add"):
        add_effects([], folder / "boat.toml", source, tmp_path / "out.toml")
