"""`shadow effects`: the catalogue, pictures, and effects of your own."""

from pathlib import Path

import pytest

from gateway.user_effects import load_effects
from sim.effects.catalogue import EFFECTS
from tests.gateway.command_line import Run, command, one_line, strictly
from tests.gateway.offline.diagnosis import KEEL, refused
from tests.gateway.test_effect_files import FILE


def test_effects_are_listed_and_explained(run: Run, tmp_path: Path) -> None:
    own = tmp_path / "line.py"
    own.write_text(FILE.replace("FACTOR", "1"))
    assert "steady_current" in run("effects").out
    explained = run("effects", "steady_current").out
    assert 'type = "steady_current"' in explained
    assert "direction" in explained
    assert "line_drag" in run("effects", "--effects", own).out
    one_line(run("effects", "ghost"), 2, "no effect named 'ghost': `shadow effects` lists")
    own.write_text("def (:")
    one_line(run("effects", "--effects", own), 2, str(own), "SyntaxError")


def test_a_narrow_terminal_shows_names_and_parameters_whole(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown = run("effects").out
    assert max(map(len, shown.splitlines())) <= 80
    for effect in EFFECTS:
        for word in (effect.name, *(f"{p.name} [{p.unit}]" for p in effect.parameters)):
            assert f" {word} " in shown


@pytest.mark.slow
def test_an_effect_of_ones_own_takes_part_in_every_command(
    run: Run, tmp_path: Path, boat: Path, log: Path
) -> None:
    own = tmp_path / "line.py"
    own.write_text(FILE.replace("FACTOR", "1"))
    boat.write_text(boat.read_text() + '\n[[effects]]\ntype = "line_drag"\nk = 20.0\n')
    words = command("replay", log, boat, tmp_path / "out")
    one_line(run(*words), 2, "effects[0].type = 'line_drag': ", "--effects FILE.py")
    (done,) = strictly(run(*words, "--effects", own, "--json").out)["replays"]
    assert done["missing_force_rms"]["X"] > 10.0  # a drag that the voyage did not have
    assert run("compare", log, "-v", boat, "--effects", own).status == 0


@pytest.mark.slow
@pytest.mark.usefixtures("plain_laws")
def test_an_effect_draws_itself(run, tmp_path):
    picture = tmp_path / "lag.svg"
    status, out, _ = run("effects", "thruster_lag", "--picture", picture)
    assert status == 0
    assert picture.is_file()
    assert any(0x2801 <= ord(letter) <= 0x28FF for letter in out)
    assert "surge u" in out
    refused(run("effects", "--picture", picture), "of which effect?")


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.is_curve], ids=lambda e: e.name)
def test_a_table_begins_no_effect_of_your_own(effect, run, tmp_path):
    """Whatever is in it was filled by a diagnosis; a copy would never be tried."""
    refused(run("effects", effect.name, "--write", tmp_path / "own.py"), "--from diagnosis.json")
    assert not (tmp_path / "own.py").exists()


@pytest.mark.parametrize("effect", [e for e in EFFECTS if not e.is_curve], ids=lambda e: e.name)
def test_any_effect_begins_one_of_your_own(effect, run, tmp_path):
    file = tmp_path / "own.py"
    status, out, _ = run("effects", effect.name, "--write", file)
    assert status == 0
    assert "--effects" in out
    (own,) = load_effects(file)
    assert (own.name, own.scope, list(own.laws)) == ("own", effect.scope, list(effect.laws))
    assert (own.parameters, own.needs) == (effect.parameters, effect.needs)


def test_an_effect_of_your_own_is_never_written_over(run, tmp_path):
    file = tmp_path / "keel.py"
    file.write_text(KEEL)
    refused(run("effects", "hull_lift", "--write", file), "is there already")
    assert file.read_text() == KEEL
    refused(run("effects", "--write", file), "like which effect?")
    refused(run("effects", "hull_lift", "--write", tmp_path / "cg_offset.py"), "another name")
    refused(run("effects", "hull_lift", "--write", tmp_path / "my keel.py"), "keel.py")
