"""Fixtures of all tests of the gateway."""

import sys
from pathlib import Path

import pytest

from gateway import cli
from tests.gateway.command_line import Done, Run


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Run:
    """`shadow` with some words behind it, by its entry point."""

    def shadow(*words: str | Path) -> Done:
        monkeypatch.setattr(sys, "argv", ["shadow", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        status = ended.value.code
        return Done(status if isinstance(status, int) else 0, *capfd.readouterr())

    return shadow
