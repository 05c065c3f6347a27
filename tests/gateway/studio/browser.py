"""A real browser, and what it noticed: mistakes on the console, requests beyond the server."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import pytest

ROOT = Path(__file__).resolve().parents[3]
SHOTS = ROOT / "out/screenshots"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-features=LocalNetworkAccessChecks",  # a page that a test hands out may connect
)  # fmt: skip
PATIENCE_MS = 120_000  # a machine may be busy with other things
EMPTY = "could not set initial ranges"  # Bokeh, of pictures that wait for their first data
HARMLESS = ("log", "info", "debug")


def chromium() -> str:
    """Where it is. `make test-slow` installs it where it can, and then it may not be missing."""
    if CHROMIUM is None:
        if os.environ.get("SHADOW_BROWSER") == "required":
            pytest.fail("no Chromium: make test-slow should have installed it")
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    return CHROMIUM


class Watched:
    """A page of the browser and all that went wrong on it."""

    def __init__(self, page: Any, host: str) -> None:
        self.page, self.wrong, self.beyond = page, [], []
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", self._said)
        page.on("pageerror", lambda error: self.wrong.append(str(error)))
        page.on("request", lambda request: self._asked(request.url, host))

    def _said(self, message: Any) -> None:
        if message.type not in HARMLESS and EMPTY not in message.text:
            self.wrong.append(f"{message.type}: {message.text}")

    def _asked(self, url: str, host: str) -> None:
        where = urlparse(url)
        if where.scheme not in ("data", "blob", "file") and where.netloc != host:
            self.beyond.append(url)

    def shot(self, name: str) -> None:
        """A picture of the whole page for people to look at."""
        SHOTS.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=SHOTS / f"{name}.png", full_page=True)

    def until_none(self, look: Callable[[], Any]) -> None:
        """The page gets the time until nothing is left of what `look` finds."""
        end = time.monotonic() + PATIENCE_MS / 1000.0
        while left := look():
            assert time.monotonic() < end, left
            self.page.wait_for_timeout(200)

    def is_clean(self) -> None:
        """Nothing went wrong and nothing was asked of anybody else."""
        assert self.wrong == [], self.wrong
        assert self.beyond == []


@contextmanager
def running(*command: str, until: str, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """`shadow COMMAND` until the block ends; it has said `until` before the block begins."""
    with log.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-c", "from gateway.cli import run; run()", *command],
            cwd=ROOT, stdout=file, stderr=file,
        )  # fmt: skip
    try:
        end = time.monotonic() + 180.0
        while until not in log.read_text(errors="replace"):
            assert process.poll() is None, log.read_text(errors="replace")
            assert time.monotonic() < end, log.read_text(errors="replace")
            time.sleep(0.1)
        yield process
    finally:
        process.terminate()
        process.wait(20.0)
