"""The desk: what is being worked on, shared by all pages of one studio, so that none is lost.

Pages change the desk and look at it a few times a second; the work is done by two workers, a quick
one that compares after every change and one for what takes a minute.
"""

import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tomli_w

from gateway.atomic_file import write_whole
from gateway.errors import BadInput
from gateway.figures.diagnosis import LadderBar
from gateway.studio import tasks
from gateway.studio.access import Folders
from gateway.studio.views import Found, LadderView, Row, TrialView
from gateway.studio.worker import News, Worker
from gateway.vessel_file import read_vessel_file

GIVEN, NOW = "as given", "now"


@dataclass(frozen=True)
class Version:
    """The vessel at one moment: its file's text, the effects added, the steps climbed so far."""

    text: str
    effects: tuple[str, ...] = ()
    steps: tuple[LadderBar, ...] = ()
    what: str = GIVEN


@dataclass
class Session:
    """Recordings, vessel and answers; `revision` counts the changes of each kind."""

    folders: Folders
    logs: tuple[Path, ...]
    vessel_file: Path | None
    own: tuple[str, ...] = ()  # Python files with effects
    quick: Worker = field(default_factory=Worker)
    slow: Worker = field(default_factory=Worker)
    versions: list[Version] = field(default_factory=list)
    trials: tuple[TrialView, ...] = ()
    found: Found | None = None
    rows: dict[str, Row] = field(default_factory=dict)
    notice: str = ""
    good: bool = False
    learn_from: tuple[Path, ...] = ()
    report: str = ""
    revision: Counter[str] = field(default_factory=Counter)
    _stale: bool = False
    _looked: float = 0.0
    _before: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.vessel_file is not None:
            self.take_vessel(self.vessel_file)

    # what pages do

    def take_vessel(self, path: Path) -> None:
        """Begin with a vessel file."""
        file = self.folders.checked(path)
        text, more = _told_alone(file)
        self.own = tuple(dict.fromkeys((*self.own, *more)))
        tasks.vessel_of(text, tasks.effects_in(self.own))  # a mistake in it is told now
        self.slow.cancel()  # an answer about another vessel is no longer wanted
        self.vessel_file, self.versions = file, [Version(text)]
        self.found = None
        self._changed("vessel", "found")

    def take_logs(self, paths: Sequence[Path]) -> None:
        """Work on these recordings."""
        self.logs = tuple(self.folders.checked(path) for path in paths)
        self.slow.cancel()
        self.learn_from = tuple(p for p in self.learn_from if p in self.logs)
        self.trials, self.found = (), None
        self._changed("trials", "found", "logs")

    @property
    def version(self) -> Version | None:
        """The vessel as it is now."""
        return self.versions[-1] if self.versions else None

    def put(self, version: Version) -> None:
        """The vessel changes; the one before can be had back."""
        self.versions.append(version)
        self._changed("vessel")

    def slide(self, text: str, what: str) -> None:
        """A number changes by a slider: one step back undoes the whole slide."""
        now = self.versions[-1]
        version = Version(text, now.effects, now.steps, what)
        if now.what == what:
            self.versions[-1] = version
        else:
            self.versions.append(version)
        self._changed("vessel")

    def undo(self) -> None:
        """Back to the vessel before."""
        if len(self.versions) > 1:
            self.versions.pop()
            self._changed("vessel")

    def climb(self, rung: LadderView) -> None:
        """Add what a rung adds, or put it in the place of another: its vessel, and its step."""
        assert self.found is not None
        before = self.found.before
        below = [r.step for r in self.found.up_to(rung)]
        earlier = [v.steps for v in self.versions if v.effects == before]
        steps = (*earlier[0], *below[1:]) if before and earlier else tuple(below)
        name = rung.effects[-1].replace("_", " ") if rung.effects else "re-fitted base"
        self.put(Version(rung.text, (*before, *rung.effects), steps, f"+ {name}"))

    def save(self, name: str) -> Path:
        """The vessel as a file in the folder of results."""
        if self.version is None:
            raise BadInput("there is no vessel to save yet")
        file = self.folders.to_save(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, self.version.text.encode(), "the vessel file")
        self._changed("files")
        return file

    # work

    def diagnose(self) -> None:
        """Look for what the vessel lacks, from the recordings chosen for that."""
        if self.version is None or not self.logs:
            raise BadInput("choose a recording and a vessel file first")
        logs = self.learn_from or self.logs[:1]
        self.slow.start("diagnose", tasks.diagnose, [str(p) for p in logs], self.version.text,
                        self.own)  # fmt: skip
        self.found, self._before = None, self.version.effects
        self._changed("found")

    def make_report(self) -> None:
        """Write report.html of what is on the desk."""
        out = self.folders.write / time.strftime("report-%Y%m%d-%H%M%S.html")
        self.slow.start("report", tasks.report, [str(p) for p in self.logs], self.vessels(),
                        self.own, str(out), self.found is not None)  # fmt: skip

    def look(self, path: Path) -> None:
        """Say what is in a recording."""
        self.slow.start("look", tasks.look, str(self.folders.checked(path)))

    def vessels(self) -> list[tuple[str, str]]:
        """The vessels to compare: as given, and as it is now where that is another."""
        if not self.versions:
            return []
        first, last = self.versions[0], self.versions[-1]
        return [(GIVEN, first.text)] + ([(NOW, last.text)] if last.text != first.text else [])

    def look_around(self) -> None:
        """Take what the workers have; begin the next comparison where something changed."""
        if time.monotonic() - self._looked < 0.05:
            return
        self._looked = time.monotonic()
        for news in self.quick.news():
            self._compared(news)
        for news in self.slow.news():
            self._answered(news)
        if self._stale and not self.quick.busy and self.logs and self.versions:
            self._stale = False
            self.quick.start("compare", tasks.compare, [str(p) for p in self.logs],
                             self.vessels(), self.own)  # fmt: skip

    def cancel(self) -> None:
        """Stop what takes long."""
        if self.slow.busy:
            self.say(f"cancelled: {self.slow.job}")
            self.slow.cancel()

    def say(self, text: str, good: bool = False) -> None:
        """A line for all pages."""
        self.notice, self.good = text, good
        self.revision["notice"] += 1

    def close(self) -> None:
        """End the workers."""
        self.quick.cancel()
        self.slow.cancel()

    def _compared(self, news: News) -> None:
        if news.kind == "part":
            if news.value.name not in {t.name for t in self.trials}:
                self.trials = (*self.trials, news.value)
                self.revision["trials"] += 1
        elif news.kind == "done":
            self.trials = news.value
            self.revision["trials"] += 1
        elif news.kind == "failed":
            self.say(news.value)

    def _answered(self, news: News) -> None:
        if news.kind == "failed":
            self.say(news.value)
        elif news.kind == "done":
            self._take(news.job, news.value)

    def _take(self, job: str, value: Any) -> None:
        if job == "diagnose":
            self.found = replace(value, before=self._before)
            self.revision["found"] += 1
        elif job == "report":
            self.report = value
            self.revision["report"] += 1
        elif job == "look":
            self.rows[value.path] = value
            self.revision["rows"] += 1

    def _changed(self, *kinds: str) -> None:
        """Count changes; a comparison of what was before is no longer wanted."""
        self.revision.update(kinds)
        if {"vessel", "logs"} & set(kinds):
            self._stale = True


def _told_alone(file: Path) -> tuple[str, tuple[str, ...]]:
    """The text of a vessel file without paths that hold only where it lies, and those paths."""
    text = file.read_text(encoding="utf-8")
    entries = read_vessel_file(file).effects
    more = tuple(str(file.parent / str(e["file"])) for e in entries if "file" in e)
    if not more:
        return text, ()
    tables = tomllib.loads(text)
    for entry in tables["effects"]:
        entry.pop("file", None)
    return tomli_w.dumps(tables), more


def as_text(version: Version, values: dict[str, float]) -> str:
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
