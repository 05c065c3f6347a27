"""Long work in a process of its own: it reports progress, fails in a sentence, and is cancelled
at any moment by ending the process. The page and a live shadow beside it keep their rate.

Two such processes read in the background: cards that say what is in each recording, one after the
other, and a fleet's table, which is followed.
"""

import multiprocessing
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from importlib.util import find_spec
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np

from gateway.errors import BadInput, ShadowError
from gateway.figures import FigureData
from gateway.files import stamp_of
from gateway.ingest.mapping import moment_of
from gateway.ingest.open import open_log
from gateway.ingest.survey import Survey, survey
from gateway.long_running import HANGUP
from gateway.offline.trials import FIRST_LOOK, trials_of
from sim.effects.effect import LawError
from sim.state import Eta, Floats

Send = Callable[[Any], None]  # takes a line of progress, or a part of the result
NICE = 5  # steps of lower priority: a live shadow on this machine goes first
GONE = "the work ended without an answer (out of memory?): try again with fewer recordings"
BUG = "the studio has a fault here; its log says more"


@dataclass(frozen=True)
class JobMessage:
    """A message of a job: a line of progress, a part, the result, or why there is none."""

    job: str
    kind: Literal["progress", "part", "done", "failed"]
    value: Any


class Worker:
    """One process that does one job at a time; started when there is a job."""

    def __init__(self) -> None:
        self._process: Any = None
        self._connection: Connection | None = None
        self.job: str | None = None
        self.progress = ""
        self._since = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self.cancel()

    @property
    def busy(self) -> bool:
        """Is there a job under way?"""
        return self.job is not None

    @property
    def seconds(self) -> float:
        """Time for which the job has been under way [s]."""
        return time.monotonic() - self._since if self.busy else 0.0

    def start(self, job: str, task: Callable[..., Any], *arguments: Any) -> None:
        """Begin a job; `task(send, *arguments)` is a module-level function."""
        if self.busy:
            raise RuntimeError(f"busy with {self.job}: wait for it, or press Cancel")
        if self._process is None or not self._process.is_alive():
            self._begin()
        assert self._connection is not None
        self.job, self.progress, self._since = job, "starting", time.monotonic()
        self._connection.send((task, arguments))

    def messages(self) -> list[JobMessage]:
        """Messages that have come since the last call; never waits."""
        out: list[JobMessage] = []
        while self.busy and self._connection is not None:
            try:
                if not self._connection.poll():
                    break
                kind, value = self._connection.recv()
            except (EOFError, OSError):
                kind, value = "failed", GONE
                self._forget()
            out.append(JobMessage(str(self.job), kind, value))
            if kind == "progress":
                self.progress = value
            elif kind in ("done", "failed"):
                self.job = None
        return out

    def cancel(self) -> None:
        """End the process, whatever it does; the next job begins a new one."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join(2.0)
            if self._process.is_alive():
                self._process.kill()
        self._forget()
        self.job = None

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        self._process = context.Process(target=serve_jobs, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self._connection = ours

    def _forget(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


def serve_jobs(connection: Connection) -> None:
    """The other process: jobs come in, messages go out, until the connection ends."""
    for number in filter(None, (signal.SIGINT, HANGUP)):
        signal.signal(number, signal.SIG_IGN)  # Ctrl-C and a closed window are the studio's
    if hasattr(os, "nice"):
        os.nice(NICE)

    def send(value: Any) -> None:
        connection.send(("progress" if isinstance(value, str) else "part", value))

    while True:
        try:
            task, arguments = connection.recv()
        except (EOFError, OSError):
            return
        connection.send(outcome(task, arguments, send))


def outcome(task: Callable[..., Any], arguments: Any, send: Send) -> tuple[str, Any]:
    """`done` and the result, or `failed` and one line; a traceback goes to the log alone."""
    try:
        return "done", task(send, *arguments)
    except (ShadowError, LawError) as error:
        return "failed", " ".join(str(error).split())
    except Exception as error:  # the outermost loop of this process
        print(traceback.format_exc(), file=sys.stderr, flush=True)
        return "failed", f"{BUG} ({type(error).__name__})"


def file_stamp(path: str) -> tuple[int, ...]:
    """Size and time of the last change of a file that was given; BadInput where it is gone."""
    stamp = stamp_of(Path(path))
    if stamp is None:
        raise BadInput(f"{Path(path).name} is no longer there ({path})")
    return tuple(stamp)


POINTS = 200  # of a small track
WIDTH, HEIGHT, EDGE = 150, 90, 6  # px of it
MOST_RATES = 8  # messages whose rates are shown


@dataclass(frozen=True)
class CardView:
    """A recording: what is in it, and of its trials the first time [ns], place, usable time [s] and
    track (n, 2) east, north [m]; `why_not`: why none of it can be used."""

    survey: Survey
    start_time_ns: int = 0
    origin_deg: tuple[float, float] | None = None
    usable_s: float = 0.0
    track: Floats = field(default_factory=lambda: np.empty((0, 2)))
    why_not: str = ""


def card_task(send: Send, path: str, mapping: str | None = None) -> CardView:
    """Read a recording for its card."""
    log = open_log(path, mapping)
    found = survey(log)
    try:
        trials = trials_of(log, replace(FIRST_LOOK, mapping=mapping))
    except ShadowError as error:
        return CardView(found, why_not=" ".join(str(error).split()))
    track = np.concatenate([trial.eta[:, [Eta.EAST, Eta.NORTH]] for trial in trials])
    return CardView(
        found, trials[0].start_time_ns, trials[0].origin_deg,
        sum(float(trial.usable.sum()) * trial.dt for trial in trials),
        track[:: max(len(track) // POINTS, 1)],
    )  # fmt: skip


@dataclass
class CardReader:
    """A worker of its own and the cards it has read; `refused`: path -> why there is none.

    A file that takes the place of one that was read, or has grown, is read anew.
    """

    worker: Worker = field(default_factory=Worker)
    cards: dict[str, CardView] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    _wanted: list[str] = field(default_factory=list)
    _reading: str = ""
    _stamps: dict[str, list[int] | None] = field(default_factory=dict)  # of files, as they are read

    def want(self, paths: Sequence[Path]) -> None:
        """Read those that were not read yet as they are now, in this order."""
        for path in paths:
            name = str(path)
            is_read = name in self._stamps and self._stamps[name] == stamp_of(path)
            if not is_read and name not in self._wanted:
                self.cards.pop(name, None)
                self.refused.pop(name, None)
                self._wanted.append(name)

    def is_waiting(self, path: str) -> bool:
        """Whether a recording will be read, or is being read."""
        return path in self._wanted or path == self._reading

    def update(self, mapping: str | None) -> bool:
        """Take what was read, begin the next; whether there is something new."""
        news = False
        for message in self.worker.messages():
            if message.kind == "done":
                self.cards[self._reading] = message.value
            elif message.kind == "failed":
                self.refused[self._reading] = message.value
            if message.kind in ("done", "failed"):
                self._reading, news = "", True
        if self._wanted and not self.worker.busy:
            self._reading = self._wanted.pop(0)
            self._stamps[self._reading] = stamp_of(Path(self._reading))
            self.worker.start("look", card_task, self._reading, mapping)
            news = True
        return news


def card_text(path: str, label: str, reader: CardReader) -> str:
    """A recording in words with its track, or why there is none, as HTML; `label`: its name."""
    name = f"<h3>{escape(label)}</h3>"
    view = reader.cards.get(path)
    if view is None:
        why = reader.refused.get(path)
        waiting = "<p class='faint'>being read …</p>" if reader.is_waiting(path) else ""
        return name + (f"<p class='warn'>{escape(why)}</p>" if why else waiting)
    found = view.survey
    boats = "; ".join(escape(f"{b.boat} {b.firmware}".strip()) for b in found.boats) or "no boat"
    fastest = sorted(found.messages.items(), key=lambda item: -item[1].rate_hz)[:MOST_RATES]
    rates = ", ".join(f"{escape(name)} {message.rate_hz:.1f} Hz" for name, message in fastest)
    warnings = [note for boat in found.boats for note in boat.notices]
    warnings += [view.why_not] if view.why_not else []
    notes = "".join(f"<p class='warn'>{escape(note)}</p>" for note in warnings)
    limits = "".join(f"<li>{escape(text)}</li>" for boat in found.boats for text in boat.good_for)
    return (
        f"{name}<p>{_when_and_where(view)}{_minutes(found.seconds)}, "
        f"<strong>{_minutes(view.usable_s)} usable</strong></p>{track_svg(view.track)}"
        f"<p class='faint'>{escape(found.kind)}, {found.statistics.size_bytes / 1e6:.1f} MB; "
        f"{boats}</p>{notes}<details><summary>What it is good for</summary><ul>{limits}</ul>"
        f"<p class='faint'>{rates}</p></details>"
    )


def _minutes(seconds: float) -> str:
    return f"{seconds / 60.0:.0f} min" if seconds >= 120.0 else f"{seconds:.0f} s"


def _when_and_where(view: CardView) -> str:
    """Date and place, as far as the recording knows them."""
    when = moment_of(view.start_time_ns * 1e-9)
    parts = [] if when is None else [f"{when:%d %b %Y %H:%M} UTC"]
    if view.origin_deg is not None:
        lat, lon = view.origin_deg
        parts.append(f"{abs(lat):.3f}° {'NS'[lat < 0]}, {abs(lon):.3f}° {'EW'[lon < 0]}")
    return "".join(f"{part}<br>" for part in parts)


def track_svg(track: Floats) -> str:
    """A track (n, 2) east, north [m] as a small picture, north up; empty without any motion."""
    size = float(np.ptp(track, axis=0).max()) if len(track) > 1 else 0.0
    if not size > 0.0:
        return ""
    scale = min((WIDTH - 2 * EDGE) / max(float(np.ptp(track[:, 0])), 1e-9),
                (HEIGHT - 2 * EDGE) / max(float(np.ptp(track[:, 1])), 1e-9))  # fmt: skip
    x = EDGE + scale * (track[:, 0] - track[:, 0].min())
    y = HEIGHT - EDGE - scale * (track[:, 1] - track[:, 1].min())
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return (f'<svg width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="track, {size:.0f} m '
            f'wide"><polyline points="{points}" fill="none" stroke="var(--accent)" '
            'stroke-width="2"/></svg>')  # fmt: skip


TABLE = "recordings.parquet"  # the file that is looked at for changes
LOOK_S = 2.0  # between two looks whether `shadow fleet` has written it again


@dataclass(frozen=True)
class FleetView:
    """The table of a fleet as the page shows it.

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
