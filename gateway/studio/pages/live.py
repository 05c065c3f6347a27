"""Live: what is wrong, boats and shadows on a chart, strips of what they do, health and events.

The banner says what a live gateway says of the model of its boat, with a way from there to a
diagnosis.
"""

import math
import time
from collections.abc import Callable, Iterable
from html import escape
from typing import Any

import numpy as np
import panel as pn

from gateway.errors import BadInput, ShadowError
from gateway.files import write_whole
from gateway.ingest.mapping import Origin, distance_m, on_earth, to_degrees
from gateway.monitor import HIGH_LOSS, HIGH_NIS, VesselStatus, time_of_day
from gateway.studio.live_chart import Chart, Strips
from gateway.studio.live_history import (
    PAST_EVERY_S,
    PAST_S,
    Frozen,
    WatchedBoat,
    freeze_task,
    growing_recording,
)
from gateway.studio.map_tiles import TileMap
from gateway.studio.page import (
    FIXED,
    NO_BUTTON,
    STYLE,
    Page,
    StudioContext,
    button,
    card,
    html,
    section,
    select,
    side_by_side,
    stack,
    word,
)
from sim.effects.effect import LawError
from sim.monitoring.alarm import ModelEvent

ALERT = {
    "background": "var(--paper)", "border": "2px solid var(--warn)", "border-radius": "10px",
    "padding": "8px 14px", "margin": "0 0 14px 0", "flex-direction": "row", "flex-wrap": "wrap",
    "align-items": "center", "gap": "4px 14px",
}  # fmt: skip


def sentence_of(boat: WatchedBoat) -> str | None:
    """The gateway's present sentence on a model that is wrong; None where it says none.

    A boat that is not heard says nothing now, and what an earlier run of the gateway said is over.
    """
    if boat.status.silent_s is not None or boat.status.link_silent_s is not None:
        return None
    kinds = {event.value for event in ModelEvent}
    said = [e for e in boat.status.events
            if e["kind"] in kinds and e["receive_time_ns"] * 1e-9 > boat.gone]  # fmt: skip
    if not said or said[-1]["kind"] == ModelEvent.RIGHT.value:
        return None
    return str(said[-1]["says"])


class Banners:
    """A banner for each boat whose model is wrong, with a button that calls `diagnose(name)`."""

    def __init__(self, diagnose: Callable[[str], None]) -> None:
        self.part = stack(margin=0)
        self._diagnose = diagnose
        self._shown: list[tuple[str, str]] = []

    def show(self, boats: Iterable[WatchedBoat]) -> None:
        """Show the present sentence; a banner that stays the same keeps the keyboard's focus."""
        said = [(b.status.name, text) for b in boats if (text := sentence_of(b)) is not None]
        if [name for name, _ in said] != [name for name, _ in self._shown]:
            self.part.objects = [self._banner(name) for name, _ in said]
        for banner, (name, text) in zip(self.part.objects, said, strict=True):
            line = f"<p role='status'><strong>{escape(name)}</strong>: {escape(text)}.</p>"
            if banner[0].object != line:
                banner[0].object = line
        self._shown = said

    def _banner(self, name: str) -> Any:
        text = html()
        text.styles = {"flex": "1 1 20rem"}
        press = button("Diagnose this", lambda: self._diagnose(name), "primary", width=150)
        return pn.Column(text, press, styles=ALERT, sizing_mode="stretch_width",
                         stylesheets=[NO_BUTTON])  # fmt: skip


MOVED_M = 20.0  # an origin further off is another one
MOST_EVENTS = 8  # that are shown
HEALTH = {  # name of a line -> its label
    "link": "link silent for", "messages": "messages", "nis": word("NIS"), "gated": word("gated"),
    "fit": "data", "clock": word("clock offset"), "shadow": "shadow", "recorder": "recorder",
}  # fmt: skip
SHOWN = {"40 m around it": 40.0, "100 m around it": 100.0, "300 m around it": 300.0,
         "1 km around it": 1000.0, "all boats and tracks": 0.0}  # fmt: skip
NO_HEALTH = "<p class='faint'>no health message yet</p>"


class LivePage(Page):
    """Boats, shadows, health and events as the gateways publish them now."""

    period_ms = 100

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._which = select("Boat", [], width=240)
        self._which.param.watch(lambda _: self._begin_anew(), "value")
        self._across = select("Chart shows", SHOWN, width=190)
        asked = {f"{metres:g}": metres for metres in SHOWN.values()}
        self._across.value = asked.get(self.address.read("across") or "", 100.0)
        self._state, self._events, self._old, self._then = html(), html(), html(), html()
        self._pause = pn.widgets.Toggle(label="Pause", width=140, **FIXED)
        self._pause.param.watch(lambda event: self._paused(event.new), "value")
        self._back = pn.widgets.FloatSlider(
            label="Back from the pause [s]", start=0.0, end=PAST_S, step=PAST_EVERY_S, value=0.0,
            format="0.0", disabled=True, stylesheets=[STYLE], sizing_mode="stretch_width",
            margin=(6, 10),
        )  # fmt: skip
        self._paused_at: float | None = None  # Unix s
        self._shown_at: tuple[float, float] | None = None  # the moment, and how much of the chart
        self._remove = button(
            "Remove boats that are not heard", self.guarded(context.live.remove_silent),
            visible=False, width=240,
        )  # fmt: skip
        self._health = {name: html() for name in HEALTH}
        self._no_health = html(NO_HEALTH)
        self._chart, self._strips = Chart(self.theme), Strips(self.theme)
        self._across.param.watch(lambda event: self.address.write(across=f"{event.new:g}"), "value")
        for one in (self._across, self._which):  # after a zoom by hand the chart follows again
            one.jscallback(value="chart.reset.emit()", args={"chart": self._chart.figure})
        self._banners = Banners(lambda name: self.guarded(lambda: self._freeze(name))())
        self._leave = pn.widgets.TextInput(visible=False)  # where the browser goes next
        self._leave.jscallback(value="if (cb_obj.value) window.location.href = cb_obj.value")
        self._opens = False
        self._map = TileMap(context.settings, self.theme)
        self._origin: Origin | None = None

    def body(self) -> Any:
        """Chart and numbers side by side, strips below."""
        chart = section(
            "Chart", f"North is up. The arrow is the {word('missing force')}, where it stands out "
            f"of its noise. The {word('shadow')} follows the {word('reference')}.",
            self._across, pn.pane.Bokeh(self._chart.figure), self._map.part,
        )  # fmt: skip
        health = [_labelled(HEALTH[name], value) for name, value in self._health.items()]
        numbers = stack(
            card(self._which, self._state, self._remove),
            card(html("<h2>Health</h2>"), self._no_health, *health),
            card(html("<h2>Events</h2>"), self._events),
        )
        three = f"{word('surge u')}, {word('sway v')}, {word('yaw rate r')}"
        self._drawn = stack(*map(pn.pane.Bokeh, self._strips.velocities))
        self._lacks = stack(*map(pn.pane.Bokeh, self._strips.forces))
        strips = section("Velocities", f"{three} over one minute.", self._old, self._drawn)
        forces = section(word("missing force", "Missing force"), "What the model lacks, over one "
                         "minute. Within the grey band it is noise of a single estimate.",
                         self._lacks)  # fmt: skip
        time_card = card(stack(self._pause, self._back, self._then))
        return stack(self._banners.part, self._leave, side_by_side(chart, numbers), time_card,
                     strips, forces)  # fmt: skip

    def tick(self) -> None:
        """Take what came since."""
        boats = self.context.live.boats()
        names = [boat.status.name for boat in boats]
        if self._which.options != names:
            self._which.options = names
            asked = self.address.read("boat")
            if asked in names:
                self._which.value = asked
            elif self._which.value not in names and names:
                self._which.value = names[0]
        chosen = next((b for b in boats if b.status.name == self._which.value), None)
        self._banners.show(boats)
        if self._opens:
            self._opens, self._leave.value = False, "/diagnose"
        if self._paused_at is None:
            self._chart.show(boats, self._which.value, self._across.value)
        else:
            self._show_past(self._paused_at - self._back.value)
        if chosen is not None:
            self._origin = chart_origin(chosen.status, self._origin)
        self._map.show([self._chart.figure], self._origin)
        silent = any(boat.status.silent_s is not None for boat in boats)
        if self._remove.visible != silent:
            self._remove.visible = silent
        if chosen is None:
            self._show_nobody()
            return
        if self._paused_at is None:
            self._strips.show(chosen)
        self._show_age(chosen.status)
        _put(self._state, _state(chosen.status))
        health = _health(chosen.status)
        _put(self._no_health, "" if health else NO_HEALTH)
        for name, place in self._health.items():  # lines of their own: the keyboard's focus stays
            _put(place, health.get(name, ""))
        _put(self._events, _events(chosen.status))

    def _paused(self, paused: bool) -> None:
        """Chart and strips stand still at a moment, or follow again; the numbers always follow."""
        self._paused_at, self._shown_at = (time.time() if paused else None), None
        self._pause.label = "Follow again" if paused else "Pause"
        self._back.disabled, self._back.value = not paused, 0.0
        if not paused:
            _put(self._then, "")
            self._strips.clear()

    def _show_past(self, moment: float) -> None:
        """Chart and strips as they were at a moment [Unix s]."""
        if (moment, self._across.value) == self._shown_at:
            return
        self._shown_at = moment, self._across.value
        boats = self.context.live.as_of(moment)
        self._chart.show(boats, self._which.value, self._across.value)
        self._strips.clear()
        for boat in boats:
            if boat.status.name == self._which.value:
                self._strips.show(boat)
        nothing = "" if boats else " No boat had been heard then."
        _put(self._then, f"<p class='warn'>Paused: chart and strips show "
             f"{time_of_day(round(moment * 1e9))}, the numbers show now.{nothing}</p>")  # fmt: skip

    def _show_nobody(self) -> None:
        """No boat: where one would be looked for, and nothing of one that was."""
        where = escape(self.context.live.where)
        _put(self._state, f"<h1>No boat</h1><p>Nobody publishes at {where}. Start "
             "<code>shadow live ENDPOINT --vessel FILE</code>.</p>")  # fmt: skip
        _put(self._no_health, NO_HEALTH)
        for place in (*self._health.values(), self._events, self._old):
            _put(place, "")
        self._origin = None
        if self._paused_at is None:
            self._strips.clear()

    def _show_age(self, status: VesselStatus) -> None:
        """Strips of a boat that is not heard are grey, and say of when they are."""
        old, silence = status.silent_s is not None, _silence(status)
        what = "this is the last that came" if old else "what goes on is its shadow alone"
        _put(self._old, f"<p class='warn'>{silence}: {what}.</p>" if silence else "")
        styles = {"opacity": "0.4", "filter": "grayscale(1)"} if old else {}
        for part in (self._drawn, self._lacks):
            if part.styles != styles:
                part.styles = styles

    def _freeze(self, name: str) -> None:
        """Keep the last minutes of a boat, and work on them with the vessel of its gateway."""
        session = self.session
        if not session.is_saved:
            raise BadInput("the vessel has changes that are not saved: save it on the page Vessel")
        file = growing_recording(name, session.folders.recordings())

        def done(frozen: Frozen) -> None:
            vessel = session.folders.write / f"{frozen.file.stem}.toml"
            try:
                write_whole(vessel, frozen.vessel.encode(), "the vessel file")
                session.set_vessel(vessel)
                session.set_logs([frozen.file])
                session.diagnose()
            except (ShadowError, LawError) as error:
                session.notify(str(error))
                return
            self._opens = True

        session.start("the last minutes", freeze_task, str(file), str(session.folders.write),
                      done=done)  # fmt: skip

    def _begin_anew(self) -> None:
        self._origin = None
        self.address.write(boat=self._which.value)
        self._strips.clear()
        self._shown_at = None


def _put(place: Any, text: str) -> None:
    if place.object != text:
        place.object = text


def _labelled(label: str, value: Any) -> Any:
    """A label that stays, and beside it what changes."""
    name = html(f"<p>{label}</p>")
    name.styles, value.styles = {"flex": "0 0 8.5rem"}, {"flex": "1 1 9rem"}
    return stack(name, value, styles={"flex-direction": "row"}, stylesheets=[NO_BUTTON], margin=0)


def _silence(boat: VesselStatus) -> str:
    """Gone or silent, or only its link, for how long where that is known; empty: it is heard."""
    age = boat.silent_s
    if age is None:
        link = boat.link_silent_s
        return "" if link is None else f"link silent for {link:.0f} s"
    word = "silent" if boat.alive else "gone"
    return word if math.isinf(age) else f"{word} for {age:.0f} s"


def _state(boat: VesselStatus) -> str:
    """Speed, heading, and how far the shadow is from the boat."""
    m, s = boat.motion(), boat.message("shadow")
    silence = _silence(boat)
    life = (
        f"<span class='warn'>○ {silence}</span>" if silence else "<span class='good'>● live</span>"
    )
    if m is None:
        return f"<h1>{escape(boat.name)} {life}</h1>"
    speed, heading = math.hypot(m["surge_mps"], m["sway_mps"]), math.degrees(m["yaw_rad"]) % 360.0
    off = ""
    if s is not None and not silence:
        away = math.hypot(s["north_m"] - m["north_m"], s["east_m"] - m["east_m"])
        off = f", shadow {away:.2f} m away"
    source = f", reference: {escape(s['source'])}" if s else ""
    last = "last heard at " if silence else ""
    return (f"<h1>{escape(boat.name)} {life}</h1><p>{last}{speed:.2f} m/s, "
            f"heading {heading:03.0f}°{off}{source}</p>")  # fmt: skip


def _health(boat: VesselStatus) -> dict[str, str]:
    """Texts beside the labels of the health; empty before the first message.

    Of a boat that is not heard nothing is called good but what the gateway does by itself.
    """
    h = boat.message("health")
    if h is None:
        return {}
    if (since := boat.silent_s) is not None:
        text = "nothing known now" if math.isinf(since) else f"{h['link_age_s'] + since:.0f} s"
        return {"link": f"<p>{text} <span class='warn'>look here</span></p>"}
    silent = boat.link_silent_s is not None
    fit = "nothing to judge the model by" if silent else h["unfit"] or "fit to judge the model by"
    lines = {
        "link": (f"{h['link_age_s']:.1f} s", silent),
        "messages": (f"{h['rate_hz']:.0f} /s, lost {100 * h['loss']:.1f} %",
                     silent or h["loss"] > HIGH_LOSS),
        "nis": (f"{h['nis']:.2f}", None if silent else h["nis"] > HIGH_NIS),
        "gated": (f"{h['gated']}, late {h['late']}", None),
        "fit": (escape(fit), silent or bool(h["unfit"])),
        "clock": (f"{round(h['clock_offset_s'], 3) + 0.0:.3f} s", None),
        "shadow": (f"diverged {h['divergences']} times", h["diverging"] > 0),
        "recorder": (f"{h['recorder_backlog']} waiting, {h['recorder_drops']} dropped",
                     h["recorder_drops"] > 0),
    }  # fmt: skip
    marks = {None: "", True: " <span class='warn'>look here</span>",
             False: " <span class='good'>good</span>"}  # fmt: skip
    return {name: f"<p>{text}{marks[bad]}</p>" for name, (text, bad) in lines.items()}


def chart_origin(boat: VesselStatus, before: Origin | None) -> Origin | None:
    """Where on Earth the chart's origin lies: a place and the metres of the same moment.

    The two are not always of the same moment: an origin that hardly moved is the one before.
    """
    m, place = boat.message("measured"), boat.message("position")
    if m is None or place is None:
        return before
    here = Origin(place["boat_latitude_deg"], place["boat_longitude_deg"])
    if not on_earth(*here):
        return before
    found = Origin(*to_degrees(-np.array([m["north_m"], m["east_m"]]), here))
    return found if before is None or distance_m(before, found) > MOVED_M else before


def _events(boat: VesselStatus) -> str:
    """The latest events, newest first."""
    lines = [
        f"<p><span class='faint'>{time_of_day(e['receive_time_ns'])}</span> "
        f"<span class='{'warn' if e['severity'] in ('warning', 'error') else ''}'>"
        f"{escape(e['says'])}</span></p>"
        for e in boat.events[-MOST_EVENTS:][::-1]
    ]
    return "".join(lines) or "<p class='faint'>none yet</p>"
