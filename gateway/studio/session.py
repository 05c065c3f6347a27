"""The session: what is being worked on, shared by all pages of one studio and kept over reloads.

Pages change the session and look at it a few times a second. The work is done by two workers: a
quick one that compares after every change, and one for what takes a minute.
"""

import time
import tomllib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tomli_w

from gateway.errors import BadInput
from gateway.figures.diagnosis import LadderBar
from gateway.files import write_whole
from gateway.ingest.survey import Survey
from gateway.studio import tasks
from gateway.studio.access import Folders
from gateway.studio.tasks import DiagnosisView, LadderView, TrialView
from gateway.studio.worker import JobMessage, Worker
from gateway.vessel_file import read_vessel_file

GIVEN, NOW = "as given", "now"
UPDATE_S = 0.05  # between two looks at the workers, however many pages are open


@dataclass(frozen=True)
class Version:
    """The vessel at one moment: its file's text, the effects added, the ladder climbed so far."""

    text: str
    effects: tuple[str, ...] = ()
    ladder: tuple[LadderBar, ...] = ()
    change: str = GIVEN


@dataclass
class Session:
    """Recordings, vessel and answers; `revision` counts the changes of each kind.

    Kinds: vessel, logs, trials, diagnosis, surveys, report, files, notice.
    """

    folders: Folders
    logs: tuple[Path, ...]
    vessel_file: Path | None
    effect_files: tuple[str, ...] = ()
    quick: Worker = field(default_factory=Worker)
    slow: Worker = field(default_factory=Worker)
    versions: list[Version] = field(default_factory=list)
    trials: tuple[TrialView, ...] = ()
    diagnosis: DiagnosisView | None = None
    surveys: dict[str, Survey] = field(default_factory=dict)
    notice: str = ""
    good: bool = False
    learn_from: tuple[Path, ...] = ()
    report: str = ""
    revision: Counter[str] = field(default_factory=Counter)
    _stale: bool = False
    _updated: float = 0.0
    _done: Callable[[Any], None] | None = None

    def __post_init__(self) -> None:
        if self.vessel_file is not None:
            self.set_vessel(self.vessel_file)

    # what pages change

    def set_vessel(self, path: Path) -> None:
        """Begin with a vessel file."""
        file = self.folders.checked(path)
        text, effect_files = _portable(file)
        self.effect_files = tuple(dict.fromkeys((*self.effect_files, *effect_files)))
        tasks.vessel_of(text, tasks.effects_in(self.effect_files))  # raises where it has a mistake
        self.slow.cancel()  # an answer about another vessel is no longer wanted
        self.vessel_file, self.versions = file, [Version(text)]
        self.diagnosis = None
        self._changed("vessel", "diagnosis")

    def set_logs(self, paths: Sequence[Path]) -> None:
        """Work on these recordings."""
        self.logs = tuple(self.folders.checked(path) for path in paths)
        self.slow.cancel()
        self.learn_from = tuple(p for p in self.learn_from if p in self.logs)
        self.trials, self.diagnosis = (), None
        self._changed("trials", "diagnosis", "logs")

    @property
    def version(self) -> Version | None:
        """The vessel as it is now."""
        return self.versions[-1] if self.versions else None

    def slide(self, text: str, change: str) -> None:
        """A number changes by a slider: one step back undoes the whole slide."""
        now = self.versions[-1]
        if now.change == change:
            self.versions.pop()
        self.versions.append(Version(text, now.effects, now.ladder, change))
        self._changed("vessel")

    def undo(self) -> None:
        """Back to the vessel before."""
        if len(self.versions) > 1:
            self.versions.pop()
            self._changed("vessel")

    def climb(self, step: LadderView) -> None:
        """Add what a step adds, or put it in the place of another: its vessel, and its bar."""
        assert self.diagnosis is not None
        before = self.diagnosis.before
        bars = [s.bar for s in self.diagnosis.up_to(step)]
        earlier = [v.ladder for v in self.versions if v.effects == before]
        ladder = (*earlier[0], *bars[1:]) if before and earlier else tuple(bars)
        name = step.effects[-1].replace("_", " ") if step.effects else "re-fitted base"
        self.versions.append(Version(step.text, (*before, *step.effects), ladder, f"+ {name}"))
        self._changed("vessel")

    def save(self, name: str) -> Path:
        """The vessel as a file in the folder of results."""
        if self.version is None:
            raise BadInput("there is no vessel to save yet")
        file = self.folders.to_save(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, self.version.text.encode(), "the vessel file")
        self._changed("files")
        return file

    def notify(self, text: str, good: bool = False) -> None:
        """A line on all pages."""
        self.notice, self.good = text, good
        self.revision["notice"] += 1

    # work

    def start(
        self, job: str, task: Callable[..., Any], *arguments: Any, done: Callable[[Any], None]
    ) -> None:
        """Begin `task(send, *arguments)` in a process of its own; `done` takes its result.

        RuntimeError while another job of this kind is under way.
        """
        self.slow.start(job, task, *arguments)
        self._done = done

    def diagnose(self) -> None:
        """Look for what the vessel lacks, from the recordings chosen for that."""
        if self.version is None or not self.logs:
            raise BadInput("choose a recording and a vessel file first")
        logs = [str(path) for path in self.learn_from or self.logs[:1]]
        before = self.version.effects

        def done(diagnosis: DiagnosisView) -> None:
            self.diagnosis = replace(diagnosis, before=before)
            self._changed("diagnosis")

        self.start("diagnose", tasks.diagnose_task, logs, self.version.text, self.effect_files,
                   done=done)  # fmt: skip
        self.diagnosis = None
        self._changed("diagnosis")

    def write_report(self) -> None:
        """Write an HTML report of the comparison and of the diagnosis if there is one."""
        out = self.folders.write / time.strftime("report-%Y%m%d-%H%M%S.html")

        def done(file: str) -> None:
            self.report = file
            self._changed("report")

        self.start("report", tasks.report_task, [str(p) for p in self.logs], self.vessels(),
                   self.effect_files, str(out), self.diagnosis is not None, done=done)  # fmt: skip

    def survey(self, path: Path) -> None:
        """Find out what is in a recording."""

        def done(found: Survey) -> None:
            self.surveys[found.path] = found
            self._changed("surveys")

        self.start("look", tasks.survey_task, str(self.folders.checked(path)), done=done)

    def vessels(self) -> list[tuple[str, str]]:
        """The vessels to compare: as given, and as it is now where that is another."""
        if not self.versions:
            return []
        first, last = self.versions[0], self.versions[-1]
        return [(GIVEN, first.text)] + ([(NOW, last.text)] if last.text != first.text else [])

    def update(self) -> None:
        """Take what the workers have; begin the next comparison where something changed."""
        if time.monotonic() - self._updated < UPDATE_S:
            return
        self._updated = time.monotonic()
        for message in self.quick.messages():
            self._compared(message)
        for message in self.slow.messages():
            if message.kind == "failed":
                self.notify(message.value)
            elif message.kind == "done" and self._done is not None:
                self._done(message.value)
        if self._stale and not self.quick.busy and self.logs and self.versions:
            self._stale = False
            self.quick.start("compare", tasks.compare_task, [str(p) for p in self.logs],
                             self.vessels(), self.effect_files)  # fmt: skip

    def cancel(self) -> None:
        """Stop what takes long."""
        if self.slow.busy:
            self.notify(f"cancelled: {self.slow.job}")
            self.slow.cancel()

    def close(self) -> None:
        """End the workers."""
        self.quick.cancel()
        self.slow.cancel()

    def _compared(self, message: JobMessage) -> None:
        if message.kind == "part":
            if message.value.name not in {t.name for t in self.trials}:
                self.trials = (*self.trials, message.value)
                self._changed("trials")
        elif message.kind == "done":
            self.trials = message.value
            self._changed("trials")
        elif message.kind == "failed":
            self.notify(message.value)

    def _changed(self, *kinds: str) -> None:
        """Count changes; a comparison of what was before is no longer wanted."""
        self.revision.update(kinds)
        if {"vessel", "logs"} & set(kinds):
            self._stale = True


def _portable(file: Path) -> tuple[str, tuple[str, ...]]:
    """The text of a vessel file without paths that hold only where it lies, and those paths."""
    text = file.read_text(encoding="utf-8")
    entries = read_vessel_file(file).effects
    paths = tuple(str(file.parent / str(e["file"])) for e in entries if "file" in e)
    if not paths:
        return text, ()
    tables = tomllib.loads(text)
    for entry in tables["effects"]:
        entry.pop("file", None)
    return tomli_w.dumps(tables), paths


def with_values(version: Version, values: dict[str, float]) -> str:
    """A version's file with other numbers, by key: `m11`, or `EFFECT.PARAMETER`."""
    tables = tomllib.loads(version.text)
    for key, value in values.items():
        effect, _, name = key.rpartition(".")
        if not effect:
            tables["dynamics"][name] = value
        for entry in tables.get("effects", []):
            if entry["type"] == effect:
                entry[name] = value
        tables.get("provenance", {}).pop(f"dynamics.{name}" if not effect else key, None)
    return tomli_w.dumps(tables)
