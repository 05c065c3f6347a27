"""One page open in one browser: its look, its part of the desk, and what it does when that changes.

Pages have no threads. Each looks at the desk a few times a second on the server's own loop and
draws what has another revision than what it drew last.
"""

import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from html import escape
from pathlib import Path
from sys import stderr
from typing import Any, ClassVar

import panel as pn

from gateway.errors import ShadowError
from gateway.figures.bokeh_draw import BokehFigure, LinkedView
from gateway.figures.figure_data import FigureData
from gateway.figures.style import LIGHT, THEMES
from gateway.studio.session import Session
from gateway.studio.widgets import button, drawn, html
from gateway.studio.worker import BUG
from sim.effects.effect import LawError

PERIOD_MS = 200
TEMPLATE = (Path(__file__).parent / "template.html").read_text(encoding="utf-8")


class Page(ABC):
    """What all pages share; a page says what it is made of and what follows which change."""

    name: ClassVar[str]
    title: ClassVar[str]
    period_ms: ClassVar[int] = PERIOD_MS

    def __init__(self, desk: Session) -> None:
        self.desk = desk
        self.look = THEMES.get(_cookie("shadow_theme"), LIGHT)
        self.stage = LinkedView(self.look)
        self._seen: dict[str, int] = {}
        self._work = html(styles={"min-height": "42px"})
        self._cancel = button("Cancel", self.desk.cancel, visible=False, width=90)

    @abstractmethod
    def body(self) -> Any:
        """The parts of the page."""

    @abstractmethod
    def watch(self) -> dict[tuple[str, ...], Callable[[], None]]:
        """Kinds of change -> what to do then; each is also called once at the start."""

    def tick(self) -> None:  # noqa: B027
        """Called a few times a second; for what moves by itself."""

    def show(self) -> Any:
        """The page as the server wants it."""
        work = pn.Row(self._work, self._cancel, sizing_mode="stretch_width")
        main = pn.Column(work, self.body(), sizing_mode="stretch_width")
        template = pn.Template(TEMPLATE)
        template.add_variable("theme", self.look.name)
        template.add_variable("here", self.name)
        template.add_variable("pages", PAGES)
        template.add_panel("main", main)
        template.title = f"{self.title} – Shadow studio"
        self._round()
        pn.state.add_periodic_callback(self._round, self.period_ms)
        return template

    def safely(self, work: Callable[[], None]) -> Callable[[], None]:
        """Work whose mistakes are told in a line on the page, never as a traceback."""

        def guarded() -> None:
            try:
                work()
            except (ShadowError, LawError) as error:
                self.desk.say(" ".join(str(error).split()))
            except RuntimeError as error:
                self.desk.say(str(error))
            except Exception as error:  # the outermost loop of a page
                print(traceback.format_exc(), file=stderr, flush=True)
                self.desk.say(f"{BUG} ({type(error).__name__})")

        return guarded

    def fill(
        self, place: Any, data: FigureData | None, kept: dict[str, BokehFigure], key: str
    ) -> None:
        """A figure into a place of the page: in the picture that is there, if it fits into it."""
        if data is None:
            place.objects = []
            kept.pop(key, None)
            return
        if key in kept and kept[key].update(data):
            return
        kept[key] = BokehFigure(data, self.stage)
        place.objects = [drawn(kept[key])]

    def _round(self) -> None:
        self.safely(self._look)()

    def _look(self) -> None:
        self.desk.look_around()
        for kinds, work in self.watch().items():
            key, now = " ".join(kinds), sum(self.desk.revision[kind] for kind in kinds)
            if self._seen.get(key) != now:
                self._seen[key] = now
                self.safely(work)()
        self.tick()
        self._tell_work()

    def _tell_work(self) -> None:
        """What is under way, what was said last, and a way to stop it."""
        slow, quick = self.desk.slow, self.desk.quick
        lines = []
        if slow.busy:
            lines.append(f"<strong>{escape(str(slow.job))}</strong>: {escape(slow.says)} "
                         f"<span class='faint'>({slow.seconds:.0f} s)</span>")  # fmt: skip
        elif quick.busy and quick.seconds > 0.5:
            lines.append(f"<strong>compare</strong>: {escape(quick.says)}")
        if self.desk.notice:
            tone = "good" if self.desk.good else "warn"
            lines.append(f"<span class='{tone}' role='status'>{escape(self.desk.notice)}</span>")
        text = "".join(f"<p>{line}</p>" for line in lines)
        if self._work.object != text:
            self._work.object = text
        if self._cancel.visible != slow.busy:
            self._cancel.visible = slow.busy


PAGES = [
    ("compare", "Compare"), ("diagnose", "Diagnose"), ("vessel", "Vessel"), ("live", "Live"),
    ("recordings", "Recordings"),
]  # fmt: skip


def _cookie(name: str) -> str:
    value = (pn.state.cookies or {}).get(name, "")
    return str(value)
