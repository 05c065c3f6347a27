"""Compare: how far the model is from the measurement, and where; what is marked in one picture is
marked in all.
"""

import math
from collections.abc import Callable
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn

from gateway.config import StudioSettings
from gateway.figures.bokeh_draw import BokehFigure
from gateway.ingest.earth import Origin
from gateway.studio.map_tiles import MapSwitch, Underlay
from gateway.studio.page import Page
from gateway.studio.session import Session
from gateway.studio.views import Ranges, TrialView, VesselView
from gateway.studio.widgets import (
    button,
    card,
    controls,
    download,
    html,
    select,
    table,
    word,
)
from sim.comparison.compare import ADEQUATE_FLOORS

PICTURES = ("velocities", "residuals", "track", "strips", "forces")
HEADINGS = {
    "velocities": "Velocities",
    "residuals": "Error over time: measured − model",
    "track": "Track",
    "strips": "Size of the error",
    "forces": word("missing force", "Missing force"),
}
THREE = f"{word('surge u')}, {word('sway v')} and {word('yaw rate r')}"
HINTS = {
    "velocities": f"{THREE}. Drag along the time axis to mark a stretch: it is marked on the track "
    f"too. The model starts anew from the measurement at every gap: after one {word('horizon')}.",
    "residuals": "",
    "track": "North is up.",
    "strips": f"Each row is a velocity, each cell a {word('regime')}; what stands out most is "
    "worst.",
    "forces": "What the model lacks. Within the grey band it is noise of a single estimate.",
}


class Compare(Page):
    """Recordings × vessels."""

    name, title = "compare", "Compare"

    def __init__(self, desk: Session, settings: StudioSettings) -> None:
        super().__init__(desk)
        self._settings, self._map = settings, MapSwitch(settings)
        self._mapped: BokehFigure | None = None
        self._underlays: list[Underlay] = []
        self.stage.on_brush = self._brushed
        self._pictures: dict[str, BokehFigure] = {}
        self._places = {name: pn.Column(sizing_mode="stretch_width") for name in PICTURES}
        self._headline, self._numbers = html(), html()
        self._worst = pn.Column(sizing_mode="stretch_width")
        self._which = select("Recording", [], width=240)
        self._vessel = select("Vessel", [], width=240)
        self._which.param.watch(lambda _: self.safely(self._chosen)(), "value")
        self._vessel.param.watch(lambda _: self.safely(self._chosen)(), "value")
        self._clear = button("Clear the mark", self._unmark, width=140)
        self._report = button("Write a report", self.safely(desk.make_report), width=140)
        self._get = download("Download the report", "report.html", self._page, width=180,
                             visible=False)  # fmt: skip
        self._window: tuple[float, float] | None = None

    def body(self) -> Any:
        """Numbers above, pictures below."""
        choose = controls(self._which, self._vessel, self._clear, self._report, self._get)
        more = {"track": (self._map.box, self._map.credit)}
        parts = {
            name: card(html(f"<h2>{HEADINGS[name]}</h2><p class='faint'>{HINTS[name]}</p>"),
                       place, *more.get(name, ())) for name, place in self._places.items()
        }  # fmt: skip
        return pn.Column(
            card(self._headline, self._numbers, choose),
            card(html("<h2>Where it is worst</h2><p class='faint'>Press one: it is marked in all "
                      "pictures.</p>"), self._worst),
            *parts.values(), sizing_mode="stretch_width",
        )  # fmt: skip

    def watch(self) -> dict[tuple[str, ...], Callable[[], None]]:
        """Everything follows the comparison."""
        return {("trials",): self._compared, ("report",): self._tell_report}

    def tick(self) -> None:
        """While the user pans and zooms, lines get as many points as the window deserves."""
        time = self.stage.time
        window = None if time is None else (time.start, time.end)
        if window != self._window and window is not None:
            self._window = window
            for picture in self._pictures.values():
                picture.resample(*window)
        self._lay()

    def _lay(self) -> None:
        """The map below the tracks, once it was asked for."""
        picture, trial = self._pictures.get("track"), self._trial()
        place = trial.origin_deg if trial else None
        if self._map.on and picture is not None and picture is not self._mapped:
            self._mapped = picture
            self._underlays = [Underlay(fig, self._settings, self.look) for fig in picture.figures]
        for one in self._underlays:
            one.show(Origin(*place) if self._map.on and place else None)
        self._map.tell(place is not None)

    def _compared(self) -> None:
        trials = self.desk.trials
        self._headline.object = _headline(trials)
        self._numbers.object = _numbers(trials)
        names = [trial.name for trial in trials]
        if self._which.options != names:
            self._which.options = names
            if self._which.value not in names and names:
                self._which.value = names[0]
        self._chosen()

    def _trial(self) -> TrialView | None:
        return next((t for t in self.desk.trials if t.name == self._which.value), None)

    def _chosen(self) -> None:
        trial = self._trial()
        if trial is None:
            for name, place in self._places.items():
                self.fill(place, None, self._pictures, name)
            return
        self._retime(trial)
        names = [v.name for v in trial.vessels]
        if self._vessel.options != names:
            self._vessel.options = names
            self._vessel.value = names[-1] if names else None
        view = next((v for v in trial.vessels if v.name == self._vessel.value), None)
        for name, place in self._places.items():
            data = view.pictures[name] if view else trial.measured if name == "velocities" else None
            self.fill(place, data, self._pictures, name)
        self._regimes(view)

    def _retime(self, trial: TrialView) -> None:
        """Another recording has another time axis."""
        time, start, end = self.stage.time, float(trial.time[0]), float(trial.time[-1])
        if time is not None and time.bounds != (start, end):
            time.update(bounds=(start, end), start=start, end=end)
            self._unmark()

    def _regimes(self, view: VesselView | None) -> None:
        if view is None:
            self._worst.objects = [html("<p class='faint'>comparing …</p>")]
        elif not view.worst:
            self._worst.objects = [html("<p class='good'>Nowhere worse than noise.</p>")]
        else:
            self._worst.objects = [
                button(one.says, self._marker(one.spans), sizing_mode="stretch_width",
                       margin=(3, 0))
                for one in view.worst
            ]  # fmt: skip

    def _marker(self, spans: Ranges) -> Callable[[], None]:
        return self.safely(lambda: self._mark(spans))

    def _brushed(self, start: float, end: float) -> None:
        self.safely(lambda: self._mark(((start, end),)))()

    def _unmark(self) -> None:
        self._mark(())

    def _mark(self, spans: Ranges) -> None:
        """Bands over time, and the same moments on the track."""
        starts, ends = [a for a, _ in spans], [b for _, b in spans]
        self.stage.spans.data = {"x0": starts, "x1": ends}
        trial = self._trial()
        if trial is None:
            return
        inside = np.zeros(len(trial.time), bool)
        for start, end in spans:
            inside |= (trial.time >= start) & (trial.time <= end)
        self.stage.points.data = {
            "x": np.where(inside, trial.east, np.nan), "y": np.where(inside, trial.north, np.nan)
        }  # fmt: skip

    def _tell_report(self) -> None:
        if self.desk.report:
            self._get.visible = True
            self.desk.say(f"report written: {self.desk.report}", good=True)

    def _page(self) -> BytesIO:
        return BytesIO(Path(self.desk.report).read_bytes())


def _headline(trials: tuple[TrialView, ...]) -> str:
    """One sentence: is the model right?"""
    views = [(t, v) for t in trials for v in t.vessels]
    if not views:
        return "<h1>Is the model right?</h1><p>Comparing …</p>"
    parts = []
    for trial in trials:
        if not trial.vessels:
            continue
        first, last = trial.vessels[0], trial.vessels[-1]
        times = last.nrmse / max(last.floor, 1e-9)
        fell = f" (it was {first.nrmse:.2f} as given)" if len(trial.vessels) > 1 else ""
        good = times <= ADEQUATE_FLOORS
        says = "no more than noise" if good else f"{times:.1f} times what noise alone would show"
        parts.append(f"<p>{escape(trial.name)}: error <strong>{last.nrmse:.2f}</strong>{fell}, "
                     f"<span class='{'good' if good else 'warn'}'>{says}</span>.</p>")  # fmt: skip
    return "<h1>Is the model right?</h1>" + "".join(parts)


def _numbers(trials: tuple[TrialView, ...]) -> str:
    heads = ["recording", "vessel", word("nrmse"), word("95 % interval"), word("noise floor"),
             word("surge u") + " m/s", word("sway v") + " m/s",
             word("yaw rate r") + " °/s"]  # fmt: skip
    rows = [
        [f"{escape(t.name)}, {t.seconds:.0f} s", escape(v.name), f"{v.nrmse:.3f}",
         f"{v.ci95[0]:.2f}–{v.ci95[1]:.2f}" if v.ci95 else "", f"{v.floor:.3f}",
         f"{v.rmse['u']:.3f}", f"{v.rmse['v']:.3f}", f"{math.degrees(v.rmse['r']):.2f}"]
        for t in trials for v in t.vessels
    ]  # fmt: skip
    notes = dict.fromkeys(n for t in trials for n in t.notices)
    return table(heads, rows, text=(0, 1)) + "".join(
        f"<p class='warn'>{escape(note)}</p>" for note in notes
    )
