"""Compare: how far the model is from the measurement, and where.

What is marked in one figure is marked in all.
"""

from collections.abc import Callable
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from gateway.figures.style import velocity_texts
from gateway.ingest.earth import Origin
from gateway.studio.map_tiles import TileMap
from gateway.studio.page import (
    FigurePlace,
    Page,
    StudioContext,
    Watches,
    button,
    card,
    control_row,
    download,
    html,
    section,
    select,
    stack,
    table,
    word,
)
from gateway.studio.tasks import TimeRanges, TrialView, VesselView
from sim.comparison.compare import ADEQUATE_FLOORS

THREE = f"{word('surge u')}, {word('sway v')} and {word('yaw rate r')}"
FIGURES = {  # name -> heading, hint
    "velocities": (
        "Velocities",
        f"{THREE}. Drag along the time axis to mark a stretch: it is marked on the track too. "
        f"The model starts anew from the measurement at every gap: after one {word('horizon')}.",
    ),
    "residuals": ("Error over time: measured − model", ""),
    "track": ("Track", "North is up."),
    "strips": (
        "Size of the error",
        f"Each row is a velocity, each cell a {word('regime')}; what stands out most is worst.",
    ),
    "forces": (
        word("missing force", "Missing force"),
        "What the model lacks. Within the grey band it is noise of a single estimate.",
    ),
}


class ComparePage(Page):
    """Recordings × vessels."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._map = TileMap(context.settings, self.theme)
        self.view.on_brush = lambda start, end: self._marker(((start, end),))()
        self._places = {name: FigurePlace(self.view) for name in FIGURES}
        self._headline, self._numbers, self._worst = html(), html(), stack()
        self._which = select("Recording", [], width=240)
        self._vessel = select("Vessel", [], width=240)
        for choice in (self._which, self._vessel):
            choice.param.watch(lambda _: self.guarded(self._show_chosen)(), "value")
        self._clear = button("Clear the mark", lambda: self._mark(()), width=140)
        self._report = button("Write a report", self.guarded(self.session.write_report), width=140)
        self._get = download(
            "Download the report", "report.html",
            lambda: BytesIO(Path(self.session.report).read_bytes()), width=180, visible=False,
        )  # fmt: skip
        self._window: tuple[float, float] | None = None

    def body(self) -> Any:
        """Numbers above, figures below."""
        choose = control_row(self._which, self._vessel, self._clear, self._report, self._get)
        more = {"track": (self._map.box, self._map.credit)}
        return stack(
            card(self._headline, self._numbers, choose),
            section("Where it is worst", "Press one: it is marked in all pictures.", self._worst),
            *(section(*FIGURES[name], place.part, *more.get(name, ()))
              for name, place in self._places.items()),
        )  # fmt: skip

    def watch(self) -> Watches:
        """Everything follows the comparison."""
        return {("trials",): self._show_trials, ("report",): self._show_report}

    def tick(self) -> None:
        """While the user pans and zooms, lines get as many points as the window deserves."""
        time = self.view.time
        window = None if time is None else (time.start, time.end)
        if window != self._window and window is not None:
            self._window = window
            for place in self._places.values():
                if place.figure is not None:
                    place.figure.resample(*window)
        track, trial = self._places["track"].figure, self._trial()
        origin = trial.origin_deg if trial else None
        self._map.show(track.figures if track else [], Origin(*origin) if origin else None)

    def _show_trials(self) -> None:
        trials = self.session.trials
        self._headline.object = _headline(trials)
        self._numbers.object = _numbers(trials)
        names = [trial.name for trial in trials]
        if self._which.options != names:
            self._which.options = names
            if self._which.value not in names and names:
                self._which.value = names[0]
        self._show_chosen()

    def _trial(self) -> TrialView | None:
        return next((t for t in self.session.trials if t.name == self._which.value), None)

    def _show_chosen(self) -> None:
        trial = self._trial()
        if trial is None:
            for place in self._places.values():
                place.show(None)
            return
        self._set_time_axis(trial)
        names = [v.name for v in trial.vessels]
        if self._vessel.options != names:
            self._vessel.options = names
            self._vessel.value = names[-1] if names else None
        vessel = next((v for v in trial.vessels if v.name == self._vessel.value), None)
        figures = vessel.figures if vessel else {"velocities": trial.measured}
        for name, place in self._places.items():
            place.show(figures.get(name))
        self._show_regimes(vessel)

    def _set_time_axis(self, trial: TrialView) -> None:
        """Another recording has another time axis."""
        time, start, end = self.view.time, float(trial.time[0]), float(trial.time[-1])
        if time is not None and time.bounds != (start, end):
            time.update(bounds=(start, end), start=start, end=end)
            self._mark(())

    def _show_regimes(self, vessel: VesselView | None) -> None:
        if vessel is None:
            self._worst.objects = [html("<p class='faint'>comparing …</p>")]
        elif not vessel.worst:
            self._worst.objects = [html("<p class='good'>Nowhere worse than noise.</p>")]
        else:
            self._worst.objects = [
                button(regime.text, self._marker(regime.times), sizing_mode="stretch_width",
                       margin=(3, 0))
                for regime in vessel.worst
            ]  # fmt: skip

    def _marker(self, times: TimeRanges) -> Callable[[], None]:
        return self.guarded(lambda: self._mark(times))

    def _mark(self, times: TimeRanges) -> None:
        """Bands over time, and the same moments on the track."""
        self.view.spans.data = {"x0": [a for a, _ in times], "x1": [b for _, b in times]}
        trial = self._trial()
        if trial is None:
            return
        inside = np.zeros(len(trial.time), bool)
        for start, end in times:
            inside |= (trial.time >= start) & (trial.time <= end)
        self.view.points.data = {
            "x": np.where(inside, trial.east, np.nan), "y": np.where(inside, trial.north, np.nan)
        }  # fmt: skip

    def _show_report(self) -> None:
        if self.session.report:
            self._get.visible = True
            self.session.notify(f"report written: {self.session.report}", good=True)


def _headline(trials: tuple[TrialView, ...]) -> str:
    """One sentence for each recording: is the model right?"""
    parts = []
    for trial in trials:
        if not trial.vessels:
            continue
        first, last = trial.vessels[0], trial.vessels[-1]
        times = last.nrmse / max(last.floor, 1e-9)
        fell = f" (it was {first.nrmse:.2f} as given)" if len(trial.vessels) > 1 else ""
        good = times <= ADEQUATE_FLOORS
        text = "no more than noise" if good else f"{times:.1f} times what noise alone would show"
        parts.append(f"<p>{escape(trial.name)}: error <strong>{last.nrmse:.2f}</strong>{fell}, "
                     f"<span class='{'good' if good else 'warn'}'>{text}</span>.</p>")  # fmt: skip
    return "<h1>Is the model right?</h1>" + ("".join(parts) or "<p>Comparing …</p>")


def _numbers(trials: tuple[TrialView, ...]) -> str:
    heads = ["recording", "vessel", word("nrmse"), word("95 % interval"), word("noise floor"),
             word("surge u") + " m/s", word("sway v") + " m/s",
             word("yaw rate r") + " °/s"]  # fmt: skip
    rows = [
        [f"{escape(t.name)}, {t.seconds:.0f} s", escape(v.name), f"{v.nrmse:.3f}",
         f"{v.ci95[0]:.2f}–{v.ci95[1]:.2f}" if v.ci95 else "", f"{v.floor:.3f}",
         *velocity_texts(v.rmse)]
        for t in trials for v in t.vessels
    ]  # fmt: skip
    notes = dict.fromkeys(n for t in trials for n in t.notices)
    return table(heads, rows, text=(0, 1)) + "".join(
        f"<p class='warn'>{escape(note)}</p>" for note in notes
    )
