"""Several recordings on one plot of the page Compare: velocities, or errors of a model.

They are laid over one another at a moment of each, or along the way that they ran through.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gateway.figures.bokeh_draw import LinkedView
from gateway.figures.figure_data import Axis, FigureData, Line, Panel, SeriesRole
from gateway.figures.style import SEVERAL, VELOCITIES
from gateway.studio.controls import FigurePlace
from gateway.studio.page import Page, boxes, control_row, html, select, stack
from gateway.studio.views import TrialView
from sim.state import Floats

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
    """What can be laid over one another: what began or happened in a recording, and when [s]."""
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
