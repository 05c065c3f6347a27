"""Faults at the real boundary, one test each, and the table that they write.

    python -m benchmarks.reliability [FILE]      default docs/reliability.md

Runs tests/gateway/pipelines/test_reliability.py and puts its rows between the marks of the page.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.gateway.reliability import ROWS, Row

PAGE = Path("docs/reliability.md")
TESTS = "tests/gateway/pipelines/test_reliability.py"
BEGIN, END = "<!-- table: python -m benchmarks.reliability -->", "<!-- end of table -->"


def table(rows: list[Row]) -> str:
    """Rows as a table in Markdown."""
    head = (
        "| fault | injected by | the shadow | it says | recording lost | back after |\n"
        "|---|---|---|---|---|---|"
    )
    lines = [
        f"| {r.fault} | {r.injected} | {r.shadow} | {r.says} "
        f"| {r.lost_s:.1f} s | {r.back_s:.1f} s |"
        for r in rows
    ]
    return "\n".join([head, *lines])


def with_table(page: str, text: str) -> str:
    """The page with another table between its marks."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{text}\n\n{END}{after}"


def main() -> int:
    """Run the tests, write the table; the tests' exit status."""
    page = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    with tempfile.TemporaryDirectory() as folder:
        found = Path(folder) / "rows.jsonl"
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:randomly", TESTS],
            env={**os.environ, ROWS: str(found)}, check=False,
        )  # fmt: skip
        lines = found.read_text(encoding="utf-8").splitlines() if found.exists() else []
    rows = [Row(**json.loads(line)) for line in lines]
    page.write_text(with_table(page.read_text(encoding="utf-8"), table(rows)), encoding="utf-8")
    print(f"{len(rows)} rows written to {page}")
    return done.returncode


if __name__ == "__main__":
    raise SystemExit(main())
