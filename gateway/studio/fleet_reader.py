"""The table of a fleet for the studio, read and followed in a process of its own."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gateway.errors import BadInput
from gateway.figures.figure_data import FigureData
from gateway.studio.worker import Send, Worker

TABLE = "recordings.parquet"  # the file that is looked at for changes
LOOK_S = 2.0  # between two looks whether `shadow fleet` has written it again


@dataclass(frozen=True)
class FleetView:
    """What the page shows.

    rows      the table's recordings, in order of time, those without one last
    headline  what has changed, what could not be used
    courses   "boat number" -> its course with intervals; what has changed first
    """

    rows: tuple[Mapping[str, Any], ...]
    headline: tuple[str, ...]
    maps: tuple[FigureData, ...]
    courses: Mapping[str, FigureData]


def fleet_task(send: Send, folder: str) -> FleetView:
    """Read the table in a folder; BadInput where there is none."""
    if find_spec("pyarrow") is None:
        raise BadInput("pyarrow: not installed: pip install 'shadow-gateway[fleet]'")
    from gateway.fleet.report import by_time, headline, maps
    from gateway.fleet.table import read_recordings
    from gateway.fleet.wear import wear_of

    send(f"reading {folder}")
    rows, wear = sorted(read_recordings(folder), key=by_time), wear_of(folder)
    numbers = sorted(wear.numbers, key=lambda one: (one.change is None, one.p_value))
    courses = {f"{one.boat}: {one.name}": one.figure for one in numbers}
    return FleetView(tuple(rows), tuple(headline(rows, wear)), tuple(maps(rows)), courses)


@dataclass
class FleetReader:
    """One worker for all pages; reads the table of a folder again when it has changed."""

    folder: Path | None = None
    worker: Worker = field(default_factory=Worker)
    view: FleetView | None = None
    refused: str = ""
    revision: int = 0
    _stamp: int | None = None
    _looked: float = 0.0

    def update(self) -> None:
        """Take what was read; begin anew where the table has changed."""
        for message in self.worker.messages():
            if message.kind == "done":
                self.view, self.refused = message.value, ""
                self.revision += 1
            elif message.kind == "failed":
                self.refused = message.value
                self.revision += 1
        if self.folder is None or self.worker.busy or time.monotonic() - self._looked < LOOK_S:
            return
        self._looked, file = time.monotonic(), self.folder / TABLE
        stamp = file.stat().st_mtime_ns if file.is_file() else -1
        if stamp != self._stamp:
            self._stamp = stamp
            self.worker.start("fleet", fleet_task, str(self.folder))
