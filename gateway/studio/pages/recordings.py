"""Recordings: what there is in the folders that were given, what is in them, what to work on."""

from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from gateway.errors import BadInput
from gateway.ingest.survey import Survey
from gateway.studio.controls import report_download
from gateway.studio.page import (
    Page,
    StudioContext,
    Watches,
    boxes,
    bullets,
    button,
    card,
    control_row,
    html,
    select,
    stack,
)

MOST_RATES = 8  # messages whose rates are shown


class RecordingsPage(Page):
    """Choose recordings and a vessel."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._logs = boxes(options={})
        self._vessel = select("Vessel file", {}, width=320)
        self._take = button("Work on these", self.guarded(self._chosen), "primary", width=150)
        self._rows, self._problems = stack(), html()
        self._get = report_download(self)
        self._shown: str | None = None  # the session's vessel file when it was looked at last
        self._leave = ""  # the vessel file for which unsaved changes are to be left behind
        self._details: dict[str, Any] = {}

    def body(self) -> Any:
        """A choice, then the details."""
        folders = ", ".join(escape(str(folder)) for folder in self.session.folders.read)
        return stack(
            card(html(f"<h1>What to work on</h1><p class='faint'>From {folders}; results go to "
                      f"{escape(str(self.session.folders.write))}.</p>"),
                 self._logs, self._vessel, self._take, self._problems),
            card(html("<h2>What is in them</h2><p class='faint'>A report from a recording alone "
                      "learns a vessel from its first part, looks for what is missing and judges "
                      "it on the rest: some minutes.</p>"), self._get, self._rows),
        )  # fmt: skip

    def watch(self) -> Watches:
        """Files, what is chosen, what was found in them."""
        return {
            ("files", "logs", "vessel"): self._list,
            ("surveys",): self._show_surveys,
            ("report",): self._show_report,
            ("files", "trials", "logs"): self._show_problems,
        }

    def _list(self) -> None:
        session = self.session
        files = session.folders.recordings()
        self._logs.options = {file.name: str(file) for file in files}
        chosen = {path.resolve() for path in session.logs}
        self._logs.value = [str(file) for file in files if file.resolve() in chosen]
        refused = session.folders.refused_vessels()
        offered = [file for file in session.folders.vessels() if file not in refused]
        vessels = {file.name: str(file) for file in offered}
        now = str(session.vessel_file) if session.vessel_file else None
        if self._vessel.options != vessels:
            self._vessel.options = vessels
        if now != self._shown and now in vessels.values():
            self._vessel.value, self._shown = now, now
        if set(self._details) != {str(file) for file in files}:
            self._details = {str(file): html() for file in files}
            self._rows.objects = [self._row(file) for file in files]
            self._show_surveys()

    def _row(self, file: Path) -> Any:
        look = self.guarded(partial(self.session.survey, file))
        alone = self.guarded(partial(self.session.report_from_log, file))
        buttons = control_row(
            button(f"Look into {file.name}", look, width=260),
            button("Report from it alone", alone, width=190),
        )
        return stack(buttons, self._details[str(file)])

    def _show_surveys(self) -> None:
        for path, found in self.session.surveys.items():
            if path in self._details:
                self._details[path].object = _description(found)

    def _show_report(self) -> None:
        self._get.visible = bool(self.session.report)

    def _show_problems(self) -> None:
        """Files that are not offered, or could not be compared, each with its reason."""
        reasons = [*self.session.folders.refused_vessels().values(),
                   *self.session.refused.values()]  # fmt: skip
        self._problems.object = "".join(f"<p class='warn'>{escape(why)}</p>" for why in reasons)

    def _chosen(self) -> None:
        if not self._logs.value:
            raise BadInput("choose at least one recording")
        session = self.session
        logs = tuple(Path(path) for path in self._logs.value)
        vessel = Path(self._vessel.value) if self._vessel.value else None
        if vessel is not None and vessel != session.vessel_file:
            self._ask_about_changes(str(vessel))
            session.set_vessel(vessel)
        if logs != session.logs:
            session.set_logs(logs)
        names = ", ".join(path.name for path in session.logs)
        self.notify(f"working on {names}: see Compare", good=True)

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


def _description(found: Survey) -> str:
    megabytes = found.statistics.size_bytes / 1e6
    boats = "; ".join(escape(f"{b.boat} {b.firmware}".strip()) for b in found.boats) or "no boat"
    fastest = sorted(found.messages.items(), key=lambda item: -item[1].rate_hz)[:MOST_RATES]
    rates = ", ".join(f"{escape(name)} {message.rate_hz:.1f} Hz" for name, message in fastest)
    good_for = [text for boat in found.boats for text in boat.good_for]
    notes = (f"<p class='warn'>{escape(note)}</p>" for boat in found.boats for note in boat.notices)
    return (
        f"<p>{escape(found.kind)}, {megabytes:.1f} MB, {found.seconds:.0f} s: {boats}</p>"
        f"<p class='faint'>{rates}</p>{bullets(good_for)}{''.join(notes)}"
    )
