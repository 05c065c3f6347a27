"""What `shadow replay` prints of what its shadow warned of, and of what that came to."""

import numpy as np
import pytest

from gateway.offline.replay_summary import ReplaySummary, ReplayTotals
from gateway.shadow.topic_rows import EventRow, event_rows
from gateway.terminal.recordings import MOST_WARNINGS, show_replay

WRONG = EventRow(1, 1, "model_wrong", "warning", "the model is wrong: too little seen")
EXPLAINED = EventRow(2, 2, "model_explained", "warning", "the model is wrong: looks like drag")
RIGHT = EventRow(3, 3, "model_right", "info", "the model is right again")
BACK = EventRow(4, 4, "telemetry_back", "info", "telemetry is fresh again")


def summary(*events: EventRow) -> ReplaySummary:
    """Of a replay in which these came, in two steps."""
    totals = ReplayTotals()
    for part in (events[:2], events[2:]):
        totals.add((), [event_rows(part)])
    return ReplaySummary(
        "a.tlog", "system 1", 60.0, 600, 1.0, np.zeros(6), None, totals.events, (),
        warnings=tuple(totals.warnings),
    )  # fmt: skip


def printed(capsys: pytest.CaptureFixture[str], *events: EventRow) -> list[str]:
    """The lines that tell of the model."""
    show_replay(summary(*events))
    return [line for line in capsys.readouterr().out.splitlines() if "the model is" in line]


def test_that_a_model_is_right_again_is_told_in_its_place(
    capsys: pytest.CaptureFixture[str],
) -> None:
    events = (WRONG, EXPLAINED, RIGHT, BACK)
    wrong, explained, right = (event.text for event in events[:3])
    assert printed(capsys, *events) == [f"! {wrong}", f"! {explained}", right]
    assert summary(*events).to_dict()["warnings"] == [wrong, explained, right]


def test_of_many_warnings_the_last_of_the_model_is_among_those_that_are_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    many = [
        EventRow(k, k, "model_explained", "warning", f"the model is wrong: {k}") for k in range(20)
    ]
    jump = EventRow(30, 30, "jump", "warning", "the source jumped")
    lines = printed(capsys, *many, RIGHT, jump)
    assert len(lines) == MOST_WARNINGS
    assert lines[0] == "! the model is wrong: 0"
    assert lines[-1] == RIGHT.text
