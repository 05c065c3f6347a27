"""Fleet: the table that `shadow fleet` wrote, where its voyages were, and how numbers went."""

from collections.abc import Mapping
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import panel as pn

from gateway.errors import BadInput
from gateway.studio.controls import FigurePlace
from gateway.studio.names import labels
from gateway.studio.page import (
    STYLE,
    Page,
    StudioContext,
    bullets,
    button,
    card,
    control_row,
    html,
    section,
    select,
    stack,
    word,
)
from gateway.studio.page import field as text_field

COLUMNS = ("recording", "boat", "began", "usable min", "error", "noise floor", "state", "about")
ALL, NOBODY = "all", "no boat"
ROWS_SHOWN, ROW_PX, HEAD_PX = 20, 37, 60  # what is more is scrolled to
TABLE_STYLE = """
.tabulator, .tabulator .tabulator-header, .tabulator .tabulator-header .tabulator-col, .tabulator .tabulator-tableholder .tabulator-table, .tabulator-row, .tabulator-row.tabulator-row-even { background: var(--paper) !important; color: var(--ink) !important; border-color: var(--line) !important; font: inherit; }
.tabulator-row.tabulator-selectable:hover { background: var(--soft) !important; cursor: pointer; }
"""  # noqa: E501
NO_FOLDER = (
    "No fleet was given. Write the table of many recordings with <code>shadow fleet logs/ "
    "--vessels fleet.toml</code>, then open it with <code>shadow studio --fleet "
    "shadow-out/fleet</code>."
)


class FleetPage(Page):
    """Filter, look, choose a recording."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._headline, self._why = html(), html()
        self._table = pn.widgets.Tabulator(
            _frame(()), show_index=False, disabled=True, theme="simple",
            layout="fit_data_stretch",
            stylesheets=[STYLE, TABLE_STYLE], sizing_mode="stretch_width",
        )  # fmt: skip
        self._table.on_click(lambda event: self.guarded(lambda: self.open_row(event.row))())
        # rows are pressed by mouse alone: by keyboard a recording is chosen here
        self._which = select("Open a recording", {}, width=320)
        self._open = button("Open in Compare", self.guarded(self._open_chosen), width=150)
        self._search = text_field("Search in name and about", width=260)
        self._boat, self._state = (select(name, [ALL], width=160) for name in ("Boat", "State"))
        self._search.param.watch(lambda _: self._filter(), "value_input")
        for one in (self._boat, self._state):
            one.param.watch(lambda _: self._filter(), "value")
        self._shown: tuple[Mapping[str, Any], ...] = ()
        self._number = select("Number", [], width=320)
        self._number.param.watch(lambda _: self._draw_course(), "value")
        self._course, self._maps = FigurePlace(self.view), stack()
        self._leave = pn.widgets.TextInput(visible=False)  # where the browser goes next
        self._leave.jscallback(value="if (cb_obj.value) window.location.href = cb_obj.value")
        self._seen_revision = 0
        self._parts = stack(visible=False)

    def body(self) -> Any:
        """The table, the maps, the courses."""
        self._parts.objects = [
            section("Recordings",
                    f"A press on a row opens it in Compare. Error: {word('nrmse')}, beside the "
                    f"{word('noise floor')}.",
                    control_row(self._search, self._boat, self._state), self._table,
                    control_row(self._which, self._open)),
            section("Where the voyages began", "One map a water.", self._maps),
            section("How numbers went",
                    "Each point is what one recording tells of a number of the vessel, with its "
                    f"{word('95 % interval')}; the band is the course through them.",
                    self._number, self._course.part),
        ]  # fmt: skip
        return stack(
            card(html("<h1>Fleet</h1>"), self._headline, self._why, self._leave), self._parts
        )

    def tick(self) -> None:
        """Show the table when the reader has another."""
        reader = self.context.fleet
        reader.update()
        if self._seen_revision != reader.revision:
            self._seen_revision = reader.revision
            self._show()
        elif reader.view is None and not reader.refused:
            text = NO_FOLDER if reader.folder is None else "Reading the table …"
            if self._why.object != text:
                self._why.object = text

    def _show(self) -> None:
        reader = self.context.fleet
        self._why.object = f"<p class='warn'>{escape(reader.refused)}</p>" if reader.refused else ""
        view = reader.view
        if view is None:
            return
        self._headline.object = bullets(view.headline)
        for place, name in ((self._boat, "boat"), (self._state, "state")):
            place.options = [ALL, *sorted({str(row[name] or NOBODY) for row in view.rows})]
        self._filter()
        places = [FigurePlace(self.view) for _ in view.maps]
        for place, figure in zip(places, view.maps, strict=True):
            place.show(figure)
        self._maps.objects = [
            stack(place.part, html(f"<p class='faint'>{escape(figure.caption)}</p>"))
            for place, figure in zip(places, view.maps, strict=True)
        ]
        self._number.options = names = list(view.courses)
        if self._number.value not in names:
            self._number.value = names[0] if names else None
        self._draw_course()
        self._parts.visible = True

    def _filter(self) -> None:
        """The rows that are of the boat and state chosen and hold all words of the search."""
        view = self.context.fleet.view
        words = (self._search.value_input or "").lower().split()
        chosen = ((self._boat.value, "boat"), (self._state.value, "state"))
        self._shown = tuple(
            row for row in (() if view is None else view.rows)
            if all(value in (ALL, str(row[name] or NOBODY)) for value, name in chosen)
            and all(word in f"{row['recording']} {_about(row)}".lower() for word in words)
        )  # fmt: skip
        self._table.value = _frame(self._shown)
        self._table.height = HEAD_PX + ROW_PX * min(max(len(self._shown), 1), ROWS_SHOWN)
        names = labels([Path(row["recording"]) for row in self._shown])
        self._which.options = {name: k for k, name in enumerate(names)}

    def _draw_course(self) -> None:
        view = self.context.fleet.view
        figure = view.courses.get(self._number.value) if view is not None else None
        self._course.show(figure)
        if figure is not None:
            self._course.part.append(html(f"<p>{escape(figure.caption)}</p>"))

    def _open_chosen(self) -> None:
        if self._which.value is None:
            raise BadInput("no recording is shown that could be opened")
        self.open_row(self._which.value)

    def open_row(self, row: int) -> None:
        """Work on the recording of a row that is shown, with its vessel, in Compare."""
        chosen, session = self._shown[row], self.session
        log, vessel = Path(chosen["recording"]), Path(chosen["vessel_file"] or "")
        if not log.is_file():
            raise BadInput(f"{chosen['recording']}: not on this machine now")
        # the table was given, so what it names may be read
        folders = [file.resolve().parent for file in (log, vessel) if file.is_file()]
        read = tuple(dict.fromkeys((*session.folders.read, *folders)))
        session.folders = replace(session.folders, read=read)
        if vessel.is_file() and session.is_saved and vessel.resolve() != session.vessel_file:
            session.set_vessel(vessel)
        session.set_logs([log])
        self._leave.value = f"/compare?log={log.name}"


def _frame(rows: tuple[Mapping[str, Any], ...]) -> Any:
    """The table as people read it."""
    import pandas as pd  # as long as a third of the studio's start, for this page alone

    return pd.DataFrame([_cells(row) for row in rows], columns=list(COLUMNS))


def _cells(row: Mapping[str, Any]) -> tuple[Any, ...]:
    usable = None if row["usable_s"] is None else round(row["usable_s"] / 60.0, 1)
    errors = (None if row[k] is None else round(row[k], 3) for k in ("nrmse", "noise_floor_nrmse"))
    began = f"{row['started']:%Y-%m-%d %H:%M}" if row["started"] else ""
    name, boat = Path(row["recording"]).name, row["boat"] or NOBODY
    return (name, boat, began, usable, *errors, row["state"], _about(row))


def _about(row: Mapping[str, Any]) -> str:
    """Why it is not done, or what it is good for."""
    return str(row["why"] or "; ".join(row["good_for"] or ()))
