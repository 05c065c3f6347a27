"""`shadow add`: the vessel of a diagnosis, and one line for what cannot be added."""

import json
from dataclasses import replace

import pytest

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
    assert (speed.recording, speed.date) == ("voyage", "1970-01-01")
    assert speed.version
    assert speed.ci95 is not None
    assert speed.ci95[0] < vessel.effects[0].values["speed"] < speed.ci95[1]


def test_what_was_ranked_but_not_chosen_is_added_with_numbers_of_its_own(
    run, saved, found, folder, tmp_path
):
    (rival,) = found.diagnosis.alternatives
    assert rival.effects == ("heading_offset",)
    better = tmp_path / "better.toml"
    status, _, _ = run("add", "heading_offset", "-v", folder / "boat.toml", "--from", saved,
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


def test_the_file_of_a_users_effect_is_found_from_the_new_vessel_too(run, saved, tmp_path):
    (tmp_path / "keel.py").write_text(KEEL)
    (tmp_path / "out").mkdir()
    own = '[[effects]]\ntype = "keel"\nk = 12.0\nfile = "keel.py"\n'
    (tmp_path / "boat.toml").write_text(dump_vessel(WAM_V) + own)
    better = tmp_path / "out" / "better.toml"
    status, _, _ = run("add", "steady_current", "-v", tmp_path / "boat.toml", "--from", saved,
                          "--out", better)  # fmt: skip
    assert status == 0
    assert [a.effect.name for a in load_vessel(better).effects] == ["keel", "steady_current"]


def test_a_users_effect_that_was_found_is_named_with_its_file(run, saved, folder, tmp_path):
    (tmp_path / "keel.py").write_text(KEEL)
    told = json.loads(saved.read_text())
    told["ladder"][-1] |= {
        "effects": ["keel"], "parameters": {"keel": {"k": {"value": 9.0, "ci95": [8.0, 10.0]}}}
    }  # fmt: skip
    (tmp_path / "d.json").write_text(json.dumps(told))
    words = ("add", "keel", "-v", folder / "boat.toml", "--from", tmp_path / "d.json")
    refused(run(*words, "--out", tmp_path / "better.toml"), "'keel'", "--effects FILE")
    status, _, _ = run(*words, "--out", tmp_path / "better.toml", "--effects",
                          tmp_path / "keel.py")  # fmt: skip
    assert status == 0
    assert load_vessel(tmp_path / "better.toml").effects[0].values == {"k": 9.0}
