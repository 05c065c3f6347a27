"""A vessel file is data: what it names runs only where its user said so."""

import json
import os
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.offline.compare import distinct_vessels
from gateway.studio.access import Folders
from gateway.studio.session import Session
from gateway.studio.tasks import effects_in
from gateway.user_effects import EffectFile, load_effects, load_trusted_effects, trust
from gateway.vessel_file import dump_vessel, load_vessel
from tests.gateway.command_line import Run, one_line
from tests.gateway.test_effect_files import FILE
from tests.sim.vessels import WAMV

RAN = "from pathlib import Path\nPath(__file__).with_name('ran').touch()\n"
PROGRAM = RAN + FILE.replace("FACTOR", "1")
ENTRY = '\n[[effects]]\ntype = "line_drag"\nk = 20.0\nfile = "line.py"\n'
REFUSAL = "was not trusted as it is now: read it, then `shadow trust"


@pytest.fixture
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stranger's vessel with a program beside it, and a user who never trusted anything."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "stranger"
    folder.mkdir()
    (folder / "line.py").write_text(f"{PROGRAM}# {folder}\n")  # a module of its own
    (folder / "boat.toml").write_text(dump_vessel(WAMV) + ENTRY)
    return folder


def test_a_program_that_a_vessel_file_names_does_not_run(stranger: Path) -> None:
    with pytest.raises(BadInput, match=REFUSAL):
        load_vessel(stranger / "boat.toml")
    with pytest.raises(BadInput, match=REFUSAL):
        distinct_vessels([stranger / "boat.toml"])
    assert not (stranger / "ran").exists()


@pytest.mark.parametrize("name", ["compare", "replay", "identify", "diagnose", "report"])
def test_no_command_runs_it(run: Run, stranger: Path, name: str) -> None:
    log = stranger.parent / "voyage.tlog"
    out = ["--out", stranger / "new"] if name in ("report", "replay") else []
    words = [name, log, "-v", stranger / "boat.toml", *out]
    log.write_bytes(b"never read")
    one_line(run(*words), 2, str(stranger / "boat.toml"), "effects[0].file", REFUSAL, "--effects")
    assert not (stranger / "ran").exists()


def test_the_studio_does_not_run_it_when_it_is_picked(stranger: Path) -> None:
    session = Session(Folders.of([], [stranger], stranger / "out"), (), None)
    try:
        with pytest.raises(BadInput, match=REFUSAL):
            session.set_vessel(stranger / "boat.toml")
        assert session.effect_files == ()
        trust(stranger / "line.py")
        session.set_vessel(stranger / "boat.toml")
        (file,) = session.effect_files
        assert [effect.name for effect in effects_in([file])] == ["line_drag"]
        (stranger / "ran").unlink()
        (stranger / "line.py").write_text(PROGRAM + "# edited while the studio is open\n")
        assert effects_in([file])[0].name == "line_drag", "as it was when it was trusted"
        with pytest.raises(BadInput, match=REFUSAL):
            session.set_vessel(stranger / "boat.toml")
        assert session.watch is not None
        session.watch._looked = 0.0
        news = session.watch.news()
        assert news is not None
        assert not news.usable
        assert not (stranger / "ran").exists()
    finally:
        session.close()


def test_a_file_that_is_trusted_runs_until_it_is_edited(run: Run, stranger: Path) -> None:
    done = run("trust", stranger / "line.py")
    assert (done.status, done.err) == (0, "")
    assert "line_drag" in done.out
    assert [a.effect.name for a in load_vessel(stranger / "boat.toml").effects] == ["line_drag"]
    (stranger / "line.py").write_text(PROGRAM + "# edited\n")
    with pytest.raises(BadInput, match=REFUSAL):
        load_vessel(stranger / "boat.toml")


def test_all_effects_of_a_vessel_are_trusted_by_its_name(run: Run, stranger: Path) -> None:
    assert run("trust", stranger / "boat.toml").status == 0
    assert load_vessel(stranger / "boat.toml").effects
    plain = stranger / "plain.toml"
    plain.write_text(dump_vessel(WAMV))
    assert "nothing to trust" in run("trust", plain).out


def test_what_is_trusted_is_told_as_json(run: Run, stranger: Path) -> None:
    plain = stranger / "plain.toml"
    plain.write_text(dump_vessel(WAMV))
    done = run("trust", stranger / "boat.toml", plain, "--json")
    assert json.loads(done.out) == {
        "trusted": [{"file": str(stranger / "line.py"), "effects": ["line_drag"]}],
        "without_effects": [str(plain)],
    }


def test_one_that_is_named_on_the_command_line_needs_no_trust(stranger: Path) -> None:
    vessel = load_vessel(stranger / "boat.toml", load_effects(stranger / "line.py"))
    assert [a.effect.name for a in vessel.effects] == ["line_drag"]
    assert EffectFile(str(stranger / "line.py")).load()
    with pytest.raises(BadInput, match=REFUSAL):
        EffectFile(str(stranger / "line.py"), named=False).load()


@pytest.mark.parametrize("way", ["above", "absolute", "link"])
def test_nothing_outside_of_the_vessels_folder_runs_even_if_trusted(
    stranger: Path, way: str
) -> None:
    other = stranger.parent / "line.py"
    other.write_text(f"{PROGRAM}# {other}\n")
    trust(other)
    (stranger.parent / "ran").unlink()
    named = {"above": "../line.py", "absolute": str(other), "link": "linked.py"}[way]
    (stranger / "linked.py").symlink_to(other)
    (stranger / "boat.toml").write_text(dump_vessel(WAMV) + ENTRY.replace("line.py", named))
    with pytest.raises(BadInput, match="is not in the folder of the vessel file"):
        load_vessel(stranger / "boat.toml")
    assert not (stranger.parent / "ran").exists()


def test_a_file_that_is_vessel_and_program_at_once_does_not_run(stranger: Path) -> None:
    both = stranger / "both.toml"
    code = PROGRAM.replace("\\", "\\\\").replace('"""', "'")
    both.write_text(f'source = """ """ #"""\n{code}"""\n' + dump_vessel(WAMV).replace(
        'source = ', '# '
    ) + ENTRY.replace("line.py", "both.toml"))  # fmt: skip
    with pytest.raises(BadInput):
        load_vessel(both)
    assert not (stranger / "ran").exists()


def test_trust_that_others_may_have_written_is_none(stranger: Path) -> None:
    trust(stranger / "line.py")
    folder = stranger.parent / "state" / "shadow-gateway" / "trusted"
    folder.chmod(0o777)
    with pytest.raises(BadInput, match=REFUSAL):
        load_trusted_effects(stranger / "line.py")
    folder.chmod(0o700)
    (entry,) = folder.iterdir()
    entry.chmod(0o666)
    with pytest.raises(BadInput, match=REFUSAL):
        load_trusted_effects(stranger / "line.py")
    entry.chmod(0o600)
    assert load_trusted_effects(stranger / "line.py")
    if os.getuid() == 0:  # only the administrator can give files away
        os.chown(entry, 12345, 12345)
        with pytest.raises(BadInput, match=REFUSAL):
            load_trusted_effects(stranger / "line.py")
