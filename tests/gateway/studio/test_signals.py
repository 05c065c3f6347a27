"""Any field of a recording over the boat's clock, and signals derived by a safe expression."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.errors import BadInput
from gateway.ingest.log import choose_boat
from gateway.ingest.log_events import happenings
from gateway.ingest.open import open_log
from gateway.studio.access import Folders
from gateway.studio.pages import signals as signals_page
from gateway.studio.session import Session
from gateway.studio.signals import (
    Expression,
    Signal,
    SignalReader,
    SignalRequest,
    SignalsView,
    derived_signal,
    signals_task,
)
from tests.conftest import ROOT
from tests.gateway.studio.pages import context_of

LOG = str(ROOT / "recordings/voyage_1.tlog")
TIME = np.arange(0.0, 10.0, 0.5)
RAW = {"A.x": Signal(TIME, 2.0 * TIME), "A.v[1]": Signal(TIME, np.ones(20)),
       "B.y": Signal(np.array([0.0, 9.5]), np.array([0.0, 95.0]))}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("A.x + 1", 2.0 * TIME + 1.0),
        ("-A.x ** 2 / 4", -(TIME**2)),
        ("slope(A.x)", np.full(20, 2.0)),
        ("A.x * A.v[1] - B.y", -8.0 * TIME),
        ("deg(A.v[1])", np.full(20, 180.0 / np.pi)),
        ("hypot(3 * A.v[1], 4)", np.full(20, 5.0)),
        ("max(A.x, 4)", np.maximum(2.0 * TIME, 4.0)),
    ],
)
def test_an_expression_is_what_it_says(text, value):
    found = Expression(text).value(RAW)
    np.testing.assert_allclose(found.value, value)
    np.testing.assert_array_equal(found.time, TIME)


def test_a_mean_is_of_the_time_around():
    steps = {"A.x": Signal(TIME, (TIME > 5.0).astype(float))}
    mean = Expression("mean(A.x, 4)").value(steps).value
    assert mean[0] == 0.0
    assert mean[-1] == 1.0
    assert 0.3 < mean[10] < 0.7


@pytest.mark.parametrize(
    "text",
    [
        "", "1 + 2", "A.x +", "__import__('os')", "A.x.real", "A.__class__.__mro__", "lambda: A.x",
        "[A.x]", "A.x if 1 else 2", "A.x; A.x", "open(A.x)", "A.x @ A.x", "A.x['k']", "A.x[True]",
        "sqrt(A.x, 2)", "max(A.x, key=A.x)", "True * A.x", "A.x and 1", "A.x" + " + A.x" * 100,
    ],
)  # fmt: skip
def test_what_the_grammar_does_not_hold_is_refused(text):
    with pytest.raises(BadInput):
        Expression(text)


def test_numbers_without_end_are_no_danger():
    assert not np.isfinite(Expression("A.x + 9**9**9**9").value(RAW).value).any()


def test_derived_signals_of_one_another_and_of_themselves():
    derived = {"twice": "2 * A.x", "more": "twice + 1", "self": "self + 1"}
    np.testing.assert_allclose(derived_signal("more", RAW.get, derived).value, 4.0 * TIME + 1.0)
    with pytest.raises(BadInput, match="derived from itself"):
        derived_signal("self", RAW.get, derived)
    with pytest.raises(BadInput, match="no such signal"):
        derived_signal("B.z", RAW.get, derived)


def test_fields_of_a_recording_come_as_they_are_and_what_is_not_there_is_said():
    derived = (("speed", "hypot(LOCAL_POSITION_NED.vx, LOCAL_POSITION_NED.vy)"), ("bad", "X.y"))
    names = ("ATTITUDE.yaw", "speed", "bad", "STATUSTEXT.text")
    found = signals_task(lambda _: None, SignalRequest(LOG, names, derived))
    assert {"ATTITUDE.yaw", "SERVO_OUTPUT_RAW.servo1_raw"} <= set(found.fields)
    assert set(found.signals) == {"ATTITUDE.yaw", "speed"}
    assert set(found.refused) == {"bad", "STATUSTEXT.text"}
    yaw, log = found.signals["ATTITUDE.yaw"], open_log(LOG)
    np.testing.assert_allclose(yaw.value, log.table("ATTITUDE").columns["yaw"])
    assert np.all(np.diff(yaw.time) > 0.0)
    assert 300.0 < yaw.time[-1] < 320.0
    assert 1.0 < found.signals["speed"].value.max() < 3.0


def test_a_derived_signal_of_a_field_that_is_not_there_is_refused(tmp_path):
    session = Session(Folders.of([], [tmp_path], tmp_path / "out"), (), None)
    page = signals_page.SignalsPage(context_of(session))
    page._name.value, page._formula.value = "heading", "deg(ATITUDE.yaw)"
    page._derive()  # nothing was read yet: it cannot be told
    assert session.layout.derived == {"heading": "deg(ATITUDE.yaw)"}
    page._every = ("ATTITUDE.roll", "ATTITUDE.yaw")
    with pytest.raises(BadInput, match=r"ATITUDE\.yaw: no such .*: did you mean ATTITUDE\.yaw\?"):
        page._derive()
    page._formula.value = "deg(ATTITUDE.yaw)"
    page._derive()
    page._name.value, page._formula.value = "turn", "slope(unwrap(rad(heading)))"
    page._derive()
    assert session.layout.derived["turn"] == "slope(unwrap(rad(heading)))"


def test_modes_and_events_stand_on_the_boats_clock():
    log = open_log(LOG)
    boat = choose_boat(log)
    known = happenings(log, boat)
    assert [one.text for one in known.modes] == ["manual"]
    texts = [one.text for one in known.events]
    assert texts == ["Invented voyage: no real autopilot", "Throttle armed", "Throttle disarmed"]
    (armed,) = (s for s in log.decode(boat).samples if s.quantity.name == "ARMED")
    on = armed.vehicle_time_ns[np.flatnonzero(armed.values[:, 0])]
    assert abs(known.events[1].time_ns - on[0]) < 2e9
    assert abs(known.events[2].time_ns - on[-1]) < 2e9


def test_two_windows_with_a_recording_each_are_answered_and_then_there_is_peace(
    tmp_path, monkeypatch
):
    """The reader keeps one answer: each asked again for its own when the other's came."""
    logs = [tmp_path / "a.tlog", tmp_path / "b.tlog"]
    for log in logs:
        log.write_bytes(b"")
    session = Session(Folders.of([], [tmp_path], tmp_path / "out"), logs, None)
    reader, begun, done = session.signals, [], []
    monkeypatch.setattr(reader.worker, "start", lambda job, task, request: begun.append(request))
    monkeypatch.setattr(reader.worker, "messages", lambda: [done.pop()] if done else [])
    pages = [signals_page.SignalsPage(context_of(session)) for _ in logs]
    for page, log in zip(pages, logs, strict=True):
        page._list()
        page._log.value = str(log.resolve())
    for _ in range(10):
        if reader._reading is not None:
            read = reader._reading
            view = SignalsView(read, (Path(read.path).stem,), {}, {})
            done.append(SimpleNamespace(kind="done", value=view))
        if reader.update():
            for page in pages:
                page._show()
    assert [page._every for page in pages] == [("a",), ("b",)]
    assert len(begun) <= 3
    logs[0].write_bytes(b"more")
    pages[0]._list()
    reader.update()
    assert Path(begun[-1].path).name == "a.tlog"  # another file now


def test_plots_of_the_same_fields_come_and_go(tmp_path, monkeypatch):
    """What is read stays the same; the page took that for nothing new to draw."""
    session = Session(Folders.of([], [tmp_path], tmp_path / "out"), (), None)
    page = signals_page.SignalsPage(context_of(session))
    page._log.options = {"a": str(tmp_path / "a.tlog")}
    page._log.value = str(tmp_path / "a.tlog")
    line = Signal(TIME, TIME)
    for plots in ((("A.x",),), (("A.x",), ("A.x",)), (("A.x",),)):
        session.set_layout(plots=plots)
        request = page._request()
        session.signals.answers[request] = SignalsView(request, ("A.x",), {"A.x": line}, {})
        page._show()
        assert len(page._pictures.objects) == len(plots) + 1  # and the place for a new one


def test_the_latest_question_is_answered_next(monkeypatch):
    reader, begun = SignalReader(), []
    monkeypatch.setattr(reader.worker, "start", lambda job, task, request: begun.append(request))
    one, two = SignalRequest("a"), SignalRequest("b")
    reader.ask(one)
    reader.ask(two)
    reader.update()
    assert begun == [two]
