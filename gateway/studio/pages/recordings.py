"""Recordings: what there is in the folders that were given, what is in them, what to work on."""

from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from gateway.errors import BadInput
from gateway.ingest.survey import Survey
from gateway.studio.page import (
    Page,
    StudioContext,
    Watches,
    boxes,
    bullets,
    button,
    card,
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
        self._rows = stack()
        self._details: dict[str, Any] = {}

    def body(self) -> Any:
        """A choice, then the details."""
        folders = ", ".join(escape(str(folder)) for folder in self.session.folders.read)
        return stack(
            card(html(f"<h1>What to work on</h1><p class='faint'>From {folders}; results go to "
                      f"{escape(str(self.session.folders.write))}.</p>"),
                 self._logs, self._vessel, self._take),
            card(html("<h2>What is in them</h2>"), self._rows),
        )  # fmt: skip

    def watch(self) -> Watches:
        """Files, what is chosen, what was found in them."""
        return {("files", "logs", "vessel"): self._list, ("surveys",): self._show_surveys}

    def _list(self) -> None:
        session = self.session
        files = session.folders.recordings()
        self._logs.options = {file.name: str(file) for file in files}
        chosen = {path.resolve() for path in session.logs}
        self._logs.value = [str(file) for file in files if file.resolve() in chosen]
        vessels = {file.name: str(file) for file in session.folders.vessels()}
        if self._vessel.options != vessels:
            now = str(session.vessel_file) if session.vessel_file else None
            self._vessel.options = vessels
            if now in vessels.values():
                self._vessel.value = now
        if set(self._details) != {str(file) for file in files}:
            self._details = {str(file): html() for file in files}
            self._rows.objects = [self._row(file) for file in files]
            self._show_surveys()

    def _row(self, file: Path) -> Any:
        look = self.guarded(partial(self.session.survey, file))
        return stack(button(f"Look into {file.name}", look, width=260), self._details[str(file)])

    def _show_surveys(self) -> None:
        for path, found in self.session.surveys.items():
            if path in self._details:
                self._details[path].object = _description(found)

    def _chosen(self) -> None:
        if not self._logs.value:
            raise BadInput("choose at least one recording")
        session = self.session
        session.notice = ""
        session.set_logs([Path(path) for path in self._logs.value])
        if self._vessel.value:
            session.set_vessel(Path(self._vessel.value))
        names = ", ".join(path.name for path in session.logs)
        session.notify(f"working on {names}: see Compare", good=True)


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
