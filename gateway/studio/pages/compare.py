"""Compare: how far the model is from the measurement, and where.

What is marked in one figure is marked in all.
"""

import re
from collections.abc import Callable
from functools import partial
from html import escape
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures import velocity_texts
from gateway.figures.motion import with_earlier_model
from gateway.figures.words import judgement_text, nowhere_text
from gateway.ingest.mapping import Origin
from gateway.studio import TimeRanges, TrialView, VesselView, inside, ranges_in, ranges_text
from gateway.studio.controls import FigurePlace, SeveralRecordings, report_download
from gateway.studio.map_tiles import TileMap
from gateway.studio.page import (
    Page,
    StudioContext,
    Watches,
    bokeh_part,
    button,
    card,
    control_row,
    html,
    section,
    select,
    stack,
    table,
    word,
)
from gateway.studio.session import Session
from gateway.studio.time_marks import Playback, RangeControls, ScopeLine
from sim.comparison.compare import Judgement

THREE = f"{word('surge u')}, {word('sway v')} and {word('yaw rate r')}"
FIGURES = {  # name -> heading, hint
    "velocities": (
        "Velocities",
        f"{THREE}. Drag along the time axis to mark a stretch: it is marked on the track too. "
        f"The model starts anew from the measurement at every gap: after one {word('horizon')}.",
    ),
    "commands": (
        "Commands, mode, armed and events",
        "What was sent to each output; a gap where the boat was disarmed. Below it on the same "
        "time axis what the recording says of itself; texts show under the pointer.",
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
    "correlations": (
        "What the errors follow",
        "Errors over one step after themselves and after the commands. Within the band they are as "
        "independent as chance; outside it, dynamics are missing.",
    ),
}


class ComparePage(Page):
    """Recordings × vessels."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._map = TileMap(context.settings, self.theme)
        self.view.on_brush = lambda start, end: self._marker(((start, end),))()
        self._playback = Playback(self.view)
        self._places = {name: FigurePlace(self.view) for name in FIGURES}
        self._headline, self._numbers, self._worst = html(), html(), stack()
        self._scope = ScopeLine(self.session)
        self._ranges = RangeControls(self, self._mark_on, lambda: (self._shown, self._marked))
        self._several = SeveralRecordings(self)
        self._which = select("Recording", [], width=240)
        self._vessel = select("Vessel", [], width=240)
        for name, choice in (("recording", self._which), ("vessel", self._vessel)):
            choice.param.watch(partial(self._chosen, name), "value")
        self._clear = button("Clear the mark", self._marker(()), width=140)
        self._report = button("Write a report", self.guarded(self.session.write_report), width=140)
        self._get = report_download(self)
        self._window: tuple[float, float] | None = None
        at = self.address.read("at") or ""
        self._at = float(at) if re.fullmatch(r"\d+(\.\d+)?", at) else None
        self._marked: TimeRanges = ()
        self._shown = ""  # the trial whose time axis and mark are shown
        self._quiet = False  # choices are made by the page itself

    def body(self) -> Any:
        """Numbers above, figures below."""
        choose = control_row(self._which, self._vessel, self._clear, self._report, self._get)
        more = {"track": (self._map.part,)}
        moment = card(
            html("<h2>The moment</h2><p class='faint'>Move the time or click on a time axis: all "
                 "pictures show that moment. Space plays it. Boats on the track: measured and free "
                 "prediction, the arrow is the missing force where it is more than noise.</p>"),
            bokeh_part(self._playback.part), bokeh_part(self._playback.readout),
        )  # fmt: skip
        return stack(
            card(self._headline, self._scope.part, self._numbers, choose, self._ranges.part),
            moment,
            section("Where it is worst", "Press one: it is marked in all pictures.", self._worst),
            *(section(*FIGURES[name], place.part, *more.get(name, ()))
              for name, place in self._places.items()),
            section("Several recordings on one plot", "Of the vessel as it is now.",
                    self._several.part),
        )  # fmt: skip

    def watch(self) -> Watches:
        """Everything follows the comparison."""
        return {
            ("trials",): self._show_trials,
            ("trials", "vessel", "logs"): self._show_headline,
            ("report",): self._show_report,
            ("scope", "layout"): self._show_scope,
        }

    def tick(self) -> None:
        """While the user pans and zooms, lines get as many points as the window deserves."""
        time = self.view.time
        window = None if time is None else (time.start, time.end)
        if window != self._window and window is not None:
            self._window = window
            for place in self._places.values():
                if place.figure is not None:
                    place.figure.resample(*window)
        if (moment := self._playback.left_at()) is not None:
            self.address.write(at=f"{moment:.1f}")
        track, trial = self._places["track"].figure, self._trial()
        origin = trial.origin_deg if trial else None
        self._map.show(track.figures if track else [], Origin(*origin) if origin else None)

    def _show_trials(self) -> None:
        trials = self.session.trials
        self._numbers.object = _numbers(trials)
        names = [trial.name for trial in trials]
        first = self._which.value or (names[0] if names else None)
        self._offer("recording", self._which, names, first)
        self._show_chosen()
        self._several.update(trials)

    def _offer(self, name: str, choice: Any, names: list[str], now: str | None = None) -> None:
        """Names to choose from; what the address says is chosen, else `now`, else the last."""
        if choice.options == names:
            return
        wanted = (self.address.read(name), now, *names[-1:])
        self._quiet = True
        choice.options = names
        choice.value = next((one for one in wanted if one in names), None)
        self._quiet = False

    def _chosen(self, name: str, event: Any) -> None:
        """The user chose a recording or a vessel: a mark belongs to its recording."""
        if self._quiet:
            return
        self.address.write(**{name: event.new})
        if name == "recording":
            self.address.write(range=None)
        self.caught(self._show_chosen)

    def _show_headline(self) -> None:
        self._headline.object = _headline(self.session)

    def _trial(self) -> TrialView | None:
        return next((t for t in self.session.trials if t.name == self._which.value), None)

    def _show_chosen(self) -> None:
        trial = self._trial()
        if trial is None:
            for place in self._places.values():
                place.show(None)
            return
        self._set_time_axis(trial)
        self._offer("vessel", self._vessel, [v.name for v in trial.vessels])
        vessel = next((v for v in trial.vessels if v.name == self._vessel.value), None)
        figures = {"velocities": trial.measured, "commands": trial.commands}
        figures |= vessel.figures if vessel else {}
        if vessel is not None and vessel is not trial.vessels[0]:
            figures["velocities"] = with_earlier_model(
                trial.vessels[0].figures["velocities"], vessel.figures["velocities"]
            )
        self._playback.show(trial, vessel, self._at)
        self._at = None
        for name, place in self._places.items():
            place.show(figures.get(name))
        self._show_regimes(vessel)
        self._show_range()

    def _show_range(self) -> None:
        """The errors within what is marked, of the vessel that is shown, beside the whole."""
        trial = self._trial()
        vessels = trial.vessels if trial else ()
        vessel = next((v for v in vessels if v.name == self._vessel.value), None)
        self._ranges.show_numbers(trial, vessel)

    def _show_scope(self) -> None:
        """Show the stretches that are worked on, and the ranges that are kept."""
        self._scope.update()
        self._ranges.update()

    def _set_time_axis(self, trial: TrialView) -> None:
        """Another recording has another time axis."""
        time, start, end = self.view.time, float(trial.time[0]), float(trial.time[-1])
        if time is not None and time.bounds != (start, end):
            time.update(bounds=(start, end), start=start, end=end)
        if self._shown != trial.name:
            self._shown = trial.name
            self._mark(ranges_in(self.address.read("range")))

    def _show_regimes(self, vessel: VesselView | None) -> None:
        if vessel is None:
            self._worst.objects = [html("<p class='faint'>not compared yet</p>")]
        elif not vessel.worst:
            good = vessel.standing.judgement is Judgement.ADEQUATE
            text = nowhere_text(vessel.standing)
            self._worst.objects = [
                html(f"<p class='{'good' if good else 'warn'}'>{text[0].upper()}{text[1:]}.</p>")
            ]
        else:
            self._worst.objects = [
                button(regime.text, self._marker(regime.times), sizing_mode="stretch_width",
                       margin=(3, 0))
                for regime in vessel.worst
            ]  # fmt: skip

    def _marker(self, times: TimeRanges) -> Callable[[], None]:
        return self.guarded(lambda: self._mark_here(times))

    def _mark(self, times: TimeRanges) -> None:
        """Bands over time, and the same moments on the track; the address holds them."""
        self.address.write(range=ranges_text(times))
        self.view.spans.data = {"x0": [a for a, _ in times], "x1": [b for _, b in times]}
        self._marked = times
        trial = self._trial()
        self._show_range()
        if trial is None:
            return
        there = inside(trial.time, times)
        self.view.points.data = {
            "x": np.where(there, trial.east, np.nan), "y": np.where(there, trial.north, np.nan)
        }  # fmt: skip

    def _mark_here(self, times: TimeRanges) -> None:
        """The user marks: what is worked on follows, where it is what is marked."""
        self._mark(times)
        self._ranges.follow()

    def _mark_on(self, recording: str, times: TimeRanges) -> None:
        """Mark stretches of a recording, which is shown from then on."""
        if recording not in self._which.options:
            raise BadInput(f"that range is of {recording}, which is not worked on")
        if recording != self._which.value:
            self._which.value = recording
        self._mark_here(times)

    def _show_report(self) -> None:
        if self.session.report:
            self._get.visible = True


def _headline(session: Session) -> str:
    """One sentence for each recording: is the model right? And why there is none."""
    parts = [_verdict(trial, session.is_current) for trial in session.trials if trial.vessels]
    parts += [f"<p class='warn'>Not compared: {escape(why)}</p>"
              for why in session.refused.values()]  # fmt: skip
    if not session.logs or not session.versions:
        parts.append("<p>Choose a recording and a vessel under <a href='recordings'>Recordings</a>."
                     "</p>")  # fmt: skip
    elif not session.is_current and (session.quick.busy or not session.refused):
        parts.append("<p class='faint'>Comparing the vessel as it is now …</p>")
    return "<h1>Is the model right?</h1>" + "".join(parts)


def _verdict(trial: TrialView, current: bool) -> str:
    """Of one recording; in grey where the vessel has been changed since."""
    first, last = trial.vessels[0], trial.vessels[-1]
    fell = f" (it was {first.nrmse:.2f} as given)" if len(trial.vessels) > 1 else ""
    good = last.standing.judgement is Judgement.ADEQUATE
    tone = ("good" if good else "warn") if current else "faint"
    since = "" if current else "; the vessel has been changed since"
    says = judgement_text(last.standing) + since
    return (f"<p>{escape(trial.name)}: error <strong>{last.nrmse:.2f}</strong>{fell}, "
            f"<span class='{tone}'>{says}</span>.</p>")  # fmt: skip


def _numbers(trials: tuple[TrialView, ...]) -> str:
    heads = ["recording", "vessel", word("nrmse"), word("95 % interval"), word("noise floor"),
             word("surge u") + " m/s", word("sway v") + " m/s",
             word("yaw rate r") + " °/s"]  # fmt: skip
    rows = [
        [f"{escape(t.name)}, {t.seconds:.0f} s", escape(v.name), f"{v.nrmse:.3f}",
         f"{v.ci95[0]:.2f}–{v.ci95[1]:.2f}" if v.ci95 else "", f"{v.standing.floor:.3f}",
         *velocity_texts(v.rmse)]
        for t in trials for v in t.vessels
    ]  # fmt: skip
    notes = dict.fromkeys(n for t in trials for n in t.notices)
    return table(heads, rows, text=(0, 1)) + "".join(
        f"<p class='warn'>{escape(note)}</p>" for note in notes
    )
