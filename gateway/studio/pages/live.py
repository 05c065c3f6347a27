"""Live: boats and shadows on a chart, strips of their velocities, health and events."""

import math
from collections.abc import Callable
from datetime import datetime
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
import panel as pn
from bokeh.models import Arrow, ColumnDataSource, OpenHead, ScaleBar
from bokeh.plotting import figure as new_figure

from gateway.config import StudioSettings
from gateway.figures.bokeh_draw import style_figure
from gateway.figures.figure_data import SeriesRole
from gateway.figures.style import Theme
from gateway.ingest.earth import Origin, to_degrees
from gateway.live.intake import distance_m, on_earth
from gateway.studio.live_history import WINDOW_S, LiveHistory, Now
from gateway.studio.map_tiles import MapSwitch, Underlay
from gateway.studio.page import Page
from gateway.studio.session import Session
from gateway.studio.widgets import NO_BUTTON, beside, card, html, select, word

STRIPS = (("u", "surge u [m/s]"), ("v", "sway v [m/s]"), ("r", "yaw rate r [°/s]"))
LINES = (("measured", SeriesRole.MEASURED, "solid"), ("shadow", SeriesRole.SHADOW, "solid"),
         ("reference", SeriesRole.CONTEXT, "dotted"))  # fmt: skip
BOW = np.array(
    [[1.0, 0.0], [0.3, 0.45], [-1.0, 0.4], [-1.0, -0.4], [0.3, -0.45]]
)  # m / half length
AGES = 5
MOVED_M = 20.0  # an origin further off is another one
HEALTH = {  # what is told -> its label, and the word that explains it
    "link": ("link silent for", ""), "messages": ("messages", ""), "nis": ("", "NIS"),
    "gated": ("", "gated"), "clock": ("", "clock offset"), "recorder": ("recorder", ""),
}  # fmt: skip
SIGNIFICANT = 2.0  # standard deviations: a missing force below that is not drawn


class Live(Page):
    """What the gateway says now."""

    name, title = "live", "Live"
    period_ms = 100

    def __init__(self, desk: Session, book: LiveHistory, settings: StudioSettings) -> None:
        super().__init__(desk)
        self.book, self._settings = book, settings
        self._which = select("Boat", [], width=240)
        self._which.param.watch(lambda _: self._anew(), "value")
        self._state, self._events = html(), html()
        self._health = {name: html() for name in HEALTH}
        self._silent = html("<p class='faint'>no health message yet</p>")
        self._chart = Chart(self.look)
        self._strips = Strips(self.look)
        self._map = MapSwitch(settings)
        self._underlay: Underlay | None = None
        self._origin: Origin | None = None

    def body(self) -> Any:
        """Chart and numbers side by side, strips below."""
        chart = card(html(f"<h2>Chart</h2><p class='faint'>North is up. The arrow is the "
                          f"{word('missing force')}, where it stands out of its noise. The "
                          f"{word('shadow')} follows the {word('reference')}.</p>"),
                     pn.pane.Bokeh(self._chart.figure),
                     self._map.box, self._map.credit)  # fmt: skip
        health = [_line(*HEALTH[name], value) for name, value in self._health.items()]
        told = pn.Column(card(self._which, self._state),
                         card(html("<h2>Health</h2>"), self._silent, *health),
                         card(html("<h2>Events</h2>"), self._events),
                         sizing_mode="stretch_width")  # fmt: skip
        three = f"{word('surge u')}, {word('sway v')}, {word('yaw rate r')}"
        return pn.Column(
            beside(chart, told),
            card(html(f"<h2>Velocities</h2><p class='faint'>{three} over the last minute.</p>"),
                 *map(pn.pane.Bokeh, self._strips.figures)),
            sizing_mode="stretch_width",
        )  # fmt: skip

    def watch(self) -> dict[tuple[str, ...], Callable[[], None]]:
        """Nothing of the desk concerns it."""
        return {}

    def tick(self) -> None:
        """Take what came since."""
        boats = self.book.now()
        names = [boat.name for boat in boats]
        if self._which.options != names:
            self._which.options = names
            if self._which.value not in names and names:
                self._which.value = names[0]
        chosen = next((b for b in boats if b.name == self._which.value), None)
        self._chart.show(boats)
        self._lay(chosen)
        if chosen is None:
            self._put(self._state, f"<p>Nobody publishes at {escape(self.book.where)} yet. Start "
                      "<code>shadow live ENDPOINT --vessel FILE</code>.</p>")  # fmt: skip
            return
        self._strips.show(chosen)
        self._put(self._state, _state(chosen))
        self._tell_health(chosen)
        self._put(self._events, _events(chosen))

    def _tell_health(self, boat: Now) -> None:
        """A line of its own for each, so that what has the keyboard's focus stays."""
        told = _health(boat)
        self._put(self._silent, "" if told else "<p class='faint'>no health message yet</p>")
        for name, place in self._health.items():
            self._put(place, told.get(name, ""))

    def _lay(self, boat: Now | None) -> None:
        """The map below the chart, once it was asked for."""
        if boat is not None:
            self._origin = origin_of(boat, self._origin)
        if self._map.on:
            self._underlay = self._underlay or Underlay(
                self._chart.figure, self._settings, self.look
            )
            self._underlay.show(self._origin)
        elif self._underlay is not None:
            self._underlay.clear()
        self._map.tell(self._origin is not None)

    def _anew(self) -> None:
        self._origin = None
        self._strips.clear()

    def _put(self, place: Any, text: str) -> None:
        if place.object != text:
            place.object = text


class Chart:
    """Tracks, hulls and missing forces from above."""

    def __init__(self, look: Theme) -> None:
        self.figure = new_figure(
            height=430, sizing_mode="stretch_width", match_aspect=True, x_axis_label="east [m]",
            y_axis_label="north [m]", tools="pan,wheel_zoom,reset", toolbar_location="right",
        )  # fmt: skip
        style_figure(self.figure, look)
        self._tracks = _sources(("xs", "ys", "alpha"))
        self._hulls = _sources(("xs", "ys"))
        for topic, role in (("measured", SeriesRole.MEASURED), ("shadow", SeriesRole.SHADOW)):
            colour = look.colour(role)
            self.figure.multi_line("xs", "ys", source=self._tracks[topic], line_color=colour,
                                   line_width=2, line_alpha="alpha")  # fmt: skip
            self.figure.patches("xs", "ys", source=self._hulls[topic], fill_color=colour,
                                fill_alpha=0.35, line_color=colour, line_width=2,
                                legend_label=topic)  # fmt: skip
        self._force = ColumnDataSource({"x0": [], "y0": [], "x1": [], "y1": []})
        colour = look.colour(SeriesRole.ERROR)
        self.figure.add_layout(Arrow(
            source=self._force, x_start="x0", y_start="y0", x_end="x1", y_end="y1",
            line_color=colour, line_width=3, end=OpenHead(size=12, line_color=colour),
        ))  # fmt: skip
        names = ColumnDataSource({"x": [], "y": [], "name": []})
        self.figure.text("x", "y", "name", source=names, text_color=look.ink, x_offset=10,
                         text_font_size="12px")  # fmt: skip
        self._names = names
        _legend_above(self.figure, look)
        self.figure.add_layout(ScaleBar(
            range=self.figure.x_range, unit="m", location="bottom_right", border_line_color=None,
            background_fill_alpha=0.0, bar_line_color=look.ink, bar_line_width=2,
            label_text_color=look.ink, title="",
        ))  # fmt: skip

    def show(self, boats: tuple[Now, ...]) -> None:
        """All boats as they are now."""
        for topic in ("measured", "shadow"):
            pieces = [piece for boat in boats for piece in _aged(*boat.track(topic))]
            _put_into(self._tracks[topic], _columns(("xs", "ys", "alpha"), pieces))
            hulls = [_hull(m) for b in boats if (m := b.message(topic))]
            _put_into(self._hulls[topic], _columns(("xs", "ys"), hulls))
        arrows = [a for boat in boats if (a := _arrow(boat))]
        _put_into(self._force, _columns(("x0", "y0", "x1", "y1"), arrows))
        placed = [(m["east_m"], m["north_m"], b.name) for b in boats if (m := b.boat())]
        _put_into(self._names, _columns(("x", "y", "name"), placed))


def _put_into(source: Any, data: dict[str, list[Any]]) -> None:
    """What is shown already is not sent again: tracks grow twice a second, looks are ten."""
    if source.data != data:
        source.data = data


def _aged(east: list[float], north: list[float]) -> list[tuple[list[float], list[float], float]]:
    """A track in pieces, the older the fainter."""
    ends = [len(east) * k // AGES for k in range(AGES + 1)]
    return [
        (east[max(a - 1, 0) : b], north[max(a - 1, 0) : b], (k + 1) / AGES)
        for k, (a, b) in enumerate(pairwise(ends)) if b > a
    ]  # fmt: skip


def _columns(names: tuple[str, ...], rows: list[Any]) -> dict[str, list[Any]]:
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


class Strips:
    """u, v, r over the last minute, streamed."""

    def __init__(self, look: Theme) -> None:
        self.figures: list[Any] = []
        self._sources = _sources(("t", "u", "v", "r"), (t for t, _, _ in LINES))
        self._told: dict[str, float] = {}
        for name, label in STRIPS:
            fig = new_figure(
                height=150, sizing_mode="stretch_width", y_axis_label=label, x_axis_type="datetime",
                tools="pan,wheel_zoom,reset", toolbar_location=None,
            )  # fmt: skip
            style_figure(fig, look)
            fig.x_range.follow, fig.x_range.follow_interval = "end", WINDOW_S * 1000.0
            fig.x_range.range_padding = 0.0
            for topic, role, dash in LINES:
                fig.line("t", name, source=self._sources[topic], line_color=look.colour(role),
                         line_width=1.8, line_dash=dash,
                         **({"legend_label": topic} if name == "u" else {}))  # fmt: skip
            self.figures.append(fig)
        _legend_above(self.figures[0], look)

    def clear(self) -> None:
        """Another boat is shown from now on."""
        self._told.clear()
        for source in self._sources.values():
            source.data = {"t": [], "u": [], "v": [], "r": []}

    def show(self, boat: Now) -> None:
        """What came since the last look."""
        for topic, source in self._sources.items():
            rows = boat.since(topic, self._told.get(topic, 0.0))
            if len(rows):
                self._told[topic] = float(rows[-1, 0])
                columns = dict(zip("tuvr", (1000.0 * rows[:, 0], *rows[:, 1:].T), strict=True))
                source.stream(columns, rollover=int(WINDOW_S * 12))


def _line(label: str, term: str, value: Any) -> Any:
    """A label that stays, and beside it what changes."""
    said = html(f"<p>{word(term) if term else label}</p>")
    said.styles, value.styles = {"flex": "0 0 8.5rem"}, {"flex": "1 1 9rem"}
    return pn.Column(said, value, styles={"flex-direction": "row"}, stylesheets=[NO_BUTTON],
                     sizing_mode="stretch_width", margin=0)  # fmt: skip


def _legend_above(fig: Any, look: Theme) -> None:
    """Where it covers no line."""
    fig.add_layout(fig.legend[0], "above")
    legend = fig.legend
    legend.orientation, legend.location = "horizontal", "left"
    legend.background_fill_alpha, legend.label_text_color = 0.0, look.ink
    legend.border_line_color, legend.margin, legend.padding = None, 2, 0


def _sources(columns: tuple[str, ...], names: Any = ("measured", "shadow")) -> dict[str, Any]:
    return {name: ColumnDataSource({c: [] for c in columns}) for name in names}


def _hull(m: Any) -> tuple[list[float], list[float]]:
    """The outline of a boat where it is, as it points."""
    c, s = math.cos(m["yaw_rad"]), math.sin(m["yaw_rad"])
    north = m["north_m"] + BOW[:, 0] * c - BOW[:, 1] * s
    east = m["east_m"] + BOW[:, 0] * s + BOW[:, 1] * c
    return east.tolist(), north.tolist()


def _arrow(boat: Now) -> tuple[float, float, float, float] | None:
    """The missing force on the boat, as long as its acceleration would carry it."""
    m, f = boat.boat(), boat.message("residual")
    if m is None or f is None:
        return None
    X, Y = f["missing_surge_n"], f["missing_sway_n"]
    size = math.hypot(X, Y)
    if size < SIGNIFICANT * math.hypot(f["missing_surge_n_std"], f["missing_sway_n_std"]):
        return None
    length = 4.0 * math.log1p(size / 5.0) / size
    c, s = math.cos(m["yaw_rad"]), math.sin(m["yaw_rad"])
    return (m["east_m"], m["north_m"], m["east_m"] + length * (X * s + Y * c),
            m["north_m"] + length * (X * c - Y * s))  # fmt: skip


def _state(boat: Now) -> str:
    """Speed, heading, and how far the shadow is from the boat."""
    m, s = boat.boat(), boat.message("shadow")
    life = "<span class='good'>● live</span>" if boat.alive else "<span class='warn'>○ gone</span>"
    if m is None:
        return f"<h1>{escape(boat.name)} {life}</h1>"
    speed, heading = math.hypot(m["surge_mps"], m["sway_mps"]), math.degrees(m["yaw_rad"]) % 360.0
    off = ""
    if s is not None:
        far = math.hypot(s["north_m"] - m["north_m"], s["east_m"] - m["east_m"])
        off = f", shadow {far:.2f} m away"
    source = f", reference: {escape(s['source'])}" if s else ""
    return (f"<h1>{escape(boat.name)} {life}</h1><p>{speed:.2f} m/s, heading {heading:03.0f}°{off}"
            f"{source}</p>")  # fmt: skip


def _health(boat: Now) -> dict[str, str]:
    """What stands beside each label of the health; nothing before the first message."""
    h = boat.message("health")
    if h is None:
        return {}
    told = {
        "link": (f"{h['link_age_s']:.1f} s", h["link_age_s"] > 1.0),
        "messages": (f"{h['rate_hz']:.0f} /s, lost {100 * h['loss']:.1f} %", h["loss"] > 0.05),
        "nis": (f"{h['nis']:.2f}", h["nis"] > 3.0),
        "gated": (f"{h['gated']}, late {h['late']}", None),
        "clock": (f"{round(h['clock_offset_s'], 3) + 0.0:.3f} s", None),
        "recorder": (f"{h['recorder_backlog']} waiting, {h['recorder_drops']} dropped",
                     h["recorder_drops"] > 0),
    }  # fmt: skip
    return {
        name: f"<p>{says}{'' if bad is None else ' ' + _mark(bad)}</p>"
        for name, (says, bad) in told.items()
    }


def origin_of(boat: Now, before: Origin | None) -> Origin | None:
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


def _mark(bad: bool) -> str:
    return "<span class='warn'>look here</span>" if bad else "<span class='good'>good</span>"


def _events(boat: Now) -> str:
    lines = [
        f"<p><span class='faint'>{datetime.fromtimestamp(e['receive_time_ns'] * 1e-9):%H:%M:%S}"
        f"</span> <span class='{'warn' if e['severity'] in ('warning', 'error') else ''}'>"
        f"{escape(e['says'])}</span></p>"
        for e in boat.events[-8:][::-1]
    ]
    return "".join(lines) or "<p class='faint'>none yet</p>"
