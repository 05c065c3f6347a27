"""The session: what pages change and share, without any page."""

import shutil
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.figures.diagnosis import LadderBar
from gateway.studio import AlternativeView, DiagnosisView, LadderView, Scope, TrialView, tasks
from gateway.studio.access import Folders
from gateway.studio.session import Session
from gateway.studio.signals import SignalRequest, signals_task
from gateway.studio.tasks import compare_task, report_task
from gateway.studio.version import with_values
from gateway.studio.worker import JobMessage
from gateway.vessel_file import load_vessel

ROOT = Path(__file__).resolve().parents[3]
LOG, BOAT = ROOT / "recordings/voyage_1.tlog", ROOT / "configs/vessels/demo_boat.toml"


@pytest.fixture
def session(tmp_path):
    shutil.copy(BOAT, tmp_path)
    return Session(Folders.of([], [tmp_path], tmp_path / "out"), (), tmp_path / BOAT.name)


def diagnosis_on(session: Session) -> DiagnosisView:
    """A made-up answer with two effects, one after the other."""
    text = session.versions[-1].text
    bars = [LadderBar(name, error, None) for name, error in
             (("as given", 0.6), ("base re-fitted", 0.5), ("+ a", 0.3), ("+ b", 0.1))]  # fmt: skip
    effects: list[tuple[str, ...]] = [(), (), ("a",), ("a", "b")]
    steps = tuple(
        LadderView(e, bar, f"{text}\n# {k}")
        for k, (e, bar) in enumerate(zip(effects, bars, strict=True))
    )
    return DiagnosisView({"ranking": []}, ("one.tlog",), 0.1, steps, None, {})


def test_sliding_is_one_step_however_long_and_undo_takes_it_back(session):
    first = session.version
    for value in (41.0, 42.0, 43.0):
        session.slide(with_values(session.version, {"m11": value}), "m11 moved by hand")
    assert len(session.versions) == 2
    assert tomllib.loads(session.version.text)["dynamics"]["m11"] == 43.0
    assert [name for name, _ in session.vessels()] == ["as given", "now"]
    session.undo()
    assert session.version == first
    session.undo()
    assert session.version == first


def test_the_ladder_is_climbed_step_by_step_and_down_again(session):
    session.diagnosis = diagnosis_on(session)
    _, _, a, b = session.diagnosis.steps
    session.climb(a)
    assert [s.error for s in session.version.ladder] == [0.6, 0.5, 0.3]
    session.climb(b)
    assert session.version.effects == ("a", "b")
    assert [s.error for s in session.version.ladder] == [0.6, 0.5, 0.3, 0.1]
    session.undo()
    assert session.version.effects == ("a",)


def test_a_rival_takes_the_place_of_the_chosen_one_with_its_own_error_and_undo(session):
    found = diagnosis_on(session)
    rival = LadderView(("a", "c"), LadderBar("+ c", 0.12, None), "c beside a")
    alone = LadderView(("c",), LadderBar("+ c", 0.4, None), "c alone")
    session.diagnosis = replace(
        found, alternatives=(AlternativeView(alone, False), AlternativeView(rival, True))
    )
    for step in found.steps[2:]:
        session.climb(step)
    chosen = session.version
    session.climb(rival)
    assert (session.version.text, session.version.effects) == ("c beside a", ("a", "c"))
    assert [s.error for s in session.version.ladder] == [0.6, 0.5, 0.3, 0.12]
    session.undo()
    assert session.version == chosen
    session.climb(alone)
    assert [s.error for s in session.version.ladder] == [0.6, 0.5, 0.4]


def test_a_cause_that_its_own_evidence_contradicts_is_not_offered(session):
    found = diagnosis_on(session)
    rival = LadderView(("c",), LadderBar("+ c", 0.2, None), "c")
    for contradicted in (False, True):
        one = replace(found, alternatives=(AlternativeView(rival, True, contradicted),))
        assert (rival in one.next_steps(())) != contradicted


@pytest.mark.parametrize("beside", [False, True])
def test_a_curve_that_does_without_effects_is_what_is_advised(session, beside):
    """It was the last button of the page, below six that add what only comes near."""
    found, below = diagnosis_on(session), ("a", "b") if beside else ()
    curve = LadderView((*below, "curve"), LadderBar("+ curve", 0.05, None), "the curve")
    answer = {**found.answer, "curve": {"effects": list(curve.effects)}}
    one = replace(found, alternatives=(AlternativeView(curve, False),), answer=answer)
    assert one.curve_stands_alone is not beside
    assert one.next_steps(below)[0] is curve
    assert one.is_advised(curve)
    assert one.is_advised(found.steps[2]) is beside
    assert not found.curve_stands_alone
    assert found.next_steps(()) == [found.steps[2]]


def test_a_second_diagnosis_goes_on_from_the_first(session):
    session.diagnosis = diagnosis_on(session)
    session.climb(session.diagnosis.steps[2])
    again = diagnosis_on(session)
    session.diagnosis = replace(again, before=("a",), steps=(
        *(replace(r, bar=LadderBar(r.bar.name, 0.3, None)) for r in again.steps[:2]),
        LadderView(("d",), LadderBar("+ d", 0.2, None), "text"),
    ))  # fmt: skip
    session.climb(session.diagnosis.steps[2])
    assert session.version.effects == ("a", "d")
    assert [s.error for s in session.version.ladder] == [0.6, 0.5, 0.3, 0.3, 0.2]


def test_what_cannot_begin_yet_loses_no_answer(session):
    session.logs, session.diagnosis = (session.folders.read[0] / "a.tlog",), diagnosis_on(session)
    session.report, session.slow.job = "report.html", "look"
    alone = partial(session.report_from_log, session.folders.read[0] / "a.tlog")
    for work in (session.diagnose, session.write_report, alone):
        with pytest.raises(RuntimeError, match="busy with look"):
            work()
    assert session.diagnosis == diagnosis_on(session)
    assert session.report == "report.html"


def changes_of(session) -> dict[str, Callable[[], None]]:
    """What another page may do while something long is under way."""
    folder = session.folders.read[0]
    return {
        "another vessel file": lambda: session.set_vessel(folder / BOAT.name),
        "other recordings": lambda: session.set_logs([folder / "a.tlog"]),
        "other stretches of time": lambda: session.set_scope(Scope("a", ((0.0, 9.0),))),
    }


@pytest.mark.parametrize("what", ["another vessel file", "other recordings",
                                  "other stretches of time"])  # fmt: skip
def test_long_work_that_another_page_ends_is_said_to_have_ended_until_it_begins_again(
    session, what, monkeypatch
):
    session.slow.job = "diagnose"
    changes_of(session)[what]()
    assert not session.slow.busy
    says = f"diagnose was ended, for {what} "
    assert session.notice.text.startswith(says)
    assert session.notice.text.endswith("start it again where it is still wanted")
    assert not session.notice.good
    monkeypatch.setattr(session.slow, "start", lambda *_: None)
    session.set_logs([session.folders.read[0] / "a.tlog"])
    assert session.notice.text.startswith(says), "nothing was under way: nothing more is said"
    session.diagnose()
    assert session.notice is None


def test_a_report_from_a_recording_alone_depends_on_no_choice_and_goes_on(session, monkeypatch):
    began = []
    monkeypatch.setattr(session.slow, "start", lambda job, *_: began.append(job))
    session.report_from_log(session.folders.read[0] / "a.tlog")
    (session.slow.job,) = began
    for change in changes_of(session).values():
        change()
    assert session.slow.job == "report from a.tlog alone"
    assert session.notice is None
    session.cancel()
    assert not session.slow.busy


def test_what_is_saved_loads_again_and_nothing_is_written_over(session):
    session.slide(with_values(session.version, {"X_u": -7.5}), "X_u moved by hand")
    file = session.save("mine.toml")
    assert load_vessel(file).dynamics.X_u == -7.5
    with pytest.raises(BadInput, match="there already"):
        session.save("mine.toml")


def test_a_number_moved_by_hand_loses_its_origin(session):
    text = session.version.text + '\n[provenance."dynamics.m11"]\nrecording = "one"\n'
    session.slide(text, "fitted")
    tables = tomllib.loads(with_values(session.version, {"m11": 40.0}))
    assert "dynamics.m11" not in tables["provenance"]


def test_a_recording_or_vessel_that_is_gone_is_told_in_a_line(session, tmp_path):
    gone, send = str(tmp_path / "gone.tlog"), lambda _: None
    found = compare_task(send, [gone], [("as given", BOAT.read_text())], ())
    assert found.refused == {gone: f"gone.tlog is no longer there ({gone})"}
    with pytest.raises(BadInput, match="is no longer there"):
        signals_task(send, SignalRequest(gone, ()))
    with pytest.raises(BadInput, match="cannot read the vessel file"):
        session.set_vessel(tmp_path / "gone.toml")


def looked(session):
    """The session after another look at its vessel file; what it says."""
    session.watch._looked = session._updated = 0.0
    session.update()
    return session.notice.text if session.notice and session.notice.holds else ""


def test_a_vessel_file_that_is_edited_is_read_again_and_where_work_would_be_lost_only_told(session):
    file, text = session.vessel_file, session.version.text
    assert looked(session) == ""
    file.write_text(text.replace("m11 = ", "m11 = 1"))
    assert looked(session) == "demo_boat.toml was changed: read again"
    assert session.version.text == file.read_text() != text
    session.slide(with_values(session.version, {"m11": 41.0}), "m11 moved by hand")
    file.write_text(text)
    assert "changed: the studio goes on with it as it was; choose the vessel again" in looked(
        session
    )
    assert tomllib.loads(session.version.text)["dynamics"]["m11"] == 41.0
    assert session.watch.differs


def test_a_vessel_file_that_is_broken_or_removed_is_told_until_it_is_as_it_was(session):
    file, text = session.vessel_file, session.version.text
    file.write_text(text.replace("m11 = ", "m_11 = "))
    assert "was changed and cannot be used" in looked(session)
    assert "m_11" in session.notice.text
    file.unlink()
    gone = "demo_boat.toml is no longer there: the studio goes on with it as it was"
    assert looked(session) == gone == looked(session)
    file.write_text(text)
    assert looked(session) == ""
    assert session.version.text == text


def test_files_elsewhere_are_not_taken(session):
    with pytest.raises(BadInput, match="not in a folder"):
        session.set_logs([LOG])
    with pytest.raises(BadInput, match="not in a folder"):
        session.set_vessel(BOAT)


def test_a_vessel_file_with_a_mistake_changes_nothing(session):
    bad = session.folders.read[0] / "bad.toml"
    bad.write_text(BOAT.read_text().replace("m11 = 42.0", 'm11 = "heavy"'))
    before = session.version
    with pytest.raises(BadInput, match="m11"):
        session.set_vessel(bad)
    assert session.version == before


def test_measured_motion_is_sent_before_anything_is_compared_and_regimes_have_their_times():
    sent: list[object] = []
    found = compare_task(sent.append, [str(LOG)], [("as given", BOAT.read_text())], ())
    (view,) = found.trials
    parts = [one for one in sent if isinstance(one, TrialView)]
    assert [one.vessels for one in parts] == [()]
    (vessel,) = view.vessels
    assert vessel.nrmse > 2.0 * vessel.standing.floor
    assert set(vessel.figures) == {"velocities", "residuals", "track", "strips", "forces",
                                   "correlations"}  # fmt: skip
    speed = next(w for w in vessel.worst if w.text.startswith("speed"))
    inside = np.zeros(len(view.time), bool)
    for start, end in speed.times:
        inside |= (view.time >= start) & (view.time < end)
    east, north = np.gradient(view.east, view.time), np.gradient(view.north, view.time)
    median = np.median(np.hypot(east, north)[inside])
    low, high = (float(word) for word in speed.text.split(":")[0].split()[1:4:2])
    assert low <= median <= high


def test_of_a_long_recording_a_rough_look_comes_first_and_the_whole_takes_its_place(
    session, monkeypatch
):
    monkeypatch.setattr(tasks, "LONG", 1000)
    monkeypatch.setattr(tasks, "_kept", {})
    sent: list[object] = []
    vessels = [("as given", BOAT.read_text())]
    compare_task(sent.append, [str(LOG)], vessels, ())
    rough, whole = (one for one in sent if isinstance(one, TrialView))
    assert rough.rough
    assert "first look" in rough.notices[0]
    assert not whole.rough
    assert not any("first look" in notice for notice in whole.notices)
    assert len(rough.time) < 0.3 * len(whole.time)
    for place in ("north", "east"):
        there = np.interp(whole.time, rough.time, getattr(rough, place))
        assert np.abs(there - getattr(whole, place)).max() < 1.0
    session._asked = session.logs
    for one in (rough, whole, rough):
        session._compared(JobMessage("compare", "part", one))
    assert session.trials == (whole,)
    sent.clear()
    compare_task(sent.append, [str(LOG)], vessels, ())
    assert not any(one.rough for one in sent if isinstance(one, TrialView))  # it was read before


def test_the_error_over_time_is_what_the_scores_are_made_of():
    found = compare_task(lambda _: None, [str(LOG)], [("as given", BOAT.read_text())], ())
    (view,) = found.trials
    line = view.vessels[0].figures["residuals"].panels[1].marks[1]
    rms = float(np.sqrt(np.nanmean(line.y**2)))
    assert rms == pytest.approx(view.vessels[0].rmse["v"], rel=0.15)


def test_a_report_without_the_answer_that_the_page_shows_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="diagnose again"):  # a cancelled job took it along
        report_task(lambda _: None, [], [], [], str(tmp_path / "report.html"), diagnosed=True)
    assert not list(tmp_path.iterdir())
