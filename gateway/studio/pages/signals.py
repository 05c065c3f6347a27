"""Signals: any field of any message of a recording on plots of one's own, and derived ones."""

import json
from collections.abc import Collection, Sequence
from html import escape
from pathlib import Path
from typing import Any

import panel as pn
from bokeh.events import DocumentReady
from bokeh.models import CustomJS, TextInput

from gateway.errors import BadInput
from gateway.figures import SEVERAL, TIME, Axis, FigureData, Line, Panel, SeriesRole
from gateway.files import stamp_of
from gateway.studio.controls import FigurePlace
from gateway.studio.names import labels
from gateway.studio.page import (
    Page,
    StudioContext,
    Watches,
    bokeh_part,
    button,
    card,
    control_row,
    field,
    html,
    section,
    select,
    stack,
)
from gateway.studio.signals import IN_EXPRESSIONS, Expression, SignalRequest, SignalsView
from sim.near_names import did_you_mean

SHOWN = 400  # fields in the list: who has more searches
IDENTIFIER = "a name of letters, digits and _"
NEW, DERIVED = "a new one", "derived"
SCRIPT = (Path(__file__).parents[1] / "signals.js").read_text(encoding="utf-8")


class SignalsPage(Page):
    """Search, choose, plot; what is plotted is kept in the layout."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._log = select("Recording", {}, width=260)
        self._search = field("Search for a field", width=260, placeholder="yaw, servo, GPS …")
        self._fields = html()
        self._chosen = TextInput(value="[]", visible=False)  # names, as JSON
        take = self.guarded(self._take_dropped)
        self._dropped = TextInput(visible=False)  # plot, names as JSON, a number, as JSON
        self._dropped.on_change("value", lambda attr, old, new: take())
        if pn.state.curdoc is not None:
            shared = {"chosen": self._chosen, "dropped": self._dropped}
            pn.state.curdoc.js_on_event(DocumentReady, CustomJS(args=shared, code=SCRIPT))
        self._name = field("Name of a derived signal", width=200)
        self._formula = field("Expression", width=420, placeholder="deg(ATTITUDE.yaw)")
        self._which = select("Plot", [NEW], width=140)
        self._problems, self._hint = html(), html()
        self._plots: list[FigurePlace] = []
        self._pictures = stack()
        self._log.param.watch(lambda _: self._choose_log(), "value")
        self._search.param.watch(lambda _: self._filter(), "value_input")
        self._every: tuple[str, ...] = ()
        self._drawn: Sequence[object] = ()  # the plots, their request, what its file was
        self._quiet = False

    def body(self) -> Any:
        """The list of signals, and below it the plots."""
        put = button("Onto the plot", self.guarded(self._put), "primary", width=140)
        add = button("Derive", self.guarded(self._derive), width=90)
        return stack(
            card(html("<h1>Any signal</h1><p class='faint'>All numbers that a recording holds, in "
                      "the units of its format, over the time since its first message. Drag fields "
                      "onto a plot, or press them and put them there.</p>"),
                 control_row(self._log, self._search), self._hint, self._fields,
                 control_row(self._which, put), bokeh_part(self._chosen),
                 bokeh_part(self._dropped)),
            section("Derived signals", f"By a short expression of {escape(IN_EXPRESSIONS)}. "
                    "It is taken at the times of the signal named first.",
                    control_row(self._name, self._formula, add), self._problems),
            self._pictures,
        )  # fmt: skip

    def watch(self) -> Watches:
        """The recordings, the layout, what was read."""
        return {("logs", "files"): self._list, ("layout", "signals"): self._show}

    def _request(self) -> SignalRequest | None:
        layout = self.session.layout
        names = tuple(dict.fromkeys(name for plot in layout.plots for name in plot))
        derived = tuple(layout.derived.items())
        mapping = self.session.mapping
        return SignalRequest(self._log.value, names, derived, mapping) if self._log.value else None

    def _list(self) -> None:
        files = self.session.folders.recordings()
        options = {label: str(file) for label, file in labels(files).items()}
        asked = options.get(self.address.read("log") or "")
        first = asked or next((str(p.resolve()) for p in self.session.logs), None)
        self._quiet = True
        self._log.options = options
        if first in options.values():
            self._log.value = first
        self._quiet = False
        self.session.signals.forget_changed()
        self._show()

    def _choose_log(self) -> None:
        if not self._quiet:
            named = {path: label for label, path in self._log.options.items()}
            self.address.write(log=named.get(self._log.value))
            self.caught(self._show)

    def _filter(self) -> None:
        """Fields in whose name all words of the search stand; derived signals first."""
        words = (self._search.value_input or "").lower().split()
        every = (*self.session.layout.derived, *self._every)
        found = [name for name in every if all(word in name.lower() for word in words)]
        self._fields.object = tree(found[:SHOWN], json.loads(self._chosen.value), bool(words))
        more = f", the first {SHOWN} shown" if len(found) > SHOWN else ""
        self._hint.object = f"<p class='faint'>{len(found)} of {len(every)} fields{more}</p>"

    def _show(self) -> None:
        """The answer to what is wanted now, or that it is being read."""
        request = self._request()
        if request is None:
            return
        # the reader keeps one answer: who has its own does not ask in turn with another window
        now = (self.session.layout.plots, request, stamp_of(Path(request.path)))
        if now == self._drawn:
            return
        reader = self.session.signals
        reader.ask(request)
        why = reader.refused.get(request)
        if why is not None:
            self._problems.object = f"<p class='warn'>{escape(why)}</p>"
            return
        answer = reader.answers.get(request)
        if answer is None:
            return
        self._every = answer.fields
        self._filter()
        self._draw(answer)
        self._drawn = now

    def _draw(self, answer: SignalsView) -> None:
        plots, derived = self.session.layout.plots, self.session.layout.derived
        self._which.options = [NEW, *(str(k + 1) for k in range(len(plots)))]
        reasons = [f"<p class='warn'>{escape(why)}</p>" for why in answer.refused.values()]
        texts = [f"<p>{escape(name)} = <code>{escape(text)}</code></p>"
                 for name, text in derived.items()]  # fmt: skip
        self._problems.object = "".join(texts + reasons)
        self.view.time = None  # another recording has another time axis
        here = html("<p class='faint'>Drop fields here for a new plot.</p>", min_height=60)
        self._pictures.objects = [
            card(here, css_classes=["drop-new"]),
            *(self._plot(k, names, answer) for k, names in enumerate(plots)),
        ]

    def _plot(self, k: int, names: tuple[str, ...], answer: SignalsView) -> Any:
        found = [(name, answer.signals[name]) for name in names if name in answer.signals]
        lines = tuple(
            Line(*signal, SeriesRole.CONTEXT, name, SEVERAL[i % len(SEVERAL)])
            for i, (name, signal) in enumerate(found) if len(signal.time)
        )  # fmt: skip
        place = FigurePlace(self.view)
        place.show(FigureData("", (Panel(TIME, Axis(""), lines),)) if lines else None)
        gone = [name for name in names if name not in answer.signals]
        text = f"<p class='warn'>not in this recording: {escape(', '.join(gone))}</p>"
        away = button(f"Remove plot {k + 1}", self.guarded(lambda: self._remove(k)), width=150)
        return card(html(f"<h2>Plot {k + 1}</h2>{text if gone else ''}"), place.part, away,
                    css_classes=[f"drop-{k}"])  # fmt: skip

    def _put(self) -> None:
        """Put the signal that was pressed onto the plot that is named."""
        names = tuple(json.loads(self._chosen.value))
        if not names:
            raise BadInput("press one or more fields first, or drag them onto a plot")
        self._chosen.value = "[]"
        self._filter()
        self._put_on(self._which.value, names)

    def _take_dropped(self) -> None:
        """Put a field that was dragged onto a plot there; text from elsewhere is no field."""
        plot, text, _ = json.loads(self._dropped.value)
        known = {*self._every, *self.session.layout.derived}
        try:
            names = tuple(name for name in json.loads(text) if name in known)
        except (ValueError, TypeError):
            names = ()
        if not names:
            raise BadInput("what was dropped is no field of this recording")
        self._put_on(NEW if plot == "new" else str(int(plot) + 1), names)

    def _put_on(self, which: str, names: tuple[str, ...]) -> None:
        plots = self.session.layout.plots
        if which == NEW:
            self.session.set_layout(plots=(*plots, names))
        else:
            k = int(which) - 1
            more = tuple(dict.fromkeys((*plots[k], *names)))
            self.session.set_layout(plots=(*plots[:k], more, *plots[k + 1 :]))

    def _remove(self, k: int) -> None:
        plots = self.session.layout.plots
        self.session.set_layout(plots=(*plots[:k], *plots[k + 1 :]))

    def _derive(self) -> None:
        """A derived signal with a name of its own; an empty expression takes it away."""
        name, text = self._name.value.strip(), self._formula.value.strip()
        derived = dict(self.session.layout.derived)
        if not (name.isidentifier() and name.isascii()):
            raise BadInput(f"{name!r}: give the derived signal {IDENTIFIER}")
        if text:
            self._check_names(Expression(text), (*derived, *self._every))
            derived[name] = text
        elif derived.pop(name, None) is None:
            raise BadInput("give it an expression")
        self.session.set_layout(derived=derived)

    def _check_names(self, expression: Expression, known: Collection[str]) -> None:
        """BadInput for a signal that the recording shown has not: a slip of the pen, mostly."""
        for one in expression.names if self._every else ():
            if one not in known:
                meant = did_you_mean(one, known)
                hint = f": {meant.rstrip()}" if meant else ""
                raise BadInput(f"{one}: no such signal in this recording{hint}")


def tree(names: Sequence[str], chosen: Collection[str], unfolded: bool) -> str:
    """Names of fields by message, as HTML: each can be pressed, and dragged onto a plot."""
    messages: dict[str, list[str]] = {}
    for name in names:
        messages.setdefault(name.partition(".")[0] if "." in name else DERIVED, []).append(name)
    parts = [
        f"<details{' open' if unfolded or message == DERIVED else ''}>"
        f"<summary>{escape(message)} <span class='faint'>{len(fields)}</span></summary><p>"
        + "".join(_field(name, name in chosen) for name in fields) + "</p></details>"
        for message, fields in messages.items()
    ]  # fmt: skip
    return (
        f"<div class='fields' role='group' aria-label='Fields, by message'>{''.join(parts)}</div>"
    )


def _field(name: str, chosen: bool) -> str:
    text, key = escape(name.partition(".")[2] or name), escape(name)
    pressed = "true" if chosen else "false"
    return (f'<button type="button" class="field" draggable="true" data-field="{key}" '
            f'aria-label="{key}" aria-pressed="{pressed}">{text}</button> ')  # fmt: skip
