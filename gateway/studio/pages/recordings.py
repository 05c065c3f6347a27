"""Recordings: what there is in the folders that were given, what is in them, what to work on."""

from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import panel as pn

from gateway.errors import BadInput, ShadowError
from gateway.studio.controls import report_download
from gateway.studio.names import labels
from gateway.studio.notice import Notice
from gateway.studio.page import (
    NO_BUTTON,
    STYLE,
    Page,
    StudioContext,
    Watches,
    boxes,
    button,
    card,
    html,
    select,
    stack,
)
from gateway.studio.worker import card_text

GRID = {"display": "grid", "grid-template-columns": "repeat(auto-fill, minmax(280px, 1fr))",
        "gap": "0 14px"}  # fmt: skip
DROPPER = """
.filepond--root { border: 0 !important; outline: 1px dashed var(--edge); }
.filepond--root .filepond--panel-root { background: var(--field); }
.filepond--root .filepond--drop-label {
    color: var(--ink) !important; background: var(--field) !important;
}
.filepond--root .filepond--file-status-sub, .filepond--root .filepond--file-info-sub { opacity: 1; }
"""
LARGEST = "1000MB"  # that can be dropped, held in memory on its way; the part knows no GB


class RecordingsPage(Page):
    """Choose recordings and a vessel."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._logs = boxes(options={})
        self._vessel = select("Vessel file", {}, width=320)
        self._take = button("Work on these", self.guarded(self._chosen), "primary", width=150)
        self._rows, self._problems = stack(styles=GRID, stylesheets=[NO_BUTTON]), html()
        self._drop = pn.widgets.FileDropper(
            label="Drop recordings here, or press to choose them", multiple=True, previews=[],
            max_file_size=LARGEST, sizing_mode="stretch_width", min_height=80,
            stylesheets=[STYLE, DROPPER],
        )  # fmt: skip
        self._drop.param.watch(lambda event: self._dropped(event.new), "value")
        self._get = report_download(self)
        self._shown: str | None = None  # the session's vessel file when it was looked at last
        self._leave = ""  # the vessel file for which unsaved changes are to be left behind
        self._names: dict[str, str] = {}  # path of each recording -> how it is called here
        self._details: dict[str, Any] = {}
        self._taken: dict[str, bytes | str] = {}  # what was dropped on this page, by name
        self._came, self._refused = dict[str, str](), dict[str, str]()  # of it, as its message says
        self._drop_notice: Notice | None = None  # that message
        self._work_notice: Notice | None = None  # that these are worked on

    def body(self) -> Any:
        """A choice, then the details."""
        folders = ", ".join(escape(str(folder)) for folder in self.session.folders.read)
        return stack(
            card(html(f"<h1>What to work on</h1><p class='faint'>From {folders}; results go to "
                      f"{escape(str(self.session.folders.write))}.</p>"),
                 self._logs, self._vessel, self._take, self._problems),
            card(html("<h2>What is in them</h2><p class='faint'>A report from a recording alone "
                      "learns a vessel from its first part, looks for what is missing and judges "
                      "it on the rest: some minutes.</p>"), self._drop, self._get, self._rows),
        )  # fmt: skip

    def watch(self) -> Watches:
        """Files, what is chosen, what was found in them."""
        return {
            ("files", "logs", "vessel"): self._list,
            ("files",): self._read,
            ("surveys",): self._show_surveys,
            ("report",): self._show_report,
            ("files", "trials", "logs"): self._show_problems,
        }

    def _list(self) -> None:
        session = self.session
        files = session.folders.recordings()
        named = {label: str(file) for label, file in labels(files).items()}
        self._logs.options = named
        chosen = {path.resolve() for path in session.logs}
        self._logs.value = [str(file) for file in files if file.resolve() in chosen]
        refused = session.folders.refused_vessels()
        offered = [file for file in session.folders.vessels() if file not in refused]
        vessels = {label: str(file) for label, file in labels(offered).items()}
        now = str(session.vessel_file) if session.vessel_file else None
        if self._vessel.options != vessels:
            self._vessel.options = vessels
        if now != self._shown and now in vessels.values():
            self._vessel.value, self._shown = now, now
        if self._names != {path: label for label, path in named.items()}:
            self._names = {path: label for label, path in named.items()}
            self._details = {path: html() for path in self._names}
            self._rows.objects = [self._row(file) for file in files]
            self._show_surveys()

    def _read(self) -> None:
        """Ask for the cards of recordings that are new, or were changed."""
        self.session.reader.want(self.session.folders.recordings())
        self._show_surveys()

    def _row(self, file: Path) -> Any:
        alone = self.guarded(partial(self.session.report_from_log, file))
        text = f"Report from {self._names[str(file)]} alone"
        press = button(text, alone, sizing_mode="stretch_width")
        return card(self._details[str(file)], press)

    def _show_surveys(self) -> None:
        for path, place in self._details.items():
            text = card_text(path, self._names[path], self.session.reader)
            if place.object != text:
                place.object = text

    def _dropped(self, files: dict[str, bytes | str]) -> None:
        """Recordings that came, each once: what can be done with them, and why others are none.

        Of several that are dropped at once each comes by itself: one message is for all of them.
        """
        new = {name: what for name, what in files.items() if self._taken.get(name) is not what}
        self._taken |= new
        if not new:
            return
        before = self._notice
        if before is None or before is not self._drop_notice or not before.holds:
            self._came, self._refused = {}, {}
        self.guarded(partial(self._take_in, new))()
        self._drop_notice = self._notice

    def _take_in(self, new: dict[str, bytes | str]) -> None:
        came, refused = self._came, self._refused
        for name, content in new.items():
            raw = content.encode() if isinstance(content, str) else content
            refused.pop(name, None)  # it may be another file this time
            try:
                file = self.session.add_recording(name, raw)
                renamed = f"{file.name} ({name} as it was dropped: a folder given has one)"
                came[name] = name if file.name == name else renamed
            except ShadowError as error:
                refused[name] = str(error)
        are, it, one = ("is", "it", "it") if len(came) == 1 else ("are", "them", "one")
        names = ", ".join(came.values())
        here = f"{names} {are} here: work on {it}, or have a report from {one} alone"
        if refused:
            raise BadInput("; ".join([*refused.values(), *([here] if came else [])]))
        self.notify(here, good=True)

    def _show_report(self) -> None:
        self._get.visible = bool(self.session.report)

    def _show_problems(self) -> None:
        """Files that are not offered, or could not be compared, each with its reason."""
        reasons = [*self.session.folders.refused_vessels().values(),
                   *self.session.refused.values()]  # fmt: skip
        self._problems.object = "".join(f"<p class='warn'>{escape(why)}</p>" for why in reasons)
        if self.session.refused and self._notice is not None and self._notice is self._work_notice:
            names = ", ".join(Path(path).name for path in self.session.refused)
            self.notify(f"cannot work on {names}: the reason stands under the choice")

    def _chosen(self) -> None:
        if not self._logs.value:
            raise BadInput("choose at least one recording")
        session = self.session
        logs = tuple(Path(path) for path in self._logs.value)
        vessel = Path(self._vessel.value) if self._vessel.value else None
        changed = session.watch is not None and session.watch.differs  # by another program
        if vessel is not None and (vessel != session.vessel_file or changed):
            self._ask_about_changes(str(vessel))
            session.set_vessel(vessel)
        if logs != session.logs:
            session.set_logs(logs)
        names = ", ".join(path.name for path in session.logs)
        self.notify(f"working on {names}: see Compare", good=True)
        self._work_notice = self._notice

    def _ask_about_changes(self, vessel: str) -> None:
        """Once: nobody loses by a click what was not saved."""
        if self.session.is_saved or self._leave == vessel:
            self._leave = ""
            return
        self._leave = vessel
        file = self.session.vessel_file
        raise BadInput(
            f"{file.name if file else 'the vessel'} has changes that are not saved: save it on the "
            "page Vessel, or press once more to go on without them"
        )
