"""The command line in tests: run a command, and look at what it left behind."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

SHADOW = [sys.executable, "-c", "from gateway.cli import run; run()"]


class Done(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str


Run = Callable[..., Done]


def strictly(text: str) -> Any:
    """JSON as other languages read it: no NaN, no Infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def one_line(done: Done, status: int, *expected: str) -> str:
    """One line on standard error, nothing on standard output, and that status."""
    assert done.out == ""
    assert done.err.count("\n") == 1, done.err
    assert done.err.startswith("error: ")
    for part in expected:
        assert part in done.err
    assert done.status == status
    return done.err


def command(name: str, source: Path, boat: Path, out: Path) -> list[str | Path]:
    """A command that reads a log, with all that it needs."""
    return {
        "info": ["info", source],
        "init": ["init", source, "--out", out],
        "replay": ["replay", source, "-v", boat, "--out", out, "--no-publish"],
        "compare": ["compare", source, "-v", boat, "--pictures", out],
    }[name]


READERS = ("info", "init", "replay", "compare")
