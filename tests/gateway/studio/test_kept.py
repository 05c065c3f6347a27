"""Ranges, the layout, what was undone, cards and courses: what people keep and come back to."""

import shutil
import time
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document
from panel.io.state import set_curdoc

from gateway.errors import BadInput
from gateway.offline.trials import load_trials
from gateway.studio import LAYOUT_FILE, Scope
from gateway.studio.access import Folders
from gateway.studio.controls import WAY, course_of, moments
from gateway.studio.pages import recordings, signals, vessel
from gateway.studio.session import Session
from gateway.studio.tasks import compare_task
from gateway.studio.version import with_values
from gateway.studio.worker import CardReader, card_task, card_text
from tests.conftest import ROOT
from tests.gateway.studio.pages import context_of, message_of

LOG, BOAT = ROOT / "recordings/voyage_1.tlog", ROOT / "configs/vessels/demo_boat.toml"
GIVEN = [("as given", BOAT.read_text())]


@pytest.fixture
def session(tmp_path):
    shutil.copy(BOAT, tmp_path)
    made = Session(Folders.of([], [tmp_path], tmp_path / "out"), (), tmp_path / BOAT.name)
    yield made
    made.close()


@pytest.fixture(scope="module")
def compared():
    """The recording with the vessel as given."""
    (trial,) = compare_task(lambda _: None, [str(LOG)], GIVEN, ()).trials
    return trial


def test_a_range_is_kept_worked_on_and_forgotten(session):
    session.set_logs([session.folders.read[0] / LOG.name])
    session.keep_range("turn", "voyage_1", ((40.0, 70.0),))
    again = Session(session.folders, (), None)
    assert again.layout.ranges["turn"].times == ((40.0, 70.0),)
    session.set_scope(Scope("voyage_1", ((40.0, 70.0),)))
    assert session.scope.text == "of voyage_1 only 40.0–70.0 s"
    assert not session.is_current
    session.forget_range("turn")
    assert Session(session.folders, (), None).layout.ranges == {}
    with pytest.raises(BadInput, match="name"):
        session.keep_range("", "voyage_1", ((0.0, 1.0),))


def test_a_layout_that_cannot_be_read_is_said_and_never_written_over(session):
    file = session.folders.write / LAYOUT_FILE
    file.parent.mkdir(exist_ok=True)
    file.write_text('{"ranges": 3}')
    again = Session(session.folders, (), None)
    assert again.notice is not None
    assert LAYOUT_FILE in again.notice.text
    with pytest.raises(BadInput, match=LAYOUT_FILE):
        again.keep_range("turn", "voyage_1", ((0.0, 1.0),))
    assert file.read_text() == '{"ranges": 3}'


def test_a_scope_takes_time_from_its_recording_alone():
    (trial,) = load_trials(LOG)
    only = Scope(trial.name, ((40.0, 70.0),))
    kept = only.of(trial).usable
    assert trial.time[kept].min() >= 40.0
    assert trial.time[kept].max() <= 70.0
    left = replace(only, without=True).of(trial).usable
    assert not (kept & left).any()
    assert ((kept | left) == trial.usable).all()
    assert Scope("another", ((40.0, 70.0),)).of(trial) is trial


def test_what_was_compared_over_a_range_is_of_that_range(compared):
    scope = Scope("voyage_1", ((60.0, 160.0),))
    part = compare_task(lambda _: None, [str(LOG)], GIVEN, (), None, scope)
    assert part.trials[0].seconds == pytest.approx(100.0, abs=1.0)
    assert part.trials[0].vessels[0].nrmse != compared.vessels[0].nrmse
    assert part.scope == scope
    short = compare_task(lambda _: None, [str(LOG)], GIVEN, (), None,
                         Scope("voyage_1", ((60.0, 61.0),)))  # fmt: skip
    assert "only 60.0–61.0 s" in short.refused[str(LOG)]


def test_undone_steps_come_back_until_something_else_is_done(session):
    for value in (41.0, 43.0):
        session.slide(with_values(session.version, {"m11": value}), f"m11 to {value}")
    session.undo()
    session.undo()
    session.redo()
    assert session.version.change == "m11 to 41.0"
    assert vessel.history_text(session) == (
        "<p>as given → <strong>m11 to 41.0</strong> → <span class='faint'>m11 to 43.0</span></p>"
    )
    session.slide(with_values(session.version, {"X_u": -7.0}), "X_u changed")
    session.redo()
    assert session.version.change == "X_u changed"


def test_angles_are_shown_in_degrees_and_kept_in_radians(session):
    text = BOAT.read_text() + '\n[[effects]]\ntype = "heading_offset"\nangle = 0.1\n'
    tables = tomllib.loads(text)
    one = vessel.numbers_of(tables)["heading_offset.angle"]
    assert (one.unit, round(one.value, 3)) == ("°", 5.730)
    assert one.value * one.si == pytest.approx(0.1)
    assert vessel.numbers_of(tables)["m11"].unit == "kg"


def test_recordings_are_laid_over_one_another_at_a_moment_or_along_the_way(compared):
    trial = compared
    names = moments(trial)
    assert set(names) >= {
        "at “armed” (armed)",
        "at “manual” (mode)",
        "at “Throttle armed” (events)",
    }
    at = course_of(trial, "at “Throttle armed” (events)", False)
    assert at.x[0] == pytest.approx(-names["at “Throttle armed” (events)"])
    way = course_of(trial, WAY, True)
    assert (np.diff(way.x) >= 0.0).all()
    assert way.x[-1] == pytest.approx(np.hypot(np.diff(trial.north), np.diff(trial.east)).sum())
    np.testing.assert_allclose(
        way.velocity, (trial.motion - trial.vessels[0].motion)[:, 3:], equal_nan=True
    )
    assert course_of(trial, "at “docked” (mode)", False) is None


def test_a_card_says_when_where_and_how_much():
    view = card_task(lambda _: None, str(LOG))
    reader = CardReader(cards={str(LOG): view}, refused={"/no.tlog": "no.tlog is a text file"})
    text = card_text(str(LOG), LOG.name, reader)
    assert f"<strong>{view.usable_s / 60.0:.0f} min usable</strong>" in text
    assert view.usable_s == pytest.approx(300.0, abs=5.0)
    assert "<polyline" in text
    assert "is a text file" in card_text("/no.tlog", "no.tlog", reader)
    assert "usable" not in card_text("/other.tlog", "other.tlog", reader)


def read_all(reader):
    """The reader after it has read all that is wanted."""
    end = time.monotonic() + 60.0
    while (reader.update(None) or reader.worker.busy) and time.monotonic() < end:
        time.sleep(0.02)
    return reader


def test_a_recording_that_takes_the_place_of_another_has_its_own_card(tmp_path):
    file, reader = tmp_path / "trip.tlog", CardReader()
    with reader.worker:
        for content, says in ((b"no log", "is a text file"), (b"", "is empty")):
            file.write_bytes(content)
            reader.want([file])
            assert "being read" in card_text(str(file), file.name, reader)
            assert says in card_text(str(file), file.name, read_all(reader))
            reader.want([file])
            assert not reader.is_waiting(str(file)), "nothing has changed"
        reader.update(None)
        reader.want([file])
        file.write_bytes(b"no log")
        reader.want([file])  # while it is being read, or before
        assert "is a text file" in card_text(str(file), file.name, read_all(reader))


def test_a_dropped_recording_in_the_place_of_one_that_was_worked_on_is_read_afresh(session):
    page, plots = (made(context_of(session)) for made in (recordings.RecordingsPage,
                                                          signals.SignalsPage))  # fmt: skip
    file = session.add_recording("trip.tlog", b"one")
    session.set_logs([file])
    session.trials = ("of the file before",)
    plots._list()
    request = plots._request()
    session.signals.update()
    session.signals.worker.cancel()
    session.signals._reading, session.signals.refused = None, {request: "of the file before"}
    plots._list()
    assert request in session.signals.refused
    file.unlink()
    page._dropped({"trip.tlog": b"another"})
    assert session.logs == (file,)
    assert session.trials == ()
    plots._list()
    assert request not in session.signals.refused


def test_a_dropped_recording_goes_nowhere_else_and_over_nothing(session):
    file = session.add_recording("my trip.tlog", LOG.read_bytes())
    assert file.parent == session.folders.write
    assert file in session.folders.recordings()
    for name in ("my trip.tlog", "../up.tlog", "vessel.toml", ".hidden.tlog", "a/b.tlog"):
        with pytest.raises(BadInput):
            session.add_recording(name, b"")


def test_of_several_dropped_files_each_that_is_refused_is_named_and_asked_for_again(session):
    page, log = recordings.RecordingsPage(context_of(session)), LOG.read_bytes()
    page._dropped({"notes.txt": b"hello", "trip.tlog": log, "b.exe": b""})
    text = message_of(page)
    assert "'notes.txt': no recording: expected" in text
    assert "'b.exe'" in text
    assert "trip.tlog is here" in text
    assert not page._notice.good
    page._notice = None
    page._dropped({"trip.tlog": log})
    assert message_of(page) == ""  # it came before
    again = bytes(bytearray(log))
    page._dropped({"trip.tlog": again})
    assert message_of(page) == "trip.tlog is there already"
    (session.folders.write / "trip.tlog").unlink()
    page._dropped({"trip.tlog": bytes(bytearray(log))})
    assert message_of(page).startswith("trip.tlog is here")


def test_files_that_come_one_by_one_have_one_message(session, monkeypatch):
    page, log = recordings.RecordingsPage(context_of(session)), LOG.read_bytes()
    every: dict[str, bytes] = {}
    for name, content in (("a.tlog", log), ("notes.txt", b"hello"), ("b.tlog", log + b" ")):
        every = {**every, name: content}  # as the browser tells them: those before as well
        page._dropped(every)
    text = message_of(page)
    assert "'notes.txt': no recording" in text
    assert "a.tlog, b.tlog are here: work on them" in text
    page.guarded(lambda: None)()  # something else is done: that message is over
    page._dropped({**every, "c.tlog": log + b"  "})
    assert message_of(page) == "c.tlog is here: work on it, or have a report from it alone"
    later = page._notice.since + 60.0
    monkeypatch.setattr("gateway.studio.session.time.monotonic", lambda: later)
    page._dropped({**every, "d.tlog": log + b"   "})  # long after: it has faded
    assert message_of(page).startswith("d.tlog is here")


def test_a_number_that_is_refused_does_not_stay_in_its_field(session):
    page = vessel.VesselPage(context_of(session))
    page._show_vessel()
    before = page._typed["m11"].value
    page._typed["m11"].value = -5.0
    assert page._typed["m11"].value == before
    assert page._sliders["m11"].value == before
    text = message_of(page)
    assert text.startswith("vessel.toml: dynamics")
    assert "/" not in text.partition(":")[0]
    assert session.version.text == session.versions[0].text
    assert len(session.versions) == 1


def test_changes_of_a_page_are_sent_together_and_each_is_kept(session):
    page, document, held = vessel.VesselPage(context_of(session)), Document(), []
    with set_curdoc(document):
        page.caught(lambda: held.append(document.callbacks.hold_value))
    assert held == ["collect"]
    assert document.callbacks.hold_value is None
