"""The report on paper: printed by a browser, and a clear line where there is none."""

import re
import shutil
from pathlib import Path

import pytest

from gateway.errors import BadInput
from gateway.offline import report
from tests.gateway.studio.browser import chromium

PAGE = "<!DOCTYPE html><title>t</title><h1>One</h1><h1 style='break-before: page'>Two</h1>"


def page_in(folder: Path) -> Path:
    page = folder / "a report.html"
    page.write_text(PAGE)
    return page


def script(folder: Path, name: str, text: str) -> None:
    """A program of that name, before all others."""
    file = folder / name
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)


def test_without_a_browser_one_line_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(BadInput, match="print the HTML page from your own browser"):
        report.find_browser()


def test_a_browser_that_prints_nothing_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script(tmp_path, "chromium", "echo 'no display' >&2; exit 0")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    with pytest.raises(BadInput, match="printed nothing: no display"):
        report.print_pdf(page_in(tmp_path), tmp_path / "out.pdf")
    assert not (tmp_path / "out.pdf").exists()


def test_a_browser_that_hangs_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "PATIENCE_S", 0.2)
    script(tmp_path, "chromium", f"exec {shutil.which('sleep')} 30")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    with pytest.raises(BadInput, match="did not print the report within"):
        report.print_pdf(page_in(tmp_path), tmp_path / "out.pdf")


@pytest.mark.alone
def test_two_pages_are_printed(tmp_path: Path) -> None:
    chromium()
    out = tmp_path / "out.pdf"
    report.print_pdf(page_in(tmp_path), out)
    made = out.read_bytes()
    assert made.startswith(b"%PDF")
    assert len(re.findall(rb"/Type ?/Page\b", made)) == 2
