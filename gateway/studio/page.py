"""A page open in one browser: its theme, its view of the session, what it does on a change.

Pages have no threads. Each looks at the session a few times a second on the server's own loop and
draws what has another revision than what it drew last.
"""

import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from sys import stderr
from typing import Any, ClassVar

import panel as pn

from gateway.config import StudioSettings
from gateway.errors import ShadowError
from gateway.figures.bokeh_draw import BokehFigure, LinkedView
from gateway.figures.figure_data import FigureData
from gateway.figures.style import LIGHT, THEMES
from gateway.studio.live_history import LiveHistory
from gateway.studio.session import Session
from gateway.studio.views import TrialView
from gateway.studio.widgets import bokeh_part, button, control_row, field, html, stack, table, word
from gateway.studio.worker import BUG
from sim.effects.effect import LawError

PERIOD_MS = 200
SHOW_QUICK_S = 0.5  # a comparison that takes longer is shown as work under way
TEMPLATE = (Path(__file__).parent / "template.html").read_text(encoding="utf-8")

Watches = Mapping[tuple[str, ...], Callable[[], None]]


@dataclass(frozen=True)
class PageEntry:
    """A page in the catalogue: its address, its title, where it stands, its class, what it is for.

    Pages stand in the order of `order`; the studio opens with the first.
    """

    path: str
    title: str
    order: int
    page: "type[Page]"
    description: str


@dataclass(frozen=True)
class StudioContext:
    """What every page gets: the session, live boats, settings, and the pages that there are."""

    session: Session
    live: LiveHistory
    settings: StudioSettings
    pages: Sequence[PageEntry]


class Page(ABC):
    """What all pages share; a page says what it is made of and what follows which change."""

    period_ms: ClassVar[int] = PERIOD_MS

    def __init__(self, context: StudioContext) -> None:
        self.context, self.session = context, context.session
        cookie = str((pn.state.cookies or {}).get("shadow_theme", ""))
        self.theme = THEMES.get(cookie, LIGHT)
        self.view = LinkedView(self.theme)
        self._seen: dict[tuple[str, ...], int] = {}
        self._work = html(styles={"min-height": "42px"})
        self._cancel = button("Cancel", self.session.cancel, visible=False, width=90)

    @abstractmethod
    def body(self) -> Any:
        """The parts of the page."""

    def watch(self) -> Watches:
        """Kinds of change -> what to do then; each is also called once at the start."""
        return {}

    def tick(self) -> None:  # noqa: B027
        """Called a few times a second; for what moves by itself."""

    def show(self, entry: PageEntry) -> Any:
        """The page as the server wants it."""
        work = pn.Row(self._work, self._cancel, sizing_mode="stretch_width")
        template = pn.Template(TEMPLATE)
        template.add_variable("theme", self.theme.name)
        template.add_variable("here", entry)
        template.add_variable("pages", self.context.pages)
        template.add_panel("main", stack(work, self.body()))
        look = self.guarded(self._look)
        look()
        pn.state.add_periodic_callback(look, self.period_ms)
        return template

    def guarded(self, work: Callable[[], None]) -> Callable[[], None]:
        """Work whose errors are a line on the page, never a traceback."""

        def run() -> None:
            try:
                work()
            except (ShadowError, LawError, RuntimeError) as error:
                self.session.notify(" ".join(str(error).split()))
            except Exception as error:  # the outermost loop of a page
                print(traceback.format_exc(), file=stderr, flush=True)
                self.session.notify(f"{BUG} ({type(error).__name__})")

        return run

    def _look(self) -> None:
        self.session.update()
        for kinds, work in self.watch().items():
            now = sum(self.session.revision[kind] for kind in kinds)
            if self._seen.get(kinds) != now:
                self._seen[kinds] = now
                self.guarded(work)()
        self.tick()
        self._show_work()

    def _show_work(self) -> None:
        """What is under way, the last notice, and a way to stop it."""
        slow, quick = self.session.slow, self.session.quick
        lines = []
        if slow.busy:
            lines.append(f"<strong>{escape(str(slow.job))}</strong>: {escape(slow.progress)} "
                         f"<span class='faint'>({slow.seconds:.0f} s)</span>")  # fmt: skip
        elif quick.busy and quick.seconds > SHOW_QUICK_S:
            lines.append(f"<strong>compare</strong>: {escape(quick.progress)}")
        if self.session.notice:
            tone, notice = "good" if self.session.good else "warn", escape(self.session.notice)
            lines.append(f"<span class='{tone}' role='status'>{notice}</span>")
        text = "".join(f"<p>{line}</p>" for line in lines)
        if self._work.object != text:
            self._work.object = text
        if self._cancel.visible != slow.busy:
            self._cancel.visible = slow.busy


class FigurePlace:
    """A place of a page for one figure, filled in place while new data have the same shape."""

    def __init__(self, view: LinkedView, **more: Any) -> None:
        self.part = stack(**more)
        self.figure: BokehFigure | None = None
        self._view = view

    def show(self, data: FigureData | None) -> None:
        """The figure of these data, or nothing."""
        if data is None:
            self.figure, self.part.objects = None, []
        elif self.figure is None or not self.figure.update(data):
            self.figure = BokehFigure(data, self._view)
            self.part.objects = [bokeh_part(self.figure.layout)]


def error_table(heading: str, trials: Sequence[TrialView]) -> str:
    """The error of the vessel as given and as it is now, on recordings that were compared."""
    rows = [
        [escape(t.name), f"{t.vessels[0].nrmse:.3f}", f"{t.vessels[-1].nrmse:.3f}",
         f"{t.vessels[-1].floor:.3f}"] for t in trials
    ]  # fmt: skip
    return table([heading, "error as given", "error now", word("noise floor")], rows)


class SaveControls:
    """Undo, a name, and a button that saves the vessel; a name is proposed at first."""

    def __init__(
        self, page: Page, label: str, ending: str, *more: Any, widths: tuple[int, int], **style: Any
    ) -> None:
        self._session, self._ending = page.session, ending
        self._undo = button("Undo", page.guarded(page.session.undo), width=90)
        self._name = field(label, width=widths[0])
        save = button("Save vessel file", page.guarded(self._save), width=widths[1], **style)
        self.part = control_row(self._undo, self._name, save, *more)

    def update(self) -> None:
        """After the vessel has changed."""
        self._undo.disabled = len(self._session.versions) < 2
        file = self._session.vessel_file
        if file is not None and not self._name.value:
            self._name.value = f"{file.stem}-{self._ending}.toml"

    def _save(self) -> None:
        file = self._session.save(self._name.value.strip())
        self._session.notify(f"saved: {file}", good=True)
