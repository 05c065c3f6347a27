"""Parts that several pages have: a place for a figure, a table of errors, saving a vessel.

Several recordings on one plot, velocities or errors of a model, are laid over one another at a
moment of each, or along the way that they ran through.
"""

from collections.abc import Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gateway.errors import BadInput
from gateway.figures import SEVERAL, VELOCITIES, Axis, FigureData, Line, Panel, SeriesRole
from gateway.figures.bokeh_draw import BokehFigure, LinkedView
from gateway.studio import TrialView
from gateway.studio.names import labels
from gateway.studio.page import (
    Page,
    bokeh_part,
    boxes,
    button,
    control_row,
    download,
    field,
    html,
    select,
    stack,
    table,
    word,
)
from sim.state import Floats


class FigurePlace:
    """A place of a page for one figure, filled in place while new data have the same shape."""

    def __init__(self, view: LinkedView, **more: Any) -> None:
        self.part = stack(**more)
        self.figure: BokehFigure | None = None
        self._view = view

    def show(self, data: FigureData | None) -> None:
        """The figure of these data, or nothing."""
        if data is None:
            self.figure, self.part.objects = None, []
        elif self.figure is None or not self.figure.update(data):
            self.figure = BokehFigure(data, self._view)
            self.part.objects = [bokeh_part(self.figure.layout)]


def error_table(heading: str, trials: Sequence[TrialView], current: bool) -> str:
    """The error of the vessel as given and as it is now, on recordings that were compared.

    `current`: they were compared with the vessel as it is now; else no number stands for it.
    """
    rows = [
        [escape(t.name), f"{t.vessels[0].nrmse:.3f}",
         f"{t.vessels[-1].nrmse:.3f}" if current else "comparing …",
         f"{t.vessels[-1].standing.floor:.3f}"] for t in trials
    ]  # fmt: skip
    return table([heading, "error as given", "error now", word("noise floor")], rows)


def report_download(page: Page) -> Any:
    """A button that hands the last report to the browser; not there before there is one."""
    return download("Download the report", "report.html",
                    lambda: BytesIO(Path(page.session.report).read_bytes()),
                    width=180, visible=False)  # fmt: skip


class LearnFrom:
    """Boxes of the recordings that a diagnosis and a fit learn from, the same on all pages."""

    def __init__(self, page: Page) -> None:
        self._session = page.session
        self.part = boxes(options=[], inline=True)
        self.part.param.watch(lambda _: self._choose(), "value")

    def update(self) -> None:
        """After the choice of recordings has changed."""
        named = labels(self._session.logs)
        self.part.options = {label: str(path) for label, path in named.items()}
        chosen = self._session.learn_from or self._session.logs[:1]
        self.part.value = [str(path) for path in chosen]

    def check(self) -> None:
        """BadInput where none is chosen."""
        if not self.part.value:
            raise BadInput("choose at least one recording to learn from")

    def _choose(self) -> None:
        paths = set(self.part.value)
        self._session.learn_from = tuple(p for p in self._session.logs if str(p) in paths)


class SaveControls:
    """Undo, redo, a name, and a button that saves the vessel; a name is proposed at first."""

    def __init__(
        self, page: Page, label: str, ending: str, *more: Any, widths: tuple[int, int], **style: Any
    ) -> None:
        self._page, self._session, self._ending = page, page.session, ending
        self._undo = button("Undo", page.guarded(page.session.undo), width=90)
        self._redo = button("Redo", page.guarded(page.session.redo), width=90)
        self._name = field(label, width=widths[0])
        save = button("Save vessel file", page.guarded(self._save), width=widths[1], **style)
        self.part = control_row(self._undo, self._redo, self._name, save, *more)

    def update(self) -> None:
        """After the vessel has changed."""
        self._undo.disabled = len(self._session.versions) < 2
        self._redo.disabled = not self._session.undone
        file = self._session.vessel_file
        if file is not None and not self._name.value:
            self._name.value = f"{file.stem}-{self._ending}.toml"

    def _save(self) -> None:
        file = self._session.save(self._name.value.strip())
        made = self._session.to_save(file.parent)
        names = " and ".join(made.beside)
        along = f", and its own effects beside it ({names}): they go where it goes" if names else ""
        trust = made.to_trust(str(file))
        self._page.notify(f"saved: {file}{along}{trust}", good=not trust)


SINCE = Axis("time after that moment", "s")
ALONG = Axis("way run through", "m")
START, WAY = "at their beginning", "along the way run through"
MEASURED, ERROR = "measured motion", "error: measured − model"


class Course(NamedTuple):
    """One recording: its name, x (n,) of its rows, u, v, r (n, 3) [m/s, m/s, rad/s]."""

    name: str
    x: Floats
    velocity: Floats


class SeveralRecordings:
    """Boxes to choose recordings, how they are laid over one another, and the plot."""

    def __init__(self, page: Page) -> None:
        self._trials: tuple[TrialView, ...] = ()
        self._quiet = False
        self._which = boxes(options=[], inline=True)
        self._align = select("Laid over one another", [START, WAY], width=280)
        self._what = select("Shown", [MEASURED, ERROR], width=220)
        for one in (self._which, self._align, self._what):
            one.param.watch(lambda _: None if self._quiet else page.caught(self._draw), "value")
        self._place = FigurePlace(LinkedView(page.theme))
        self._hint = html()
        choose = control_row(self._align, self._what)
        self.part = stack(self._which, choose, self._hint, self._place.part)

    def update(self, trials: Sequence[TrialView]) -> None:
        """Other recordings, or another vessel on them."""
        names = [one.name for one in trials]
        self._quiet = True
        if self._which.options != names:
            self._which.options = names
            self._which.value = names[:4]
        self._trials = tuple(trials)
        shared = [moments(one) for one in trials]
        texts = [t for t in shared[0] if all(t in one for one in shared)] if shared else []
        options = [START, WAY, *texts]
        if self._align.options != options:
            self._align.options = options
        self._quiet = False
        self._draw()

    def _draw(self) -> None:
        chosen = [one for one in self._trials if one.name in self._which.value]
        model = self._what.value == ERROR
        courses = [course for one in chosen if (course := course_of(one, self._align.value, model))]
        enough = len(courses) > 1
        self._hint.object = "" if enough else (
            "<p class='faint'>Work on two recordings or more to see them on one plot.</p>"
        )  # fmt: skip
        axis = ALONG if self._align.value == WAY else SINCE
        self._place.show(several_velocities(courses, axis, self._what.value) if enough else None)


def moments(trial: TrialView) -> dict[str, float]:
    """Moments at which recordings can be laid over one another: a name, and its time [s]."""
    lanes = next((p.lanes for p in trial.commands.panels if p.lanes is not None), None)
    out: dict[str, float] = {}
    if lanes is not None:
        for time, row, text in zip(lanes.start, lanes.row, lanes.texts, strict=True):
            out.setdefault(f"at “{text}” ({lanes.names[row]})", float(time))
    return out


def course_of(trial: TrialView, align: str, error: bool) -> Course | None:
    """A recording over the axis that was chosen; None where it has no such moment, or no model."""
    if error and not (trial.vessels and trial.vessels[-1].motion is not None):
        return None
    velocity: Floats = trial.motion[:, 3:]
    if error:
        velocity = velocity - np.asarray(trial.vessels[-1].motion)[:, 3:]
    if align == WAY:
        return Course(trial.name, way_run(trial.north, trial.east), velocity)
    zero = float(trial.time[0]) if align == START else moments(trial).get(align)
    return None if zero is None else Course(trial.name, trial.time - zero, velocity)


def way_run(north: Floats, east: Floats) -> Floats:
    """Places (n,) [m] -> length of the track up to each (n,) [m]."""
    steps = np.hypot(np.diff(north), np.diff(east))
    return np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps))])


def several_velocities(courses: Sequence[Course], axis: Axis, what: str) -> FigureData:
    """u, v, r of all courses, each in a colour of its own; `what` they are, as a title."""
    panels = tuple(
        Panel(
            axis, quantity,
            tuple(
                Line(one.x, one.velocity[:, i] * quantity.factor, SeriesRole.CONTEXT, one.name,
                     SEVERAL[k % len(SEVERAL)])
                for k, one in enumerate(courses)
            ),
        )
        for i, quantity in enumerate(VELOCITIES)
    )  # fmt: skip
    return FigureData(what, panels, shared_x=True)
