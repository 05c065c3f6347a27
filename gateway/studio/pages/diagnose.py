"""Diagnose: which effect is missing; add it, and the ladder falls by a step."""

from collections.abc import Callable
from html import escape
from typing import Any

import panel as pn

from gateway.figures import FigureData, peoples_unit, probability_text
from gateway.figures.bokeh_draw import LinkedView
from gateway.figures.diagnosis import ladder_bars
from gateway.figures.words import said
from gateway.studio import AlternativeView, DiagnosisView, LadderView
from gateway.studio.controls import FigurePlace, LearnFrom, SaveControls, error_table
from gateway.studio.page import (
    Page,
    StudioContext,
    Watches,
    bullets,
    button,
    card,
    html,
    section,
    select,
    side_by_side,
    stack,
    table,
    word,
)
from gateway.studio.time_marks import ScopeLine
from sim.diagnosis.answer import Verdict

MOST_CANDIDATES = 6  # that are offered
EVERY = "all of them"
AFTER = "<p class='faint'>after a diagnosis</p>"
NOT_YET = "<p class='faint'>Press “Find what is missing”.</p>"
WORKING = "<p class='faint'>It is being looked for: what is found stands here.</p>"


class DiagnosePage(Page):
    """Run, read, add, undo, save."""

    def __init__(self, context: StudioContext) -> None:
        super().__init__(context)
        self._learn = LearnFrom(self)
        self._run = button("Find what is missing", self.guarded(self._start), "primary", width=210)
        self._save = SaveControls(self, "Save the vessel as", "better", widths=(240, 150))
        self._scope = ScopeLine(self.session)
        self._verdict, self._rest, self._now, self._unseen = html(), html(), html(), html()
        self._last = card(self._rest, visible=False)
        self._candidates, self._evidence, self._why_not = stack(), stack(), html(AFTER)
        self._cause = select("Causes", [EVERY], width=300)
        self._cause.param.watch(lambda _: self._choose_cause(), "value")
        self._quiet = False
        self._ladder, self._ranking = FigurePlace(self.view), FigurePlace(self.view)
        self._add_buttons: dict[tuple[str, ...], Any] = {}  # effects of an alternative -> button

    def body(self) -> Any:
        """From the question to the saved file, top to bottom."""
        return stack(
            card(html("<h1>What is missing from the model?</h1>"
                      "<p class='faint'>Learn from these recordings; the others check the result."
                      "</p>"), self._scope.part, self._learn.part, self._run, self._verdict),
            section(f"The {word('ladder')}", f"Each step is judged on {word('unseen time')}: "
                    f"beside it the {word('noise floor')}.",
                    self._ladder.part, self._now, self._unseen, self._save.part),
            section("Candidates", f"Each {word('effect')} alone beside the re-fitted "
                    f"{word('base')}; its error is the {word('nrmse')}.",
                    self._candidates, self._ranking.part),
            section("Evidence", f"The {word('missing force')} without an effect, along "
                    f"{word('surge u')}, {word('sway v')} or turning ({word('yaw rate r')}), and "
                    "what the effect supplies.", self._cause, self._evidence),
            section("Why not?", "Every cause that was tried and not chosen, and why.",
                    self._why_not),
            self._last,
        )  # fmt: skip

    def watch(self) -> Watches:
        """The recordings, the answer, the vessel, the comparison."""
        return {
            ("logs",): self._learn.update,
            ("scope",): self._scope.update,
            ("diagnosis",): self._show_diagnosis,
            ("diagnosis", "vessel"): self._show_ladder,
            ("trials", "vessel", "diagnosis"): self._show_unseen,
        }

    def tick(self) -> None:
        """One diagnosis at a time."""
        if self._run.disabled != self.session.slow.busy:
            self._run.disabled = self.session.slow.busy
        if self._now.object in (NOT_YET, WORKING):
            self._now.object = self._not_found_yet()

    def _not_found_yet(self) -> str:
        return WORKING if self.session.slow.job == "diagnose" else NOT_YET

    def _start(self) -> None:
        self._learn.check()
        self.session.diagnose()

    def _show_diagnosis(self) -> None:
        diagnosis = self.session.diagnosis
        self._ranking.show(diagnosis.ranking if diagnosis else None)
        if diagnosis is None:
            self._verdict.object = self._rest.object = ""
            self._evidence.objects = [html(AFTER)]
            self._why_not.object = AFTER
            self._last.visible = False
            return
        answer = diagnosis.answer
        text = Verdict(answer["verdict"]).in_words(answer["unexplained"])
        says = "".join(f"<h2>{escape(line)}</h2>" for line in diagnosis.headlines)
        self._verdict.object = (
            f"{says}<p>{text[0].upper()}{text[1:]}.</p>"
            f"<p class='faint'>{escape(answer['summary'])}</p>"
        )
        self._rest.object = _rest(diagnosis)
        self._last.visible = bool(self._rest.object)
        self._why_not.object = why_not_table(diagnosis)
        self._show_evidence(diagnosis)

    def _show_evidence(self, diagnosis: DiagnosisView) -> None:
        """Show the evidence for the findings, then for their rivals, which can be taken there."""
        self._add_buttons = {}
        wanted = self._offer_causes(diagnosis)
        parts = [
            self._proof(
                effect,
                _heading(diagnosis.causes.get(effect, ""), effect),
                figure,
                diagnosis,
                diagnosis.step_of(effect),
            )
            for effect, figure in diagnosis.evidence.items()
            if wanted in (EVERY, effect)
        ]
        ranked = [
            self._alternative(one, one.evidence, diagnosis)
            for one in diagnosis.alternatives
            if one.evidence is not None and wanted in (EVERY, one.step.effects[-1])
        ]  # fmt: skip
        if ranked:
            parts.append(html("<h3>Ranked, but not chosen</h3><p class='faint'>The same picture of "
                              "each, with numbers of its own.</p>"))  # fmt: skip
            parts += ranked
        self._evidence.objects = parts or [html("<p class='faint'>none: nothing was found</p>")]

    def _offer_causes(self, diagnosis: DiagnosisView) -> str:
        """The causes that have evidence; the one that the address names is chosen."""
        ranked = [one.step.effects[-1] for one in diagnosis.alternatives if one.evidence]
        causes = dict.fromkeys([*diagnosis.evidence, *ranked])
        options = {EVERY: EVERY} | {said(name): name for name in causes}
        asked = self.address.read("effect")
        self._quiet = True
        self._cause.options = options
        self._cause.value = asked if asked in causes else EVERY
        self._quiet = False
        return str(self._cause.value)

    def _choose_cause(self) -> None:
        if not self._quiet and self.session.diagnosis is not None:
            chosen = self._cause.value
            self.address.write(effect=None if chosen == EVERY else chosen)
            self.caught(lambda: self._show_diagnosis())

    def _proof(
        self, effect: str, heading: str, data: FigureData, diagnosis: DiagnosisView,
        step: tuple[str, ...], *more: Any,
    ) -> Any:  # fmt: skip
        """The evidence for an effect with its words, and the motion without and with its step."""
        looks = escape(diagnosis.looks.get(effect, ""))
        text = html(f"<h3>{heading}</h3><p>Looks like: {looks}.</p>"
                    f"<p class='faint'>{escape(data.caption)}</p>")  # fmt: skip
        place = FigurePlace(self.view, min_height=230)
        place.show(data)
        motion = stack()
        if step in diagnosis.motion and step in {each.effects for each in diagnosis.steps}:
            self._show_motion(motion, diagnosis.motion[step])
        elif step in diagnosis.motion:  # drawn when asked for: there may be many
            motion.append(button("What it does to the motion", self.guarded(
                lambda: self._show_motion(motion, diagnosis.motion[step])), width=260))  # fmt: skip
        return stack(text, *more, side_by_side(place.part, motion))

    def _show_motion(self, part: Any, data: FigureData) -> None:
        """Velocities measured, without and with an effect."""
        place = FigurePlace(LinkedView(self.theme))
        place.show(data)
        hint = "What it does to the motion: free predictions before and after."
        part.objects = [html(f"<p class='faint'>{hint}</p>"), place.part]

    def _alternative(
        self, one: AlternativeView, evidence: FigureData, diagnosis: DiagnosisView
    ) -> Any:
        """The evidence for an alternative, with its name and error, and a button to add it."""
        effects, error = one.step.effects, one.step.bar.error
        added = button(f"Add {said(effects[-1])}", self._climber(one.step), width=220)
        self._add_buttons[effects] = added
        there = " beside " + ", ".join(map(_plain, effects[:-1])) if effects[1:] else ""
        best = next((s for s in diagnosis.steps if len(s.effects) == len(effects)), None)
        against = f", {_plain(best.effects[-1])} {best.bar.error:.3f}" if best else ""
        tied = " <span class='warn'>cannot be told from it here</span>" if one.rival else ""
        says = _heading(one.step.says, effects[-1])
        heading = (f"{says}{there} <span class='faint'>error {error:.3f}{against}</span>"
                   f"{tied}")  # fmt: skip
        return self._proof(effects[-1], heading, evidence, diagnosis, effects, added)

    def _climber(self, step: LadderView) -> Callable[[], None]:
        return self.guarded(lambda: self.session.climb(step))

    def _show_ladder(self) -> None:
        """The ladder as far as the user has climbed it, and what can be added next."""
        diagnosis, version = self.session.diagnosis, self.session.version
        self._save.update()
        bars = version.ladder if version else ()
        if diagnosis is not None and not bars:
            bars = tuple(step.bar for step in diagnosis.steps[:1])
        self._ladder.show(ladder_bars(bars, diagnosis.floor) if diagnosis and bars else None)
        effects = ", ".join(map(_plain, version.effects)) if version else ""
        self._now.object = (
            f"<p>In the vessel now: <strong>{effects}</strong></p>"
            if effects
            else ("" if diagnosis else self._not_found_yet())
        )
        self._candidates.objects = self._rows(diagnosis)

    def _rows(self, diagnosis: DiagnosisView | None) -> list[Any]:
        """Rows of the ladder: steps that can come next, and those that could replace the last."""
        if diagnosis is None:
            return [html(AFTER)]
        version = self.session.version
        now = diagnosis.added_since(version.effects if version else ())
        if now is None:
            return [html("<p>The vessel has been changed since: find what is missing again.</p>")]
        rows = [self._base(diagnosis)] if diagnosis.answer["base_changed"] and not now else []
        rows += self._steps(diagnosis, now, now)
        if now and (instead := self._steps(diagnosis, now[:-1], now)):
            rows += [html(f"<h3>In the place of {_plain(now[-1])}</h3>"), *instead]
        for effects, added in self._add_buttons.items():
            added.disabled = effects == now
        return rows or [html("<p class='faint'>nothing more</p>")]

    def _base(self, diagnosis: DiagnosisView) -> Any:
        """The nine numbers alone, where they had to move."""
        step, version = diagnosis.steps[1], self.session.version
        there = version is not None and version.text != diagnosis.steps[0].text
        use = button("Use", self._climber(step), width=90, disabled=there)
        text = f"<strong>the {word('base')} re-fitted</strong>: error {step.bar.error:.3f}"
        return _row(use, text, "as given, these numbers predict unseen time worse")

    def _steps(
        self, diagnosis: DiagnosisView, below: tuple[str, ...], now: tuple[str, ...]
    ) -> list[Any]:
        """A row with its button for each step above the effects `below`; `now` is the vessel's."""
        rows = []
        for step in diagnosis.next_steps(below)[:MOST_CANDIDATES]:
            effect, there = step.effects[-1], step.effects == now
            kind = "primary" if diagnosis.is_advised(step) and not there else "default"
            text = "Added" if there else "Instead" if len(step.effects) == len(now) else "Add"
            add = button(text, self._climber(step), kind, width=90, disabled=there)
            says = escape(step.says or said(effect))
            text = f"<strong>{says}</strong>: error {step.bar.error:.3f}"
            looks = escape(diagnosis.looks.get(effect, ""))
            hint = f"{_plain(effect)}; looks like: {looks}"
            rows.append(_row(add, text + _ranked(diagnosis, step), hint))
        return rows

    def _show_unseen(self) -> None:
        """The recordings that the diagnosis did not learn from."""
        diagnosis = self.session.diagnosis
        unseen = [
            trial for trial in self.session.trials
            if diagnosis and trial.log not in diagnosis.logs and trial.vessels
        ]  # fmt: skip
        changed = len(self.session.vessels()) > 1
        current = self.session.is_current
        self._unseen.object = (
            error_table("a recording it never saw", unseen, current) if unseen and changed else ""
        )


def _row(add: Any, text: str, hint: str) -> Any:
    """A button, and beside it a line of HTML with a hint below."""
    line = html(f"{text}<br><span class='faint'>{hint}</span>")
    return pn.Row(add, pn.Spacer(width=12, sizing_mode="fixed"), line,
                  sizing_mode="stretch_width", margin=(2, 0))  # fmt: skip


def _ranked(diagnosis: DiagnosisView, step: LadderView) -> str:
    """Probability of an effect beside the others, and those that it cannot be told from."""
    effect = step.effects[-1]
    row = next((r for r in diagnosis.answer["ranking"] if r["effect"] == effect), None)
    if row is None or len(step.effects) > 1:
        rival = any(one.rival for one in diagnosis.alternatives if one.step is step)
        return " <span class='warn'>does as well here</span>" if rival else ""
    tied = ", ".join(map(_plain, row["confounded_with"]))
    alike = f" <span class='warn'>cannot be told from {tied} here</span>" if tied else ""
    return f", {word('probability')} {escape(probability_text(row['probability']))}{alike}"


def _heading(says: str, effect: str) -> str:
    """The finding in words, the name of the effect small; without words the name alone."""
    if not says:
        return _plain(effect)
    return f"{escape(says)} <span class='faint'>{_plain(effect)}</span>"


def _plain(effect: str) -> str:
    return escape(said(effect))


def why_not_table(diagnosis: DiagnosisView) -> str:
    """Table of the effects that were tried and not chosen, each with the reason, as HTML."""
    alike: dict[str, list[str]] = {}
    for effect, text in diagnosis.why_not.items():
        alike.setdefault(text, []).append(_plain(effect))
    rows = [[", ".join(effects), escape(text)] for text, effects in alike.items()]
    if not rows:
        return "<p class='faint'>nothing was tried and not chosen</p>"
    return table(["cause", "why not"], rows, text=(0, 1))


def _rest(diagnosis: DiagnosisView) -> str:
    """Numbers found, what is left, what would settle it, what could not be judged."""
    answer, parts = diagnosis.answer, []
    rows = []
    told = {} if diagnosis.curve_stands_alone else answer["ladder"][-1]["parameters"]
    for effect, numbers in told.items():
        for name, n in numbers.items():
            unit, many = peoples_unit(n["unit"])
            value, low, high = (many * x for x in (n["value"], *n["ci95"]))
            interval, doubt = f"{low:.4g} … {high:.4g}", escape(n.get("doubt", ""))
            number = f"{_plain(effect)}: {escape(name)}"
            rows.append([number, f"{value:.4g}", interval, escape(unit), doubt])
    if rows:
        heads = ["number", "value", word("95 % interval"), "unit", ""]
        parts.append("<h2>What was found</h2>" + table(heads, rows, text=(0, 3, 4)))
    manoeuvres = dict.fromkeys((answer["next_manoeuvre"], *diagnosis.separations))
    lists = {
        "What is left depends on": [each["says"] for each in answer["depends_on"]],
        "The manoeuvre that would settle it": [text for text in manoeuvres if text],
    }
    parts += [f"<h2>{heading}</h2>{bullets(texts)}" for heading, texts in lists.items() if texts]
    return "".join(parts)
