"""`shadow fleet`: recordings as tasks on Dask -> the table.

    find → digest → what is known already → analyse → table

The workers may be anywhere that sees the same paths: nothing here depends on the kind of cluster.

What has been worked out already stands in a file beside the table, one line a recording:

    key = SHA-256 of the content of the recording, SHA-256 of the settings and the vessel file

Lines are added as results come in, and nothing else is ever done to the file: a run that was killed
goes on after the last whole one. A recording whose content and settings have not changed is not run
again, wherever it lies now.
"""

import hashlib
import json
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import dask
from distributed import CancelledError, Client, Future, KilledWorker, LocalCluster, as_completed

from gateway.errors import BadInput, ShadowError, counted, printable
from gateway.fleet import Boat, boat_of, digest, find_recordings, stamp
from gateway.fleet.analysis import (
    DUPLICATE,
    FAILED,
    FAULT,
    LASTING,
    Analysis,
    AnalysisSettings,
    Row,
    Task,
    analyse,
)
from gateway.fleet.table import SCHEMA_VERSION, recordings_of_table, write_table

RESULTS_FILE = "results.jsonl"


def settings_digest(boat: Boat, settings: AnalysisSettings) -> str:
    """Of all that a result depends on beside the recording: files by their content."""
    files = [boat.vessel_file, *settings.effects, *([boat.mapping] if boat.mapping else [])]
    try:
        contents = [hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in files]
    except OSError as error:
        raise BadInput(f"{error.filename}: cannot read it: {error.strerror}") from None
    depends = {
        "schema": SCHEMA_VERSION, "version": version("shadow-gateway"), "system": boat.system,
        "files": contents, **asdict(settings),
        "effects": len(settings.effects),  # by content, wherever they lie
    }  # fmt: skip
    return hashlib.sha256(json.dumps(depends, sort_keys=True).encode()).hexdigest()


class ResultStore:
    """The results of a fleet's folder, and the digests of local files that have not changed."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / RESULTS_FILE
        self._results: dict[tuple[str, str], Analysis] = {}
        self._digests: dict[str, tuple[str, str]] = {}
        for line in _lines(self._file):
            if "stamp" in line:
                self._digests[line["recording"]] = (line["stamp"], line["sha256"])
            else:
                found = Analysis(line["row"], tuple(line["estimates"]))
                self._results[line["sha256"], line["settings"]] = found

    def known_digest(self, recording: str) -> str | None:
        """Of a local file with the size and time of change that it had when it was read."""
        now, content = self._digests.get(recording, (None, None))
        return content if now is not None and now == stamp(recording) else None

    def note_digests(self, digests: Mapping[str, str]) -> None:
        """Keep digests of local files for the next run."""
        for recording, content in digests.items():
            now = stamp(recording)
            if now and content:
                self._append({"recording": recording, "stamp": now, "sha256": content})

    def get(self, content: str, settings: str) -> Analysis | None:
        """What came of this content under these settings; None where it was not run."""
        return self._results.get((content, settings)) if content else None

    def put(self, content: str, settings: str, found: Analysis) -> None:
        """Keep what would be the same another time."""
        if content and found.row["state"] in LASTING:
            self._append({"sha256": content, "settings": settings, **asdict(found)})

    def _append(self, entry: Mapping[str, Any]) -> None:
        """One line more; a line that was cut off before it stays a line of its own."""
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open("ab+") as stream:
                stream.seek(-1, 2) if stream.tell() else None
                cut = stream.read(1) not in (b"", b"\n")
                stream.write(b"\n" * cut + json.dumps(entry).encode() + b"\n")
        except OSError as error:
            raise ShadowError(f"{self._file}: cannot write a result: {error.strerror}") from None


def _lines(file: Path) -> Iterator[dict[str, Any]]:
    """The whole lines of the file; one that was cut off is left out."""
    try:
        lines = file.read_bytes().splitlines()
    except FileNotFoundError:
        return
    except OSError as error:
        raise BadInput(f"{file}: cannot read earlier results: {error.strerror}") from None
    for line in lines:
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        if isinstance(entry, dict):
            yield entry


SAVE_S = 30.0  # the table is written so often while work goes on; chosen, not measured
CONNECT_S = 20.0  # that a scheduler may take to answer


@dataclass(frozen=True)
class Progress:
    """Where a run stands: recordings that have their row, by work of this run (`worked`) or not.

    last  the row that came in last
    """

    done: int
    total: int
    worked: int
    failed: int
    seconds: float
    last: Row

    @property
    def seconds_left(self) -> float | None:
        """At the speed so far; None before the first is worked out."""
        return self.seconds / self.worked * (self.total - self.done) if self.worked else None


@dataclass
class FleetResult:
    """All rows; `known` of them were worked out on an earlier run.

    unused  boats that none of the recordings is of
    dropped  recordings of the table before that were not named this time
    """

    folder: Path
    rows: dict[str, Row] = field(default_factory=dict)
    estimates: dict[str, tuple[Row, ...]] = field(default_factory=dict)
    known: int = 0
    unused: Sequence[Boat] = ()
    dropped: Sequence[str] = ()

    @property
    def nothing_done(self) -> bool:
        """Did every recording fail?"""
        return bool(self.rows) and all(r["state"] in (FAILED, FAULT) for r in self.rows.values())

    def add(self, recording: str, row: Row, estimates: Sequence[Row] = ()) -> None:
        """Put a recording's row in, and its estimates."""
        shared = {key: row.get(key) for key in ("recording", "sha256", "boat", "started")}
        self.rows[recording] = row
        self.estimates[recording] = tuple(shared | dict(one) for one in estimates)

    def save(self) -> None:
        """Write the table of what there is."""
        names = sorted(self.rows)
        write_table(
            self.folder,
            [self.rows[name] for name in names],
            [one for name in names for one in self.estimates[name]],
        )


@contextmanager
def connected(scheduler: str | None, workers: int | None) -> Iterator[Client]:
    """A client of an existing scheduler, or of a cluster of this machine's that ends with it."""
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise ShadowError(f"{scheduler}: no Dask scheduler answers there: {error}") from None
        with client:
            yield client
        return
    with local_cluster(workers) as cluster, Client(cluster) as client:
        yield client


def local_cluster(workers: int | None = None, processes: bool = True) -> LocalCluster:
    """Workers on this machine, default one a core; nothing of it listens to other machines.

    One thread each: numpy and the compiled kernels are what works, not waiting. Dask's profiler is
    off: it wakes a hundred times a second and keeps what it sees, megabytes a minute.
    """
    with dask.config.set({"distributed.worker.profile.enabled": False}):
        return LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=processes, host="127.0.0.1",
            protocol="tcp", silence_logs=logging.CRITICAL, dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
        )  # fmt: skip


def run_fleet(
    named: Sequence[str],
    boats: Sequence[Boat],
    folder: Path,
    settings: AnalysisSettings,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    retry: bool = False,
    progress: Callable[[Progress], None] = lambda _: None,
    interrupted: Callable[[int, int], None] = lambda done, total: None,
) -> FleetResult:
    """Every recording once; the table is whole whenever this ends, also by an interrupt.

    `interrupted`: called then, with how many of how many recordings are in the table.

    `retry`: what failed on an earlier run is run again.
    """
    recordings = find_recordings(named)
    sailed = {recording: boat_of(recording, boats) for recording in recordings}
    asked = {boat: settings_digest(boat, settings) for boat in boats}
    store, result = ResultStore(folder), FleetResult(folder)
    result.unused = [boat for boat in boats if boat not in sailed.values()]
    result.dropped = sorted(recordings_of_table(folder) - set(map(printable, recordings)))
    with connected(scheduler, workers) as client:
        digests = _digests(client, store, recordings)
        run = _Run(result, store, digests, sailed, asked, len(recordings), progress)
        try:
            tasks = [Task(r, boat, settings) for r in recordings if (boat := run.open(r, retry))]
            run.work_through(client, tasks)
        except KeyboardInterrupt:
            interrupted(len(result.rows), len(recordings))
            raise
        finally:
            result.save()
    return result


def _digests(client: Client, store: ResultStore, recordings: Sequence[str]) -> dict[str, str]:
    """Content of every recording, read where the work will be."""
    known = {r: d for r in recordings if (d := store.known_digest(r)) is not None}
    new = [r for r in recordings if r not in known]
    try:
        found = dict(zip(new, client.gather(client.map(digest, new, pure=False)), strict=True))
    except (KilledWorker, CancelledError, OSError) as error:
        raise ShadowError(f"the cluster could not read the recordings: {error}") from None
    store.note_digests(found)
    return known | found


@dataclass
class _Run:
    """The state of one run."""

    result: FleetResult
    store: ResultStore
    digests: Mapping[str, str]
    sailed: Mapping[str, Boat | None]
    asked: Mapping[Boat, str]
    total: int
    progress: Callable[[Progress], None]
    worked: int = 0
    failed: int = 0
    begun: float = field(default_factory=time.monotonic)
    first: dict[tuple[str, str], str] = field(default_factory=dict)

    def open(self, recording: str, retry: bool) -> Boat | None:
        """The boat of a recording that has to be worked through; None where its row is clear."""
        boat, content = self.sailed[recording], self.digests[recording]
        if boat is None:
            self._add(recording, {"state": FAILED, "why": "no entry of the fleet file names it"})
            return None
        original = self.first.setdefault((content, boat.name), recording)
        if content and original != recording:
            self._add(recording, {"state": DUPLICATE, "why": f"the same as {original}"})
            return None
        known = self.store.get(content, self.asked[boat])
        if known is None or (retry and known.row["state"] == FAILED):
            return boat
        self.result.known += 1
        self._add(recording, known.row, known.estimates)
        return None

    def work_through(self, client: Client, tasks: Sequence[Task]) -> None:
        """Analyse, and keep each result as it comes in."""
        task_of = dict(zip(client.map(analyse, tasks, pure=False), tasks, strict=True))
        saved = time.monotonic()
        for future in as_completed(list(task_of)):
            task = task_of.pop(future)  # a worker keeps a result as long as somebody holds it
            found = _outcome(future, client, len(task_of) + 1)
            boat, content = task.boat, self.digests[task.recording]
            self.store.put(content, self.asked[boat], found)
            self.worked += 1
            self._add(task.recording, found.row, found.estimates)
            if time.monotonic() - saved > SAVE_S:
                self.result.save()
                saved = time.monotonic()

    def _add(self, recording: str, row: Row, estimates: Sequence[Row] = ()) -> None:
        boat = self.sailed[recording]
        whole = {
            "recording": recording, "sha256": self.digests[recording],
            "boat": boat.name if boat else None, "vessel_file": boat.vessel_file if boat else None,
        } | row  # fmt: skip
        # a table is Unicode, and names of files need not be
        whole = {key: printable(v) if isinstance(v, str) else v for key, v in whole.items()}
        self.result.add(recording, whole, estimates)
        self.failed += row["state"] in (FAILED, FAULT)
        self.progress(
            Progress(
                len(self.result.rows), self.total, self.worked, self.failed,
                time.monotonic() - self.begun, whole,
            )
        )  # fmt: skip


def _outcome(future: Future[Any], client: Client, left: int) -> Analysis:
    """What a task gave; a row where its worker died, ShadowError where the scheduler is gone."""
    if future.status == "finished":
        found: Analysis = future.result()
        return found
    if future.status == "error":
        error = future.exception()
        return Analysis(
            {"state": FAULT, "why": f"its worker died: {type(error).__name__}: {error}"}
        )
    raise ShadowError(
        f"{client.scheduler.address if client.scheduler else 'the scheduler'}: the Dask scheduler "
        f"is gone: {counted(left, 'recording')} left; the same command goes on"
    )
