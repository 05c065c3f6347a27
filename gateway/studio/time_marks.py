"""Marks in the time of a recording: a range as the input of all work, and the time cursor.

A range has numbers, a name, and says whether it alone is used. The cursor is one moment in all
pictures, moved by hand or played. It runs in the browser alone, so that it is smooth whatever the
server does; the server is told where it stopped.
"""

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
from bokeh.events import DocumentReady
from bokeh.layouts import row
from bokeh.models import ColumnDataSource, CustomJS, Div, Select, Slider, Toggle

from gateway.errors import BadInput
from gateway.figures import SeriesRole, velocity_texts
from gateway.figures.bokeh_draw import LinkedView
from gateway.studio import WHOLE, Scope, TimeRanges, TrialView, VesselView, inside
from gateway.studio.page import STYLE, Page, button, control_row, field, html, select, stack
from gateway.studio.session import Session
from sim.state import Floats

ALL, ONLY, WITHOUT = "all of the time", "only what is marked", "all but what is marked"
NONE = "–"


class ScopeLine:
    """That not all of the time is worked on; empty where all of it is."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.part = html()

    def update(self) -> None:
        """Say what is worked on now."""
        text = self._session.scope.text
        self.part.object = f"<p class='warn'>Worked on {escape(text)}.</p>" if text else ""


class RangeControls:
    """Below the choice of a recording: use the mark, keep it under a name, mark what was kept.

    mark    what to do to mark stretches of a recording
    marked  which recording is shown, and what is marked on it
    """

    def __init__(
        self,
        page: Page,
        mark: Callable[[str, TimeRanges], None],
        marked: Callable[[], tuple[str, TimeRanges]],
    ) -> None:
        self._page, self._session, self._mark, self._marked = page, page.session, mark, marked
        self._quiet = False
        self._use = select("Compare, diagnose and fit on", [ALL, ONLY, WITHOUT], width=230)
        self._name = field("Name of the marked range", width=190)
        self._kept = select("Kept ranges", [NONE], width=190)
        self._use.param.watch(self._chosen(self._apply), "value")
        self._kept.param.watch(self._chosen(self._show_kept), "value")
        self._numbers = html()
        self.part = stack(
            control_row(
                self._use, self._name, button("Keep", page.guarded(self._keep), width=80),
                self._kept, button("Forget", page.guarded(self._forget), width=90),
            ),
            self._numbers,
        )  # fmt: skip

    def update(self) -> None:
        """After the layout or what is worked on has changed."""
        self._quiet = True
        self._kept.options = [NONE, *self._session.layout.ranges]
        scope = self._session.scope
        self._use.value = ALL if not scope.times else WITHOUT if scope.without else ONLY
        self._quiet = False

    def show_numbers(self, trial: TrialView | None, vessel: VesselView | None) -> None:
        """The errors within what is marked."""
        times = self._marked()[1]
        self._numbers.object = range_text(trial, vessel, times) if trial and vessel else ""

    def follow(self) -> None:
        """Another range was marked: where one is worked on, it is that one from now on."""
        scope, (name, times) = self._session.scope, self._marked()
        if scope.times and scope.recording == name and times and scope.times != times:
            self._session.set_scope(Scope(name, times, scope.without))

    def _chosen(self, work: Callable[[], None]) -> Callable[[Any], None]:
        def run(_: Any) -> None:
            if not self._quiet:
                self._page.guarded(work)()

        return run

    def _apply(self) -> None:
        name, times = self._marked()
        if self._use.value == ALL:
            self._session.set_scope(WHOLE)
        elif not times:
            self.update()
            raise BadInput("mark a stretch of time first: drag along a time axis")
        else:
            self._session.set_scope(Scope(name, times, self._use.value == WITHOUT))

    def _keep(self) -> None:
        name = self._name.value.strip()
        self._session.keep_range(name, *self._marked())
        self._page.notify(f"range {name} kept", good=True)

    def _show_kept(self) -> None:
        kept = self._session.layout.ranges.get(self._kept.value)
        if kept is not None:
            self._name.value = self._kept.value
            self._mark(kept.recording, kept.times)

    def _forget(self) -> None:
        if self._kept.value == NONE:
            raise BadInput("choose a kept range first")
        self._session.forget_range(self._kept.value)


def range_text(trial: TrialView, vessel: VesselView, times: TimeRanges) -> str:
    """Errors of the free predictions within stretches of time; nothing where none is marked."""
    if not times or vessel.motion is None:
        return ""
    error = (trial.motion - vessel.motion)[inside(trial.time, times)][:, 3:]
    known = np.isfinite(error).all(axis=1)
    seconds = sum(end - start for start, end in times)
    if not known.any():
        return f"<p>Marked: {seconds:.0f} s, without any prediction in them.</p>"
    rmse = dict(zip("uvr", np.sqrt((error[known] ** 2).mean(axis=0)), strict=True))
    u, v, r = velocity_texts(rmse)
    return (f"<p>Marked: {seconds:.0f} s; there {escape(vessel.name)} is off by {u} m/s ahead, "
            f"{v} m/s sideways and {r} °/s, root mean square.</p>")  # fmt: skip


SCRIPT = (Path(__file__).parent / "playback.js").read_text(encoding="utf-8")
SPEEDS = ("1", "2", "5", "10", "20")
NAMES = ("n", "e", "psi", "u", "v", "r")
SMALLEST_BOAT_M, OF_TRACK = 2.0, 0.04  # length of the boats on the track, and as a share of it
SIGNIFICANT = 2.0  # standard deviations: a missing force below that is not drawn


class Playback:
    """A slider over the time of a recording, a button that plays it, the numbers of the moment."""

    def __init__(self, view: LinkedView) -> None:
        theme = view.theme
        self._path = ColumnDataSource({})
        style = {"stylesheets": [STYLE]}
        self._slider = Slider(start=0.0, end=1.0, value=0.0, step=0.1, title="Time [s]",
                              sizing_mode="stretch_width", **style)  # fmt: skip
        self._play = Toggle(label="Play", width=80, name="playing", align="end", **style)
        speed = Select(title="Speed", value="1", options=[(s, f"{s} ×") for s in SPEEDS],
                       width=80, **style)  # fmt: skip
        self._readout = Div(text="", sizing_mode="stretch_width",
                            styles={"color": theme.ink, "font-size": "14px"})  # fmt: skip
        shared = {
            "slider": self._slider, "play": self._play, "speed": speed, "readout": self._readout,
            "path": self._path, "now": view.now, "boats": view.boats, "arrow": view.arrow,
            "measured_colour": theme.colour(SeriesRole.MEASURED),
            "model_colour": theme.colour(SeriesRole.MODEL),
        }  # fmt: skip

        def script(what: str) -> Any:
            return CustomJS(args=shared | {"what": what}, code=SCRIPT)

        self._slider.js_on_change("value", script("slide"))
        self._path.js_on_change("data", script("slide"))
        self._play.js_on_change("active", script("play"))
        view.on_tap = script("tap")
        if pn.state.curdoc is not None:  # data that are there already change nothing
            pn.state.curdoc.js_on_event(DocumentReady, script("slide"))
        self.part = row(self._play, speed, self._slider, sizing_mode="stretch_width")
        self.readout = self._readout
        self._at = self._left = self._slider.value

    def show(self, trial: TrialView, vessel: VesselView | None, at: float | None) -> None:
        """Another recording, or another vessel on it; `at` [s] moves the cursor there."""
        start, end = float(trial.time[0]), float(trial.time[-1])
        value = at if at is not None and start <= at <= end else self._slider.value
        self._slider.update(start=start, end=end, value=min(max(value, start), end))
        self._at = self._left = self._slider.value
        self._path.data = _columns(trial, vessel)

    def left_at(self) -> float | None:
        """Where the cursor was left [s], once, as soon as it stands still; None else."""
        before, self._at = self._at, self._slider.value
        if self._at != before or self._at == self._left:
            return None
        self._left = self._at
        return float(self._at)


def _columns(trial: TrialView, vessel: VesselView | None) -> dict[str, Floats]:
    """Measured motion, the model's on the same rows, and the missing force."""
    count = len(trial.time)
    none: Floats = np.full((count, 6), np.nan)
    model = none if vessel is None or vessel.motion is None else vessel.motion
    force = none[:, :4] if vessel is None or vessel.force is None else vessel.force
    size = np.hypot(force[:, 0], force[:, 1])
    known = size[np.isfinite(size)]
    largest = float(np.quantile(known, 0.95)) if len(known) else 1.0
    extent = max(float(np.ptp(trial.north)), float(np.ptp(trial.east)))
    length = max(SMALLEST_BOAT_M, OF_TRACK * extent)
    return {
        "t": trial.time,
        **{name: trial.motion[:, i] for i, name in enumerate(NAMES)},
        **{f"model_{name}": model[:, i] for i, name in enumerate(NAMES)},
        "X": force[:, 0], "Y": force[:, 1],
        "noise": SIGNIFICANT * np.hypot(force[:, 2], force[:, 3]),
        "length": np.full(count, length), "largest": np.full(count, max(largest, 1e-6)),
    }  # fmt: skip
