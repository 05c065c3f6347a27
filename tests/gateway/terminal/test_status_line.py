"""The line that says what is being done; what is worth keeping stays on the screen."""

import io
import pickle

import pytest
from rich.console import Console

import gateway.terminal
from gateway.terminal import status_line, work_line
from gateway.terminal.work_line import WorkLine
from sim.state import CountedStep


def written(monkeypatch: pytest.MonkeyPatch, terminal: bool, *texts: str) -> str:
    out = io.StringIO()

    def opened(**options: object) -> Console:
        return Console(file=out, force_terminal=terminal, width=200)

    monkeypatch.setattr(gateway.terminal, "SafeConsole", opened)
    with status_line("diagnosing", keep="first impression") as show:
        for text in texts:
            show(text)
    return out.getvalue()


def test_a_first_impression_stays_on_the_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    text = written(monkeypatch, True, "thruster_lag", "first impression: most like hull_lift")
    kept = [line for line in text.split("\n") if "tested now" in line]
    assert len(kept) == 1
    assert "first impression: most like hull_lift" in kept[0]
    assert "thruster_lag" not in kept[0]


def test_what_is_no_terminal_gets_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert written(monkeypatch, False, "first impression: most like hull_lift") == ""


class Clock:
    """A time that stands still until it is set."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    standing = Clock()
    monkeypatch.setattr(work_line, "perf_counter", standing)
    return standing


def shown(line: WorkLine) -> str:
    return line.__rich__().plain


def test_the_time_so_far_is_told_after_ten_seconds(clock: Clock) -> None:
    line = WorkLine("identifying")
    line.step("3 s")
    clock.now = 9.9
    assert shown(line) == "identifying: 3 s"
    clock.now = 125.0
    assert shown(line) == "identifying: 3 s (2 min so far)"


def test_what_is_left_of_a_round_is_worked_out_from_the_steps_of_that_round(clock: Clock) -> None:
    line = WorkLine("diagnosing")
    clock.now = 20.0
    line.step("looking for effects")
    clock.now = 24.0
    line.step(CountedStep("8 of 24 looked at", 8, 24))
    expected = "diagnosing: 8 of 24 looked at, about 8 s for the other 16 (24 s so far)"
    assert shown(line) == expected
    line.step(CountedStep("7 of 24 looked at", 7, 24))  # of a thread that was overtaken
    assert shown(line) == expected
    clock.now = 29.0
    assert "about 3 s for the other 16 (29 s so far)" in shown(line)
    clock.now = 33.0  # they take longer than the first ones: nothing is known
    assert shown(line) == "diagnosing: 8 of 24 looked at (33 s so far)"
    line.step(CountedStep("24 of 24 looked at", 24, 24))
    assert shown(line) == "diagnosing: 24 of 24 looked at (33 s so far)"


def test_what_takes_long_once_only_is_said(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    line = WorkLine("diagnosing")
    line.step("re-fitting the base")
    monkeypatch.setattr(work_line, "compiling_s", lambda: 0.9)
    assert shown(line) == "diagnosing: re-fitting the base"
    monkeypatch.setattr(work_line, "compiling_s", lambda: 1.1)
    assert shown(line) == "diagnosing: re-fitting the base (compiling, kept for the next time)"


def test_no_time_is_made_up_for_the_next_round(clock: Clock) -> None:
    line = WorkLine("diagnosing")
    line.step(CountedStep("20 of 24 looked at", 20, 24))
    clock.now = 30.0
    line.step("fitting [m] hull_lift")
    assert shown(line) == "diagnosing: fitting [m] hull_lift (30 s so far)"
    clock.now = 40.0
    line.step(CountedStep("1 of 5 looked at", 1, 5))
    assert "about 40 s for the other 4" in shown(line)


def test_of_one_among_many_nothing_is_concluded(clock: Clock) -> None:
    line = WorkLine("diagnosing")
    line.step("looking for effects")
    clock.now = 20.0
    line.step(CountedStep("3 of 40 looked at", 3, 40))
    assert shown(line) == "diagnosing: 3 of 40 looked at (20 s so far)"


def test_a_counted_step_arrives_whole_from_another_process() -> None:
    """The studio works in one of its own."""
    step = pickle.loads(pickle.dumps(CountedStep("2 of 5 looked at", 2, 5)))
    assert (step, step.done, step.total) == ("2 of 5 looked at", 2, 5)
