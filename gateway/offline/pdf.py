"""A report on paper: a browser of this machine prints the HTML page."""

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from gateway.errors import BadInput
from gateway.files import write_whole

# All of one family, which prints without a window; names as their packages install them.
BROWSERS = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge",
    "brave-browser",
)  # fmt: skip
PATIENCE_S = 120.0  # chosen: a page of a few MB takes seconds


def find_browser() -> str:
    """Path of a browser that can print; BadInput where there is none."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        raise BadInput(
            f"--pdf: no browser that prints is here ({', '.join(BROWSERS[:3])} …); leave --pdf out "
            "and print the HTML page from your own browser"
        )
    return found


def print_pdf(page: Path, out: Path) -> None:
    """The HTML file `page` as a PDF, whole or not at all; BadInput where the browser fails."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        made = Path(folder) / "report.pdf"
        # A browser that runs as root has no sandbox; the page is ours, and holds no script.
        root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        command = [
            find_browser(), "--headless", "--disable-gpu", "--no-first-run", *root,
            f"--user-data-dir={Path(folder) / 'profile'}", "--no-pdf-header-footer",
            f"--print-to-pdf={made}", page.resolve().as_uri(),
        ]  # fmt: skip
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE_S, check=False)
        except subprocess.TimeoutExpired:
            raise BadInput(
                f"{out}: {command[0]} did not print the report within {PATIENCE_S:.0f} s"
            ) from None
        if not made.is_file() or not made.read_bytes().startswith(b"%PDF"):
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            raise BadInput(f"{out}: {command[0]} printed nothing: {lines[-1] if lines else ''}")
        write_whole(out, made.read_bytes(), "the report")
