"""Recordings: what there is in the folders that were given, what is in them, what to work on."""

from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import panel as pn

from gateway.errors import BadInput
from gateway.studio.page import Page
from gateway.studio.session import Session
from gateway.studio.views import Row
from gateway.studio.widgets import boxes, bullets, button, card, html, select


class Recordings(Page):
    """Choose recordings and a vessel."""

    name, title = "recordings", "Recordings"

    def __init__(self, desk: Session) -> None:
        super().__init__(desk)
        self._logs = boxes(options={})
        self._vessel = select("Vessel file", {}, width=320)
        self._take = button("Work on these", self.safely(self._taken), "primary", width=150)
        self._rows = pn.Column(sizing_mode="stretch_width")
        self._details: dict[str, Any] = {}

    def body(self) -> Any:
        """A choice, then the details."""
        folders = ", ".join(escape(str(folder)) for folder in self.desk.folders.read)
        return pn.Column(
            card(html(f"<h1>What to work on</h1><p class='faint'>From {folders}; results go to "
                      f"{escape(str(self.desk.folders.write))}.</p>"),
                 self._logs, self._vessel, self._take),
            card(html("<h2>What is in them</h2>"), self._rows),
            sizing_mode="stretch_width",
        )  # fmt: skip

    def watch(self) -> dict[tuple[str, ...], Callable[[], None]]:
        """Files, what is chosen, what was looked at."""
        return {("files", "logs", "vessel"): self._listed, ("rows",): self._told}

    def _listed(self) -> None:
        files = self.desk.folders.recordings()
        self._logs.options = {file.name: str(file) for file in files}
        chosen = {path.resolve() for path in self.desk.logs}
        self._logs.value = [str(file) for file in files if file.resolve() in chosen]
        vessels = {file.name: str(file) for file in self.desk.folders.vessels()}
        if self._vessel.options != vessels:
            now = str(self.desk.vessel_file) if self.desk.vessel_file else None
            self._vessel.options = vessels
            if now in vessels.values():
                self._vessel.value = now
        if set(self._details) != {str(file) for file in files}:
            self._details = {str(file): html() for file in files}
            self._rows.objects = [self._row(file) for file in files]
            self._told()

    def _row(self, file: Path) -> Any:
        look = button(f"Look into {file.name}", self.safely(partial(self.desk.look, file)),
                      width=260)  # fmt: skip
        return pn.Column(look, self._details[str(file)], sizing_mode="stretch_width")

    def _told(self) -> None:
        for path, row in self.desk.rows.items():
            if path in self._details:
                self._details[path].object = _says(row)

    def _taken(self) -> None:
        if not self._logs.value:
            raise BadInput("choose at least one recording")
        self.desk.notice = ""
        self.desk.take_logs([Path(path) for path in self._logs.value])
        if self._vessel.value:
            self.desk.take_vessel(Path(self._vessel.value))
        self.desk.say(f"working on {', '.join(path.name for path in self.desk.logs)}: see Compare",
                      good=True)  # fmt: skip


def _says(row: Row) -> str:
    boats = "; ".join(map(escape, row.boats)) or "no boat"
    rates = ", ".join(f"{escape(name)} {rate:.1f} Hz" for name, rate in row.rates)
    notes = "".join(f"<p class='warn'>{escape(note)}</p>" for note in row.notices)
    return (
        f"<p>{escape(row.kind)}, {row.megabytes:.1f} MB, {row.seconds:.0f} s: {boats}</p>"
        f"<p class='faint'>{rates}</p>{bullets(row.good_for)}{notes}"
    )
