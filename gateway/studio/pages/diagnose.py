"""Diagnose: which effect is missing; add it, and the ladder falls by a step."""

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn

from gateway.errors import BadInput
from gateway.figures.bokeh_draw import BokehFigure
from gateway.figures.diagnosis import ladder_bars
from gateway.figures.figure_data import FigureData
from gateway.studio.page import Page
from gateway.studio.session import Session
from gateway.studio.views import Found, LadderView, Other
from gateway.studio.widgets import (
    beside,
    boxes,
    bullets,
    button,
    card,
    controls,
    field,
    html,
    table,
    word,
)
from sim.diagnosis.answer import Verdict

SHOWN = 6  # of the ranking


class Diagnose(Page):
    """Run, read, add, undo, save."""

    name, title = "diagnose", "Diagnose"

    def __init__(self, desk: Session) -> None:
        super().__init__(desk)
        self._learn = boxes(options=[], inline=True)
        self._learn.param.watch(lambda _: self._learning(), "value")
        self._run = button("Find what is missing", self.safely(self._start), "primary", width=210)
        self._undo = button("Undo", self.safely(desk.undo), width=90)
        self._name = field("Save the vessel as", width=240)
        self._save = button("Save vessel file", self.safely(self._saved), width=150)
        self._verdict, self._rest, self._now = html(), html(), html()
        self._others = html()
        self._ranking = pn.Column(sizing_mode="stretch_width")
        self._places = {key: pn.Column(sizing_mode="stretch_width", min_height=330)
                        for key in ("ladder", "ranking")}  # fmt: skip
        self._evidence = pn.Column(sizing_mode="stretch_width")
        self._pictures: dict[str, BokehFigure] = {}
        self._instead: dict[str, Any] = {}  # effects of a rival -> its button

    def body(self) -> Any:
        """From the question to the saved file, top to bottom."""
        save = controls(self._undo, self._name, self._save)
        return pn.Column(
            card(html("<h1>What is missing from the model?</h1>"
                      "<p class='faint'>Learn from these recordings; the others check the result."
                      "</p>"), self._learn, self._run, self._verdict),
            card(html(f"<h2>The {word('ladder')}</h2><p class='faint'>Each step is judged on "
                      f"{word('unseen time')}: beside it the {word('noise floor')}.</p>"),
                 self._places["ladder"], self._now, self._others, save),
            card(html(f"<h2>Candidates</h2><p class='faint'>Each {word('effect')} alone beside the "
                      f"re-fitted {word('base')}; its error is the {word('nrmse')}.</p>"),
                 self._ranking, self._places["ranking"]),
            card(html(f"<h2>Evidence</h2><p class='faint'>The {word('missing force')} without an "
                      f"effect, along {word('surge u')}, {word('sway v')} or turning, and what the "
                      "effect supplies.</p>"), self._evidence),
            card(self._rest),
            sizing_mode="stretch_width",
        )  # fmt: skip

    def watch(self) -> dict[tuple[str, ...], Callable[[], None]]:
        """The answer, the vessel, the comparison."""
        return {
            ("logs",): self._logs,
            ("found",): self._told,
            ("found", "vessel"): self._climbed,
            ("trials",): self._checked,
        }

    def tick(self) -> None:
        """One diagnosis at a time."""
        if self._run.disabled != self.desk.slow.busy:
            self._run.disabled = self.desk.slow.busy

    def _logs(self) -> None:
        names = {path.name: path for path in self.desk.logs}
        self._learn.options = list(names)
        chosen = self.desk.learn_from or self.desk.logs[:1]
        self._learn.value = [path.name for path in chosen]

    def _learning(self) -> None:
        names = set(self._learn.value)
        self.desk.learn_from = tuple(p for p in self.desk.logs if p.name in names)

    def _start(self) -> None:
        if not self._learn.value:
            raise BadInput("choose at least one recording to learn from")
        self.desk.notice = ""
        self.desk.diagnose()

    def _told(self) -> None:
        found = self.desk.found
        if found is None:
            self._verdict.object = self._rest.object = ""
            self._evidence.objects = [html("<p class='faint'>after a diagnosis</p>")]
            self.fill(self._places["ranking"], None, self._pictures, "ranking")
            return
        answer = found.answer
        says = Verdict(answer["verdict"]).says
        self._verdict.object = (
            f"<h2>{says[0].upper()}{says[1:]}</h2><p>{escape(answer['summary'])}</p>"
        )
        self._rest.object = _rest(found)
        self.fill(self._places["ranking"], found.ranking, self._pictures, "ranking")
        self._prove(found)

    def _prove(self, found: Found) -> None:
        """What was found, then what was ranked beside it; a rival can be taken right there."""
        self._instead = {}
        parts = [
            self._proof(effect, _plain(effect), data, found)
            for effect, data in found.evidence.items()
        ]
        ranked = [
            self._proof(" ".join(one.rung.effects), self._rival(one, found), one.evidence, found,
                        one.rung)
            for one in found.others if one.evidence is not None
        ]  # fmt: skip
        if ranked:
            parts.append(html("<h3>Ranked, but not chosen</h3><p class='faint'>The same picture of "
                              "each, with numbers of its own.</p>"))  # fmt: skip
            parts.append(beside(*ranked))
        self._evidence.objects = parts or [html("<p class='faint'>none: nothing was found</p>")]

    def _proof(
        self, key: str, heading: str, data: FigureData, found: Found, rung: LadderView | None = None
    ) -> Any:
        """A picture with its words; and a button where it can be taken."""
        effect = key.split()[-1]
        place = pn.Column(sizing_mode="stretch_width", min_height=230)
        says = escape(found.looks.get(effect, ""))
        told = html(f"<h3>{heading}</h3><p>Looks like: {says}.</p>"
                    f"<p class='faint'>{escape(data.caption)}</p>")  # fmt: skip
        self._pictures.pop(f"evidence {key}", None)
        self.fill(place, data, self._pictures, f"evidence {key}")
        if rung is None:
            return pn.Column(told, place, sizing_mode="stretch_width")
        taken = self._instead[key] = button(f"Add {_said(effect)}", self._taker(rung), width=220)
        return pn.Column(told, place, taken, sizing_mode="stretch_width")

    def _rival(self, one: Other, found: Found) -> str:
        """Name, error, and whether it is as good as what was chosen."""
        rung = one.rung
        there = " beside " + ", ".join(map(_plain, rung.effects[:-1])) if rung.effects[1:] else ""
        best = next((r for r in found.rungs if len(r.effects) == len(rung.effects)), None)
        against = f", {_plain(best.effects[-1])} {best.step.error:.3f}" if best else ""
        tied = " <span class='warn'>cannot be told from it here</span>" if one.rival else ""
        return (f"{_plain(rung.effects[-1])}{there} <span class='faint'>error "
                f"{rung.step.error:.3f}{against}</span>{tied}")  # fmt: skip

    def _taker(self, rung: LadderView) -> Callable[[], None]:
        return self.safely(lambda: self.desk.climb(rung))

    def _climbed(self) -> None:
        """The ladder as far as the user has climbed it, and what can be added next."""
        found, version = self.desk.found, self.desk.version
        self._undo.disabled = len(self.desk.versions) < 2
        if version is not None and self.desk.vessel_file is not None and not self._name.value:
            self._name.value = f"{self.desk.vessel_file.stem}-better.toml"
        climbed = version.steps if version else ()
        if found is not None and not climbed:
            climbed = tuple(r.step for r in found.rungs[:1])
        data = ladder_bars(climbed, found.floor) if found and climbed else None
        self.fill(self._places["ladder"], data, self._pictures, "ladder")
        effects = ", ".join(map(_plain, version.effects)) if version else ""
        self._now.object = (
            f"<p>In the vessel now: <strong>{effects}</strong></p>"
            if effects
            else ("" if found else "<p class='faint'>Press “Find what is missing”.</p>")
        )
        self._candidates(found)

    def _candidates(self, found: Found | None) -> None:
        """What can come next, and what could stand in the place of what came last."""
        if found is None:
            self._ranking.objects = [html("<p class='faint'>after a diagnosis</p>")]
            return
        version = self.desk.version
        now = _beyond(found, version.effects if version else ())
        if now is None:
            self._ranking.objects = [html("<p>The vessel has been changed since: find what is "
                                          "missing again.</p>")]  # fmt: skip
            return
        rows = [self._base(found)] if found.answer["base_changed"] and not now else []
        rows += [self._candidate(found, rung, now) for rung in _next(found, now)]
        same = _in_place(found, now)
        if same:
            rows.append(html(f"<h3>In the place of {_plain(now[-1])}</h3>"))
        rows += [self._candidate(found, rung, now) for rung in same]
        self._ranking.objects = rows or [html("<p class='faint'>nothing more</p>")]
        for key, taken in self._instead.items():
            taken.disabled = tuple(key.split()) == now

    def _base(self, found: Found) -> Any:
        """The nine numbers alone, where they had to move."""
        rung, version = found.rungs[1], self.desk.version
        there = version is not None and version.text != found.rungs[0].text
        add = button("Use", self.safely(lambda: self.desk.climb(rung)), width=90, disabled=there)
        says = (f"<strong>the {word('base')} re-fitted</strong>: error {rung.step.error:.3f}<br>"
                "<span class='faint'>as given, these numbers predict unseen time worse</span>"
                )  # fmt: skip
        return pn.Row(add, pn.Spacer(width=12, sizing_mode="fixed"), html(says),
                      sizing_mode="stretch_width", margin=(2, 0))  # fmt: skip

    def _candidate(self, found: Found, rung: LadderView, now: tuple[str, ...]) -> Any:
        """A line of what can be added with its button."""
        effect, there = rung.effects[-1], rung.effects == now
        kind = "primary" if rung in found.rungs and not there else "default"
        text = "Added" if there else "Instead" if len(rung.effects) == len(now) else "Add"
        add = button(text, self._taker(rung), kind, width=90, disabled=there)
        says = f"<strong>{_plain(effect)}</strong>: error {rung.step.error:.3f}"
        says += _ranked(found, rung)
        says += f"<br><span class='faint'>{escape(found.looks.get(effect, ''))}</span>"
        return pn.Row(add, pn.Spacer(width=12, sizing_mode="fixed"), html(says),
                      sizing_mode="stretch_width", margin=(2, 0))  # fmt: skip

    def _checked(self) -> None:
        """The recordings that the diagnosis did not learn from."""
        found = self.desk.found
        if found is None:
            self._others.object = ""
            return
        rows = [
            [escape(t.name), f"{t.vessels[0].nrmse:.3f}", f"{t.vessels[-1].nrmse:.3f}",
             f"{t.vessels[-1].floor:.3f}"]
            for t in self.desk.trials if t.log not in found.logs and len(t.vessels) > 1
        ]  # fmt: skip
        heads = ["a recording it never saw", "error as given", "error now", word("noise floor")]
        self._others.object = table(heads, rows) if rows else ""

    def _saved(self) -> None:
        file = self.desk.save(self._name.value.strip())
        self.desk.say(f"saved: {file}", good=True)


def _beyond(found: Found, effects: tuple[str, ...]) -> tuple[str, ...] | None:
    """The effects that were added since the diagnosis; None where the vessel is another."""
    n = len(found.before)
    return effects[n:] if effects[:n] == found.before else None


def _next(found: Found, now: tuple[str, ...]) -> list[LadderView]:
    """What can be added to the vessel as it is, what was chosen first."""
    return [r for r in found.every if r.effects and r.effects[:-1] == now][:SHOWN]


def _in_place(found: Found, now: tuple[str, ...]) -> list[LadderView]:
    """What was added last, and what could stand there instead."""
    return _next(found, now[:-1]) if now else []


def _ranked(found: Found, rung: LadderView) -> str:
    """How probable an effect is beside the others, and from what it cannot be told."""
    effect = rung.effects[-1]
    row = next((r for r in found.answer["ranking"] if r["effect"] == effect), None)
    if row is None or len(rung.effects) > 1:
        rival = any(one.rival for one in found.others if one.rung is rung)
        return " <span class='warn'>does as well here</span>" if rival else ""
    chance = row["probability"]
    shown = f"{100 * chance:.1f} %" if chance >= 0.001 else "&lt; 0.1 %"
    tied = ", ".join(map(_plain, row["confounded_with"]))
    alike = f" <span class='warn'>cannot be told from {tied} here</span>" if tied else ""
    return f", {word('probability')} {shown}{alike}"


def _said(effect: str) -> str:
    return effect.replace("_", " ")


def _plain(effect: str) -> str:
    return escape(_said(effect))


def _rest(found: Found) -> str:
    """Numbers found, what is left, what would settle it, what could not be judged."""
    answer = found.answer
    last, parts = answer["ladder"][-1], []
    rows = [
        [f"{_plain(effect)}: {escape(name)}", f"{n['value']:.4g}",
         f"{n['ci95'][0]:.4g} … {n['ci95'][1]:.4g}", escape(n["unit"]), escape(n.get("doubt", ""))]
        for effect, numbers in last["parameters"].items() for name, n in numbers.items()
    ]  # fmt: skip
    if rows:
        heads = ["number", "value", word("95 % interval"), "unit", ""]
        parts.append("<h2>What was found</h2>" + table(heads, rows, text=(0, 3, 4)))
    if answer["depends_on"]:
        says = [d["says"] for d in answer["depends_on"]]
        parts.append("<h2>What is left depends on</h2>" + bullets(says))
    manoeuvres = [says for says in (answer["next_manoeuvre"], *found.separates) if says]
    if manoeuvres:
        parts.append("<h2>The manoeuvre that would settle it</h2>"
                     + bullets(list(dict.fromkeys(manoeuvres))))  # fmt: skip
    if answer["refused"]:
        says = [f"{x['effect'].replace('_', ' ')}: {x['because']}" for x in answer["refused"]]
        parts.append("<h2>Not judged: these data cannot show it</h2>" + bullets(says))
    return "".join(parts)
