"""One moment of a recording in all pictures, moved by hand or played: the time cursor.

It runs in the browser alone, so that it is smooth whatever the server does; the server is told
where it stopped.
"""

from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
from bokeh.events import DocumentReady
from bokeh.layouts import row
from bokeh.models import ColumnDataSource, CustomJS, Div, Select, Slider, Toggle

from gateway.figures.bokeh_draw import LinkedView
from gateway.figures.figure_data import SeriesRole
from gateway.studio.page import STYLE
from gateway.studio.views import TrialView, VesselView
from sim.state import Floats

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
