"""Files of one name in several folders, dropped or given: none hides another."""

import shutil
from html import escape
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.studio import Scope, TrialView
from gateway.studio.access import Folders
from gateway.studio.controls import LearnFrom
from gateway.studio.names import labels, recording_names
from gateway.studio.page import Address
from gateway.studio.pages import recordings, signals
from gateway.studio.session import Session
from gateway.studio.tasks import compare_task, report_task
from tests.conftest import ROOT
from tests.gateway.studio.pages import context_of, message_of, write_log

BOAT = ROOT / "configs/vessels/demo_boat.toml"


@pytest.fixture
def session(tmp_path):
    """Two folders, each with a boat.toml and a trip.tlog."""
    for name in ("north", "south"):
        (tmp_path / name).mkdir()
        shutil.copy(BOAT, tmp_path / name / "boat.toml")
        write_log(tmp_path / name, "trip.tlog")
    north, south = tmp_path / "north", tmp_path / "south"
    made = Session(Folders.of([], [north, south], tmp_path / "out"), (), north / "boat.toml")
    made.set_logs([north / "trip.tlog"])
    yield made
    made.close()


def test_a_folder_stands_behind_a_name_that_several_have(tmp_path):
    one, two, other = tmp_path / "a" / "x.tlog", tmp_path / "b" / "x.tlog", tmp_path / "y.tlog"
    assert labels([one, two, other]) == {
        f"x.tlog ({tmp_path}/a)": one, f"x.tlog ({tmp_path}/b)": two, "y.tlog": other
    }  # fmt: skip


def test_recordings_and_vessels_of_one_name_can_all_be_chosen(session):
    page = recordings.RecordingsPage(context_of(session))
    page._list()
    north, south = (str(folder / "trip.tlog") for folder in session.folders.read)
    assert set(page._logs.options.values()) == {north, south}
    assert page._logs.value == [north]
    assert [row[1].label for row in page._rows.objects] == [
        f"Report from trip.tlog ({folder}) alone" for folder in session.folders.read
    ]
    page._vessel.value = str(session.folders.read[1] / "boat.toml")
    page._logs.value = [south]
    page.guarded(page._chosen)()
    assert "working on trip.tlog" in message_of(page)
    assert [str(log) for log in session.logs] == [south]
    assert session.vessel_file == session.folders.read[1] / "boat.toml"
    plots = signals.SignalsPage(context_of(session))
    plots._list()
    assert set(plots._log.options.values()) == {north, south}


def test_recordings_are_called_by_what_tells_them_apart():
    paths = ["/a/log.tlog", "/b/log.tlog", "/b/trip.tlog", "/b/trip.BIN", "/b/alone.csv"]
    names = ("log.tlog (/a)", "log.tlog (/b)", "trip.tlog", "trip.BIN", "alone")
    assert recording_names(paths) == dict(zip(paths, names, strict=True))


@pytest.fixture
def voyages(tmp_path):
    """Two recordings of one name in two folders, of two voyages."""
    out = []
    for k in (1, 2):
        file = tmp_path / f"day{k}" / "log.tlog"
        file.parent.mkdir()
        shutil.copy(ROOT / f"recordings/voyage_{k}.tlog", file)
        out.append(str(file))
    return out


def test_two_recordings_of_one_name_are_two_in_compare_and_a_range_is_of_one(voyages):
    names = recording_names(voyages)
    given = [("as given", BOAT.read_text())]
    scope = Scope(names[voyages[1]], ((40.0, 100.0),))
    sent: list[object] = []
    found = compare_task(sent.append, voyages, given, (), None, scope)
    assert [(one.name, one.log) for one in found.trials] == [(names[log], log) for log in voyages]
    assert [one.name for one in sent if isinstance(one, TrialView)] == list(names.values())
    first, second = (one.seconds for one in found.trials)
    assert first > 250.0
    assert second == pytest.approx(60.0, abs=1.0)


@pytest.mark.slow
def test_a_report_tells_two_recordings_of_one_name_apart(voyages, tmp_path):
    file = str(tmp_path / "report.html")
    report_task(lambda _: None, voyages, [("as given", BOAT.read_text())], (), file, False)
    text = Path(file).read_text()
    assert all(escape(name) in text for name in recording_names(voyages).values())


def test_a_range_holds_for_the_recording_that_is_learnt_from_and_for_no_other_of_its_name(
    session, monkeypatch
):
    logs = [folder / "trip.tlog" for folder in session.folders.read]
    names, asked = recording_names([str(log) for log in logs]), []
    monkeypatch.setattr(session.slow, "start", lambda job, task, *given: asked.append(given[-1]))
    session.set_logs(logs)
    session.set_scope(Scope(f"{names[str(logs[1])]} #2", ((0.0, 9.0),)))
    for log in logs:
        session.learn_from = (log,)
        session.diagnose()
        session.fit()
    other, marked = asked[::2]
    assert asked[1::2] == [other, marked]
    assert marked.recording == "trip #2"
    assert not other.recording.startswith("trip #")
    session.learn_from = tuple(logs)
    with pytest.raises(BadInput, match="trip: several recordings to learn from have this name"):
        session.diagnose()


def test_what_is_learnt_from_is_known_by_its_path(session):
    session.set_logs([folder / "trip.tlog" for folder in session.folders.read])
    learn = LearnFrom(recordings.RecordingsPage(context_of(session)))
    learn.update()
    learn.part.value = [str(session.folders.read[1] / "trip.tlog")]
    assert session.learn_from == (session.folders.read[1] / "trip.tlog",)


def test_a_dropped_recording_with_the_name_of_a_given_one_gets_a_number(session):
    page = recordings.RecordingsPage(context_of(session))
    for k, content in enumerate((b"one", b"two", b"three"), 2):
        page._dropped({"trip.tlog": content})
        assert message_of(page).startswith(f"trip-{k}.tlog (trip.tlog as it was dropped: a folder")
        assert (session.folders.write / f"trip-{k}.tlog").read_bytes() == content
    page._list()
    assert len(page._logs.options) == 5
    assert not (session.folders.write / "trip.tlog").exists()


def test_the_address_tells_vessels_of_one_name_apart(session, monkeypatch):
    asked = f"boat.toml ({session.folders.read[1]})"
    monkeypatch.setattr(Address, "read", lambda self, name: asked if name == "file" else None)
    page = recordings.RecordingsPage(context_of(session))
    page._take_vessel()
    assert session.vessel_file == session.folders.read[1] / "boat.toml"
    page._name_vessel()
    assert page.address._values["file"] == asked


@pytest.mark.parametrize("name", ["航" * 90, "𩸽" * 62], ids=["three bytes", "four bytes"])
def test_a_name_that_is_too_long_for_a_file_is_told(session, name):
    """Fewer letters than 120, and more bytes than a file system takes."""
    page = recordings.RecordingsPage(context_of(session))
    page._dropped({f"{name}.tlog": b""})
    assert (
        message_of(page) == f"{name}.tlog: too long for the name of a file: give it a shorter one"
    )
    with pytest.raises(BadInput, match="shorter one"):
        session.folders.to_save(f"{'𩸽' * 70}.toml")
