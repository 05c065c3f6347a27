"""Effects of one's own in the studio: their files are watched, and go where a saved vessel goes."""

import shutil
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.studio import ComparisonView, tasks
from gateway.studio.access import Folders
from gateway.studio.pages import recordings, vessel
from gateway.studio.session import Session
from gateway.studio.version import with_values
from gateway.studio.worker import JobMessage
from gateway.user_effects import EffectFile, trust
from gateway.vessel_file import dump_vessel, load_vessel
from tests.gateway.studio.pages import context_of, message_of
from tests.gateway.test_effect_files import FILE
from tests.sim.vessels import WAMV

ENTRY = '\n[[effects]]\ntype = "line_drag"\nk = 20.0\n'
STAYS = "the studio goes on with it as it was"


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    """A user who has trusted nothing yet."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def law(tmp_path):
    """A trusted effect file, in a folder below that of the vessel."""
    file: Path = tmp_path / "boats" / "laws" / "line.py"
    file.parent.mkdir(parents=True)
    (tmp_path / "boats" / "boat.toml").write_text(
        f'{dump_vessel(WAMV)}{ENTRY}file = "laws/line.py"\n'
    )
    write(file, "1")
    return file


@pytest.fixture
def session(tmp_path, law):
    boats = tmp_path / "boats"
    made = Session(Folders.of([], [boats], tmp_path / "out"), (), boats / "boat.toml")
    yield made
    made.close()


def write(file: Path, factor: str, trusted: bool = True) -> None:
    file.write_text(FILE.replace("FACTOR", factor) + f"# {file}\n")  # a module of its own
    if trusted:
        trust(file)


def looked(session: Session) -> str:
    """What the session says after another look at the files."""
    session.watch._looked = session._updated = 0.0
    session._stale = False  # nothing is to be compared here
    session.update()
    return session.notice.text if session.notice and session.notice.holds else ""


def drag(session: Session) -> float:
    """What the vessel's own effect does to it at 1 m/s, as a job of now would take it [N]."""
    (added,) = tasks.vessel_of(
        session.version.text, tasks.effects_in(session.effect_files)
    ).effects  # fmt: skip
    flow = type("Flow", (), {"u": 1.0})
    values = type("Values", (), added.values)
    return float(-added.effect.force(flow, values).X)


def compared(session: Session) -> None:
    """The answer of the quick worker to what was asked last."""
    session._asked, session._asked_effects = session.logs, session.effect_files
    answer = ComparisonView(("a trial",), {}, tuple(session.vessels()))
    session._compared(JobMessage("compare", "done", answer))


def test_an_effect_file_that_is_edited_is_taken_anew_and_what_was_compared_is_not_of_now(
    session, law
):
    compared(session)
    assert session.is_current
    assert drag(session) == pytest.approx(20.0)
    assert looked(session) == ""
    write(law, "3")
    assert drag(session) == pytest.approx(20.0), "before it is said"
    assert looked(session) == "line.py was changed: read again"
    assert drag(session) == pytest.approx(60.0)
    assert not session.is_current
    assert session.trials
    compared(session)
    assert session.is_current


@pytest.mark.parametrize("what", ["removed", "broken", "not trusted"])
def test_an_effect_file_that_cannot_be_used_is_told_until_it_can_be(session, law, what):
    if what == "removed":
        law.unlink()
    else:
        write(law, "3" if what == "not trusted" else "1 +/ 2", trusted=False)
    says = {"removed": "line.py is no longer there", "broken": "line.py was changed and cannot",
            "not trusted": f"`shadow trust {law}` once"}  # fmt: skip
    assert says[what] in looked(session)
    assert session.notice.text.endswith(STAYS)
    assert not session.notice.good
    assert drag(session) == pytest.approx(20.0)
    session.notice = None  # closed by the user: not said again and again
    assert looked(session) == ""
    if what == "not trusted":
        trust(law)  # the file is the same
        assert looked(session) == "line.py was changed: read again"
        assert drag(session) == pytest.approx(60.0)
    else:
        write(law, "1")
        assert looked(session) == ""


def test_a_broken_effect_file_of_the_user_is_told_with_the_reason(law, tmp_path):
    (tmp_path / "boats" / "boat.toml").write_text(dump_vessel(WAMV) + ENTRY)
    session = Session(Folders.of([], [tmp_path / "boats"], tmp_path / "out"),
                      (), tmp_path / "boats" / "boat.toml", (EffectFile(str(law)),))  # fmt: skip
    write(law, "1 +/ 2", trusted=False)
    assert "line.py was changed and cannot be used" in looked(session)
    assert "SyntaxError" in session.notice.text
    assert drag(session) == pytest.approx(20.0)
    write(law, "2", trusted=False)  # named by its user: no trust is asked for
    assert looked(session) == "line.py was changed: read again"
    assert drag(session) == pytest.approx(40.0)


def test_where_changes_would_be_lost_an_edited_effect_waits_for_work_on_these(session, law):
    session.slide(with_values(session.version, {"m11": 900.0}), "m11 changed")
    write(law, "3")
    assert looked(session).startswith(f"line.py was changed: {STAYS}; choose the vessel again")
    assert drag(session) == pytest.approx(20.0)
    page = recordings.RecordingsPage(context_of(session))
    (session.folders.read[0] / "a.tlog").write_bytes(b"")
    page._list()
    page._logs.value = [str(session.folders.read[0] / "a.tlog")]
    for _ in range(2):  # asked first, for what was not saved
        page.guarded(page._chosen)()
    assert drag(session) == pytest.approx(60.0)


def test_a_saved_vessel_takes_its_own_effects_along_and_loads_without_more(session, law, tmp_path):
    page = vessel.VesselPage(context_of(session))
    page._show_vessel()
    page._save._name.value = "mine.toml"
    page.guarded(page._save._save)()
    saved = session.folders.write / "mine.toml"
    assert message_of(page) == (
        f"saved: {saved}, and its own effects beside it (line.py): they go where it goes"
    )
    shutil.rmtree(law.parent)
    elsewhere = shutil.copytree(session.folders.write, tmp_path / "elsewhere")
    assert load_vessel(elsewhere / "mine.toml").effects[0].effect.name == "line_drag"


def test_no_other_effect_file_is_written_over(session):
    session.save("one.toml")
    other = session.folders.write / "line.py"
    assert not (session.folders.write / "line-2.py").exists()
    session.save("two.toml")
    assert not (session.folders.write / "line-2.py").exists(), "the same content: one is enough"
    other.write_text("mine")
    saved = session.save("three.toml")
    assert other.read_text() == "mine"
    assert 'file = "line-2.py"' in saved.read_text()
    assert load_vessel(saved).effects[0].effect.name == "line_drag"


def test_a_file_that_only_its_user_named_has_to_be_trusted_where_it_is_saved(law, tmp_path):
    write(law, "7", trusted=False)
    (tmp_path / "boats" / "boat.toml").write_text(dump_vessel(WAMV) + ENTRY)
    session = Session(Folders.of([], [tmp_path / "boats"], tmp_path / "out"),
                      (), tmp_path / "boats" / "boat.toml", (EffectFile(str(law)),))  # fmt: skip
    page = vessel.VesselPage(context_of(session))
    page._save._name.value = "mine.toml"
    page.guarded(page._save._save)()
    saved = session.folders.write / "mine.toml"
    assert message_of(page).endswith(f"without --effects say `shadow trust {saved}` once")
    with pytest.raises(BadInput, match="was not trusted"):
        load_vessel(saved)
    session.set_vessel(saved)  # the user named this very program
    trust(session.folders.write / "line.py")
    assert load_vessel(saved).effects[0].effect.name == "line_drag"


def test_a_vessel_that_is_downloaded_names_its_effects_and_the_page_says_what_goes_beside_it(
    session, law, tmp_path
):
    page = vessel.VesselPage(context_of(session))
    file = tmp_path / "down" / "vessel.toml"
    file.parent.mkdir()
    file.write_text(page._file().read())
    assert message_of(page) == (f"vessel.toml names its own effects: put a copy of {law} beside it")
    with pytest.raises(BadInput, match="cannot read the effect file"):
        load_vessel(file)
    shutil.copy(law, file.parent)
    assert load_vessel(file).effects[0].effect.name == "line_drag"


def test_a_vessel_without_effects_of_its_own_is_saved_as_it_is(session):
    text = dump_vessel(WAMV) + "# a remark\n"
    plain = session.folders.read[0] / "plain.toml"
    plain.write_text(text)
    session.set_vessel(plain)
    assert session.save("plain.toml").read_text() == text
    page = vessel.VesselPage(context_of(session))
    assert page._file().read() == text
    assert message_of(page) == ""
