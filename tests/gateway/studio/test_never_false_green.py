"""Sentences of the pages, each in a case in which it would be false."""

import math
import shutil
from dataclasses import replace

import numpy as np
import pytest

from gateway.figures import LIGHT, FigureData
from gateway.figures.diagnosis import LadderBar
from gateway.figures.words import judgement_text, nowhere_text
from gateway.monitor import Latest, MonitorOptions, VesselStatus
from gateway.studio import (
    ComparisonView,
    DiagnosisView,
    LadderView,
    TrialView,
    VesselView,
)
from gateway.studio.access import Folders
from gateway.studio.live_chart import Chart
from gateway.studio.live_history import LiveHistory, WatchedBoat
from gateway.studio.notice import GOOD_S
from gateway.studio.page import Page
from gateway.studio.pages import compare, diagnose, live, recordings, vessel
from gateway.studio.session import NOW, Session
from gateway.studio.time_marks import range_text
from gateway.studio.version import with_values
from gateway.studio.worker import JobMessage
from gateway.topics import TOPICS
from sim.comparison.compare import Judgement, Standing, judge
from tests.conftest import ROOT
from tests.gateway.studio.pages import context_of, message_of, write_log

BOAT = ROOT / "configs/vessels/demo_boat.toml"
EMPTY = FigureData("", ())


@pytest.fixture
def session(tmp_path):
    for name in ("boat.toml", "other.toml"):
        shutil.copy(BOAT, tmp_path / name)
    for name in ("one.tlog", "two.tlog"):
        write_log(tmp_path, name)
    made = Session(Folders.of([], [tmp_path], tmp_path / "out"), (), tmp_path / "boat.toml")
    made.set_logs([tmp_path / "one.tlog"])
    yield made
    made.close()


def seen(name: str, error: float, floor: float, *, label: str = "as given") -> TrialView:
    one = VesselView(label, {"u": 0.1, "v": 0.1, "r": 0.1}, error, None, Standing(error, floor), (),
                     {"velocities": EMPTY})  # fmt: skip
    axis = np.array([0.0, 1.0])
    return TrialView(name, f"{name}.tlog", 1.0, axis, axis, axis, EMPTY, EMPTY, (one,))


def came(session: Session, *trials: TrialView, refused: dict[str, str] | None = None) -> None:
    """The quick worker's answer to what the session asks now."""
    session._asked = session.logs
    answer = ComparisonView(trials, refused or {}, tuple(session.vessels()))
    session._compared(JobMessage("compare", "done", answer))


# Sentences about an error


@pytest.mark.parametrize(
    ("error", "floor", "verdict", "says"),
    [
        (0.10, 0.10, Judgement.ADEQUATE, "no more than noise"),
        (0.30, 0.10, Judgement.WRONG, "3.0 times what noise alone would show"),
        (1.21, 12.4, Judgement.UNJUDGED, "these data cannot judge it"),
        (40.0, 12.4, Judgement.WRONG, "3.2 times"),
        (math.nan, 0.1, Judgement.UNJUDGED, "cannot judge"),
        (0.1, math.nan, Judgement.UNJUDGED, "cannot judge"),
    ],
)
def test_an_error_below_a_floor_that_hides_the_motion_is_no_good_model(error, floor, verdict, says):
    assert judge(error, floor) is verdict
    standing = Standing(error, floor)
    assert standing.judgement is verdict
    assert says in judgement_text(standing)
    assert ("noise" in nowhere_text(standing)) == (verdict is not Judgement.WRONG)


def test_only_what_was_judged_good_is_green(session):
    came(session, seen("one", 1.21, 12.4))
    assert "cannot judge" in compare._headline(session)
    assert "'good'" not in compare._headline(session)
    came(session, seen("one", 0.1, 0.1))
    assert "'good'>no more than noise<" in compare._headline(session)


def test_a_recording_that_cannot_be_compared_is_said_to_be_so_and_ends_the_comparing(session):
    why = "two.tlog: no servo outputs in it"
    session.set_logs([session.folders.read[0] / name for name in ("one.tlog", "two.tlog")])
    assert "Comparing" in compare._headline(session)
    came(session, seen("one", 0.1, 0.1), refused={"two.tlog": why})
    assert why in compare._headline(session)
    assert "Comparing" not in compare._headline(session)


def test_working_on_recordings_is_no_good_news_once_they_could_not_be_read(session):
    page = recordings.RecordingsPage(context_of(session))
    page._list()
    page._logs.value = [str(session.folders.read[0] / "two.tlog")]
    page.guarded(page._chosen)()
    assert message_of(page) == "working on two.tlog: see Compare"
    assert page._notice.good
    page._show_problems()
    assert page._notice.good  # nothing has failed yet
    came(session, refused={"two.tlog": "two.tlog: no log"})
    page._show_problems()
    assert "cannot work on two.tlog" in message_of(page)
    assert not page._notice.good


def test_a_comparison_that_failed_is_not_under_way(session):
    session._asked = session.logs
    session._compared(JobMessage("compare", "failed", "boat.toml: m11 is no mass"))
    text = compare._headline(session)
    assert "m11 is no mass" in text
    assert "Comparing" not in text


def test_a_number_of_the_vessel_before_stands_under_no_vessel_of_now(session):
    came(session, seen("one", 0.1, 0.1))
    page = vessel.VesselPage(context_of(session))
    page._show_trials()
    assert "0.100</td><td>0.100" in page._errors.object
    session.slide(with_values(session.version, {"m11": 90.0}), "m11 moved by hand")
    page._show_trials()
    assert "0.100</td><td>comparing" in page._errors.object
    assert "'good'" not in compare._headline(session)
    changed = replace(seen("one", 0.1, 0.1), vessels=(
        seen("one", 0.1, 0.1).vessels[0], seen("one", 0.7, 0.1, label=NOW).vessels[0]))  # fmt: skip
    came(session, changed)
    page._show_trials()
    assert "0.100</td><td>0.700" in page._errors.object
    session.undo()
    page._show_trials()
    assert "0.700" not in page._errors.object


def test_what_comes_of_recordings_that_are_no_longer_worked_on_is_dropped(session):
    session._asked = session.logs
    session.set_logs([session.folders.read[0] / "two.tlog"])
    session._compared(JobMessage("compare", "part", seen("one", 0.1, 0.1)))
    session._compared(JobMessage("compare", "done", ComparisonView((), {}, ())))
    assert session.trials == ()
    assert not session.is_current


# Unsaved edits, messages, and files with mistakes


def chosen(page, *logs: str, file: str = "boat.toml") -> str:
    folder = page.session.folders.read[0]
    page._list()
    page._logs.value = [str(folder / log) for log in logs]
    page._vessel.value = str(folder / file)
    page.guarded(page._chosen)()
    return message_of(page)


def test_edits_are_kept_when_recordings_change_and_never_dropped_without_a_word(session):
    page = recordings.RecordingsPage(context_of(session))
    session.slide(with_values(session.version, {"m11": 90.0}), "m11 moved by hand")
    mine = session.version
    assert "working on two.tlog" in chosen(page, "two.tlog")
    assert session.version == mine
    assert "not saved" in chosen(page, "two.tlog", file="other.toml")
    assert session.version == mine
    assert "working on" in chosen(page, "two.tlog", file="other.toml")
    assert session.version != mine
    assert session.vessel_file.name == "other.toml"


def test_what_was_saved_may_go_without_a_question(session):
    page = recordings.RecordingsPage(context_of(session))
    session.slide(with_values(session.version, {"m11": 90.0}), "m11 moved by hand")
    session.save("mine.toml")
    assert "working on" in chosen(page, "one.tlog", file="other.toml")


def test_files_with_a_mistake_are_listed_with_the_reason_and_not_offered(session):
    (session.folders.read[0] / "bad.toml").write_text(
        BOAT.read_text().replace("m11 = 42.0", 'm11 = "heavy"')
    )
    (session.folders.read[0] / "half.toml").write_text("[hull]\nlength = 1.0\n")
    page = recordings.RecordingsPage(context_of(session))
    page._list()
    came(session, refused={"one.tlog": "one.tlog: no message in it"})
    page._show_problems()
    assert "bad.toml" not in page._vessel.options
    assert "boat.toml" in page._vessel.options
    for text in ("bad.toml", "m11", "half.toml", "no message in it"):
        assert text in page._problems.object


class QuietPage(Page):
    def body(self):
        return None


def test_a_message_is_said_where_it_was_caused_and_ends_with_the_next_thing_done(session):
    here, there = (QuietPage(context_of(session)) for _ in range(2))
    here.guarded(lambda: session.set_vessel(ROOT / "pyproject.toml"))()
    assert "not in a folder" in message_of(here)
    assert message_of(there) == ""
    here.guarded(lambda: None)()
    assert message_of(here) == ""


def test_good_news_fade_and_what_failed_stays_until_it_works(session, monkeypatch):
    session.notify("saved", good=True)
    monkeypatch.setattr("gateway.studio.session.time.monotonic",
                        lambda since=session.notice.since: since + GOOD_S + 1.0)  # fmt: skip
    assert not session.notice.holds
    session._asked = session.logs
    session._compared(JobMessage("compare", "failed", "no"))
    assert session.notice.holds
    came(session, seen("one", 0.1, 0.1))
    assert session.notice is None


# Boats that are gone


def boat(
    age: float | None, *, alive: bool = True, link: float = 0.0, unfit: str = ""
) -> WatchedBoat:
    moved = {"receive_time_ns": 10**18, "surge_mps": 1.0, "sway_mps": 0.0, "yaw_rate_radps": 0.0,
             "east_m": 0.0, "north_m": 0.0, "yaw_rad": 0.0}  # fmt: skip
    forces = {field.name: 0.0 for field in TOPICS["residual"].all_fields} | {
              "missing_surge_n": 50.0, "missing_sway_n": 0.0, "missing_surge_n_std": 1.0,
              "missing_sway_n_std": 1.0}  # fmt: skip
    health = {field.name: 0 for field in TOPICS["health"].all_fields} | {
        "rate_hz": 10, "nis": 1, "unfit": unfit, "link_age_s": link}  # fmt: skip
    every = (("measured", moved), ("residual", forces), ("health", health))
    latest = {name: Latest(m, age) for name, m in every}
    return WatchedBoat(VesselStatus("Grebe", alive, latest, 10.0), {}, {})


@pytest.mark.parametrize(
    ("one", "word"),
    [(boat(0.5), "live"), (boat(4.0), "silent for 4 s"), (boat(None), "silent"),
     (boat(9.0, alive=False), "gone for 9 s"), (boat(0.1, alive=False), "gone for 0 s")],
)  # fmt: skip
def test_a_boat_is_live_only_while_it_is_heard(one, word):
    heard = word == "live"
    assert word in live._state(one.status)
    health = live._health(one.status)
    assert ("good" in "".join(health.values())) == heard
    chart = Chart(LIGHT)
    chart.show((one,))
    (alpha,) = chart._hulls["measured"].data["alpha"]
    assert (alpha == 1.0) == heard
    assert (len(chart._forces.data["x0"]) == 1) == heard
    assert (chart._names.data["name"] == ["Grebe"]) == heard


def test_a_boat_whose_link_is_silent_is_not_live_though_its_gateway_is():
    one = boat(0.5, link=30.0)
    assert "● live" not in live._state(one.status)
    assert "○ link silent for 30 s" in live._state(one.status)
    assert "last heard at" in live._state(one.status)
    health = live._health(one.status)
    assert [name for name, text in health.items() if "good" in text] == ["shadow", "recorder"]
    assert "nothing to judge the model by" in health["fit"]
    chart = Chart(LIGHT)
    chart.show((one,))
    assert chart._hulls["measured"].data["alpha"] == [0.25]
    assert len(chart._forces.data["x0"]) == 0
    assert chart._names.data["name"] == ["Grebe: link silent, was here"]


def test_data_that_cannot_judge_the_model_are_not_called_good():
    assert "good" in live._health(boat(0.5).status)["fit"]
    fit = live._health(boat(0.5, unfit="heading frozen since 14:02").status)["fit"]
    assert "heading frozen since 14:02" in fit
    assert "look here" in fit


def test_a_boat_that_was_removed_comes_back_with_its_next_message():
    history, kept = LiveHistory(MonitorOptions("tcp/127.0.0.1:1")), 0.0
    history._take([boat(9.0, alive=False).status], kept)
    assert len(history.boats()) == 1
    history.remove_silent()
    assert history.boats() == ()
    history._take([boat(10.0, alive=False).status], kept)
    assert history.boats() == ()
    history._take([boat(0.1).status], kept)
    assert len(history.boats()) == 1
    history._take([boat(9.0, alive=False).status], kept)
    assert len(history.boats()) == 1


# Numbers of a marked range


def test_the_error_of_a_marked_range_is_that_of_the_range():
    time = np.arange(0.0, 10.0, 1.0)
    measured, model = np.zeros((10, 6)), np.zeros((10, 6))
    model[5:, 3] = 0.5
    model[9] = np.nan
    trial = replace(seen("one", 0.1, 0.1), time=time, motion=measured)
    one = replace(trial.vessels[0], motion=model)
    assert range_text(trial, one, ()) == ""
    assert "off by 0.000 m/s ahead" in range_text(trial, one, ((0.0, 4.0),))
    assert "off by 0.500 m/s ahead" in range_text(trial, one, ((5.0, 9.0),))
    assert "without any prediction" in range_text(trial, one, ((9.0, 10.0),))


# Plain words first


def test_the_headline_of_a_diagnosis_is_a_sentence_and_the_identifier_is_small(session):
    says = "The compass reads 7.5° too far to port (6.9–8.2°)"
    answer = {
        "verdict": "explained", "summary": "heading_offset: the error falls", "base_changed": False,
        "unexplained": 0.02,
        "ranking": [], "ladder": [{"parameters": {}}], "depends_on": [], "next_manoeuvre": None,
        "refused": [],
    }  # fmt: skip
    given = LadderView((), LadderBar("as given", 0.6, None), session.version.text)
    found = LadderView(("heading_offset",), LadderBar("+", 0.1, None), "text", says)
    session.diagnosis = DiagnosisView(
        answer, ("one.tlog",), 0.1, (given, given, found), None, {"heading_offset": EMPTY},
        headlines=(f"{says}.",), causes={"heading_offset": says},
    )  # fmt: skip
    page = diagnose.DiagnosePage(context_of(session))
    assert not page._last.visible, "an empty card"
    page._show_diagnosis()
    assert page._last.visible == bool(page._rest.object)
    text = page._verdict.object
    assert text.startswith(f"<h2>{says}.</h2>")
    assert text.index("Found what is missing") < text.index("<p class='faint'>heading_offset")
    (row,) = page._rows(session.diagnosis)
    assert f"<strong>{says}</strong>" in row[2].object
    heading = page._evidence.objects[0][0].object
    assert heading.startswith(f"<h3>{says} <span class='faint'>heading offset</span></h3>")


def test_while_it_is_looked_for_nobody_is_asked_to_press_what_is_pressed(session):
    page = diagnose.DiagnosePage(context_of(session))
    page._show_ladder()
    assert "Press “Find what is missing”" in page._now.object
    session.slow.job = "diagnose"
    page.tick()
    assert "It is being looked for" in page._now.object
    session.slow.job = "a report"
    page.tick()
    assert "Press “Find what is missing”" in page._now.object
    session.slow.job = None
