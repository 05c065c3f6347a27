"""The session: what all pages of a studio work on, kept over reloads; a quick and a slow worker."""

import secrets
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gateway.errors import BadInput, ShadowError
from gateway.files import write_whole
from gateway.studio import (
    WHOLE,
    DiagnosisView,
    LadderView,
    Layout,
    NamedRange,
    Scope,
    TimeRanges,
    TrialView,
    load_layout,
    save_layout,
    tasks,
)
from gateway.studio.access import Folders
from gateway.studio.names import recording_names, scope_alone
from gateway.studio.notice import Notice
from gateway.studio.own_effects import VesselToSave, take_vessel, vessel_to_save, with_effects
from gateway.studio.signals import SignalReader
from gateway.studio.version import GIVEN, Version, with_step
from gateway.studio.vessel_watch import VesselWatch
from gateway.studio.worker import CardReader, JobMessage, Worker
from gateway.user_effects import EffectFile
from sim.effects.effect import LawError

NOW = "now"
VESSEL = "vessel file"  # what a notice is about
UPDATE_S = 0.05  # between two looks at the workers, however many pages are open


@dataclass
class Session:
    """Recordings, vessel and answers; `revision` counts the changes of each kind.

    Kinds: vessel, logs, trials, diagnosis, surveys, report, files, scope, layout,
    signals.

    trials    what was compared last; with the vessels of `compared`, which may be those of before
    refused   recordings that could not be compared, each with the reason
    """

    folders: Folders
    logs: tuple[Path, ...]
    vessel_file: Path | None
    effect_files: tuple[EffectFile, ...] = ()
    quick: Worker = field(default_factory=Worker)
    slow: Worker = field(default_factory=Worker)
    versions: list[Version] = field(default_factory=list)
    undone: list[Version] = field(default_factory=list)  # the last one first to come back
    scope: Scope = WHOLE  # of the time that is worked on
    layout: Layout = field(default_factory=Layout)
    trials: tuple[TrialView, ...] = ()
    compared: tuple[tuple[str, str], ...] = ()
    compared_scope: Scope = WHOLE
    refused: Mapping[str, str] = field(default_factory=dict)
    diagnosis: DiagnosisView | None = None
    reader: CardReader = field(default_factory=CardReader)
    signals: SignalReader = field(default_factory=SignalReader)
    notice: Notice | None = None
    learn_from: tuple[Path, ...] = ()
    report: str = ""
    mapping: str | None = None  # of .csv tables; default: the one beside each
    run: str = field(default_factory=lambda: secrets.token_hex(8))  # names this run of the studio
    revision: Counter[str] = field(default_factory=Counter)
    watch: VesselWatch | None = None  # over the vessel file and its effect files
    _stale: bool = False
    _saved: str = ""  # text of the vessel file that was saved last
    _asked: tuple[Path, ...] = ()
    _asked_effects: tuple[EffectFile, ...] = ()  # with the laws that are compared
    _compared_effects: tuple[EffectFile, ...] = ()
    _updated: float = 0.0
    _done: Callable[[Any], None] | None = None
    _alone: bool = False  # the long work that is under way does not depend on what is chosen

    def __post_init__(self) -> None:
        self._named = self.effect_files  # those that the user named
        try:
            self.layout = load_layout(self.folders.write)
        except BadInput as error:
            self.notify(str(error))
        if self.vessel_file is not None:
            self.set_vessel(self.vessel_file)

    # what pages change

    def set_vessel(self, path: Path) -> None:
        """Begin with a vessel file."""
        file = self.folders.checked(path)
        taken = take_vessel(file, self._named)
        every = with_effects(self.effect_files, taken.effects)
        tasks.vessel_of(taken.text, tasks.effects_in(every))  # raises where it has a mistake
        self.effect_files = every
        self._end_work("another vessel file was taken")
        self.vessel_file, self.versions, self.undone = file, [Version(taken.text)], []
        self.watch = VesselWatch(file, taken, self._named)
        self.diagnosis = None
        self._changed("vessel", "diagnosis")

    def set_logs(self, paths: Sequence[Path]) -> None:
        """Work on these recordings."""
        self.logs = tuple(self.folders.checked(path) for path in paths)
        self._end_work("other recordings were chosen")
        self.learn_from = tuple(p for p in self.learn_from if p in self.logs)
        self.trials, self.compared, self.refused, self.diagnosis = (), (), {}, None
        self.scope = WHOLE
        self._changed("trials", "diagnosis", "logs", "scope")

    def set_scope(self, scope: Scope) -> None:
        """Compare, diagnose and fit on some of the time alone, or without it."""
        if scope != self.scope:
            self.scope = scope
            self._end_work("other stretches of time were chosen")
            self.diagnosis = None
            self._changed("scope", "diagnosis")

    def keep_range(self, name: str, recording: str, times: TimeRanges) -> None:
        """Keep stretches of a recording under a name, from now on."""
        if not name or not times:
            raise BadInput("mark a stretch of time and give it a name first")
        self.set_layout(ranges={**self.layout.ranges, name: NamedRange(recording, times)})

    def forget_range(self, name: str) -> None:
        """The name is free again."""
        kept = {k: v for k, v in self.layout.ranges.items() if k != name}
        self.set_layout(ranges=kept)

    def set_layout(self, **changes: Any) -> None:
        """Keep something else of the layout, in its file first."""
        layout = replace(self.layout, **changes)
        save_layout(layout, self.folders.write)
        self.layout = layout
        self._changed("layout")

    @property
    def version(self) -> Version | None:
        """The vessel as it is now."""
        return self.versions[-1] if self.versions else None

    @property
    def is_saved(self) -> bool:
        """Whether nothing is lost when another vessel is taken."""
        return not self.versions or self.versions[-1].text in (self.versions[0].text, self._saved)

    @property
    def is_current(self) -> bool:
        """Whether what was compared is the vessel as it is now."""
        compared = self.compared, self.compared_scope, self._compared_effects
        return bool(self.trials) and compared == (
            tuple(self.vessels()), self.scope, self.effect_files
        )  # fmt: skip

    def slide(self, text: str, change: str) -> None:
        """A number changes by a slider: one step back undoes the whole slide."""
        now = self.versions[-1]
        if now.change == change and len(self.versions) > 1:
            self.versions.pop()
        self._next(Version(text, now.effects, now.ladder, change))

    def undo(self) -> None:
        """Back to the vessel before."""
        if len(self.versions) > 1:
            self.undone.append(self.versions.pop())
            self._changed("vessel")

    def redo(self) -> None:
        """Do the change again that was undone last."""
        if self.undone:
            self.versions.append(self.undone.pop())
            self._changed("vessel")

    def _next(self, version: Version) -> None:
        """Another vessel: what was undone before it is gone."""
        self.versions.append(version)
        self.undone.clear()
        self._changed("vessel")

    def climb(self, step: LadderView) -> None:
        """Add what a step adds, or put it in the place of another: its vessel, and its bar."""
        assert self.diagnosis is not None
        self._next(with_step(self.versions, self.diagnosis, step))

    def to_save(self, folder: Path | None = None) -> VesselToSave:
        """The vessel as it leaves the studio; BadInput where there is none yet."""
        if self.version is None:
            raise BadInput("there is no vessel to save yet: choose one under Recordings")
        return vessel_to_save(self.version.text, self.effect_files, folder)

    def save(self, name: str) -> Path:
        """The vessel as a file in the folder of results, and beside it its own effects' files."""
        file = self.folders.to_save(name)
        text, beside = self.to_save(file.parent)
        for one, effect_file in beside.items():
            write_whole(file.with_name(one), effect_file.content, "the effect")
        write_whole(file, text.encode(), "the vessel file")
        self._saved = self.versions[-1].text
        self._changed("files")
        return file

    def notify(self, text: str, good: bool = False, about: str = "") -> None:
        """A line on all pages; `about` names the work that it is about."""
        self.notice = Notice(text, good, time.monotonic(), about)

    def _settled(self, about: str) -> None:
        """Take away the notice of work that has been done again."""
        if self.notice is not None and self.notice.about == about:
            self.notice = None

    # work

    def start(
        self, job: str, task: Callable[..., Any], *arguments: Any, done: Callable[[Any], None],
        alone: bool = False,
    ) -> None:  # fmt: skip
        """Begin `task(send, *arguments)` in a process of its own; `done` takes its result.

        `alone`: the answer does not depend on what is chosen, and other choices do not end it.
        RuntimeError while another job of this kind is under way.
        """
        self.slow.start(job, task, *arguments)
        self._done, self._alone = done, alone
        self._settled(job)

    @property
    def _has_work(self) -> bool:
        """Whether something long is under way whose answer is about what is chosen now."""
        return self.slow.busy and not self._alone

    def _end_work(self, why: str) -> None:
        """End work whose answer would be about something else; all pages say so."""
        if self._has_work:
            job = str(self.slow.job)
            self.notify(f"{job} was ended, for {why}: start it again where it is still wanted",
                        about=job)  # fmt: skip
        if not (self.slow.busy and self._alone):
            self.slow.cancel()

    def _to_learn(self) -> tuple[list[str], Version, Scope]:
        """Recordings to learn from, the vessel that is to learn, the time that is taken."""
        if self.version is None or not self.logs:
            raise BadInput("choose a recording and a vessel file first")
        logs = [str(path) for path in self.learn_from or self.logs[:1]]
        names = recording_names([str(path) for path in self.logs])
        return logs, self.version, scope_alone(self.scope, names, logs)

    def diagnose(self) -> None:
        """Look for what the vessel lacks, from the recordings chosen for that."""
        logs, now, scope = self._to_learn()

        def done(diagnosis: DiagnosisView) -> None:
            self.diagnosis = replace(diagnosis, before=now.effects)
            self._changed("diagnosis")

        self.start("diagnose", tasks.diagnose_task, logs, now.text, self.effect_files,
                   self.mapping, scope, done=done)  # fmt: skip
        self.diagnosis = None
        self._changed("diagnosis")

    def fit(self) -> None:
        """Fit the base numbers of the vessel to the recordings chosen to learn from."""
        logs, now, scope = self._to_learn()
        names = ", ".join(Path(path).name for path in logs)
        part = f", {self.scope.text}" if self.scope.text else ""

        def done(text: str) -> None:
            self._next(Version(text, now.effects, now.ladder, f"fitted to {names}{part}"))

        self.start("fit", tasks.fit_task, logs, now.text, self.effect_files, self.mapping, scope,
                   done=done)  # fmt: skip

    def write_report(self) -> None:
        """Write an HTML report of the comparison and of the diagnosis if there is one."""
        self.start("report", tasks.report_task, [str(p) for p in self.logs], self.vessels(),
                   self.effect_files, self._report_file(), self.diagnosis is not None,
                   self.mapping, done=self._reported)  # fmt: skip

    def report_from_log(self, path: Path) -> None:
        """Learn a vessel from a recording alone, and write the report on it."""
        log = str(self.folders.checked(path))
        self.start(f"report from {path.name} alone", tasks.log_report_task, log,
                   self._report_file(), self.effect_files, self.mapping,
                   done=self._reported, alone=True)  # fmt: skip

    def _report_file(self) -> str:
        return str(self.folders.write / time.strftime("report-%Y%m%d-%H%M%S.html"))

    def _reported(self, file: str) -> None:
        self.report = file
        self.notify(f"report written: {file}", good=True)
        self._changed("report")

    def add_recording(self, name: str, content: bytes) -> Path:
        """A recording that was dropped on a page, into the folder of results."""
        file = self.folders.to_add(name)
        write_whole(file, content, "the recording")
        self.reader.want([file])
        if file in self.logs:  # it takes the place of one that was removed
            self.set_logs(self.logs)
        self._changed("files")
        return file

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
        self._look_at_the_vessel()
        for message in self.quick.messages():
            self._compared(message)
        for message in self.slow.messages():
            if message.kind == "failed":
                self.notify(f"{message.job}: {message.value}", about=message.job)
            elif message.kind == "done" and self._done is not None:
                self._done(message.value)
        if self.reader.update(self.mapping):
            self._changed("surveys")
        if self.signals.update():
            self._changed("signals")
        if self._stale and not self.quick.busy and self.logs and self.versions:
            self._stale, self._asked, self._asked_effects = False, self.logs, self.effect_files
            vessels = tuple(self.vessels())
            self.quick.start("compare", tasks.compare_task, [str(p) for p in self.logs], vessels,
                             self.effect_files, self.mapping, self.scope)  # fmt: skip

    def _look_at_the_vessel(self) -> None:
        """Take the vessel's files anew where one was changed; if work would be lost only say so."""
        news = None if self.watch is None else self.watch.news()
        if self.watch is None or news is None:
            return
        self._settled(VESSEL)
        self._changed("files")
        stays = f"{news.says}: the studio goes on with it as it was"
        if not news.usable:
            self.notify(stays, about=VESSEL)
        elif not self.watch.differs:
            return
        elif self._has_work or self.diagnosis is not None or len(self.versions) > 1:
            self.notify(f"{stays}; choose the vessel again under Recordings to take it",
                        about=VESSEL)  # fmt: skip
        else:
            try:
                self.set_vessel(self.watch.file)
                self.notify(f"{news.says}: read again", good=True, about=VESSEL)
            except (ShadowError, LawError) as error:
                self.notify(f"{stays}: {error}", about=VESSEL)

    def cancel(self) -> None:
        """Stop what takes long."""
        if self.slow.busy:
            self.notify(f"cancelled: {self.slow.job}", good=True)
            self.slow.cancel()

    def close(self) -> None:
        """End the workers."""
        for worker in (self.quick, self.slow, self.reader.worker, self.signals.worker):
            worker.cancel()

    def _compared(self, message: JobMessage) -> None:
        """Take comparisons that the quick worker sent; those of other recordings are dropped."""
        if self._asked != self.logs:
            return
        if message.kind == "part":
            view, known = message.value, {trial.name: trial for trial in self.trials}
            if view.name not in known or known[view.name].rough:
                self.trials = tuple((known | {view.name: view}).values())
                self._changed("trials")
        elif message.kind == "done":
            self.trials, self.refused = message.value.trials, message.value.refused
            self.compared, self.compared_scope = message.value.vessels, message.value.scope
            self._compared_effects = self._asked_effects
            self._settled(message.job)
            self._changed("trials")
        elif message.kind == "failed":
            self.refused = {str(path): message.value for path in self.logs}
            self.notify(f"{message.job}: {message.value}", about=message.job)
            self._changed("trials")

    def _changed(self, *kinds: str) -> None:
        """Count changes; a comparison of what was before is no longer wanted."""
        self.revision.update(kinds)
        if {"vessel", "logs", "scope"} & set(kinds):
            self._stale = True
