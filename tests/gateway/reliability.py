"""What a fault did to a running gateway, for the table in docs/reliability.md.

Each test of `pipelines/test_reliability.py` notes one row; `python -m benchmarks.reliability` runs
them and writes the table.
"""

import json
import os
from pathlib import Path
from typing import NamedTuple

ROWS = "RELIABILITY_ROWS"  # environment: the file that rows are appended to; nothing without


class Row(NamedTuple):
    """One fault: how it is injected, what the gateway says, and what it cost [s]."""

    fault: str
    injected: str
    shadow: str  # goes on, or why not
    says: str
    lost_s: float  # of the recording
    back_s: float  # from the end of the fault until all is as before


MAX_LOST_S, MAX_BACK_S = 1.0, 5.0


def note(row: Row) -> None:
    """Hold the row against the limits, and write it down where that is asked for."""
    assert 0.0 <= row.lost_s <= MAX_LOST_S, row
    assert 0.0 <= row.back_s <= MAX_BACK_S, row
    if ROWS in os.environ:
        with Path(os.environ[ROWS]).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row._asdict(), ensure_ascii=False) + "\n")
