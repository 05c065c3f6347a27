"""The line that says what is being done; what is worth keeping stays on the screen."""

import io

import pytest
from rich.console import Console

import gateway.terminal
from gateway.terminal import status_line


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
