"""Parts that several pages have: a place for a figure, a table of errors, saving a vessel."""

from collections.abc import Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from gateway.errors import BadInput
from gateway.figures.bokeh_draw import BokehFigure, LinkedView
from gateway.figures.figure_data import FigureData
from gateway.studio.page import (
    Page,
    bokeh_part,
    boxes,
    button,
    control_row,
    download,
    field,
    stack,
    table,
    word,
)
from gateway.studio.views import TrialView


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


def error_table(heading: str, trials: Sequence[TrialView], current: bool) -> str:
    """The error of the vessel as given and as it is now, on recordings that were compared.

    `current`: they were compared with the vessel as it is now; else no number stands for it.
    """
    rows = [
        [escape(t.name), f"{t.vessels[0].nrmse:.3f}",
         f"{t.vessels[-1].nrmse:.3f}" if current else "comparing …",
         f"{t.vessels[-1].floor:.3f}"] for t in trials
    ]  # fmt: skip
    return table([heading, "error as given", "error now", word("noise floor")], rows)


def report_download(page: Page) -> Any:
    """A button that hands the last report to the browser; not there before there is one."""
    return download("Download the report", "report.html",
                    lambda: BytesIO(Path(page.session.report).read_bytes()),
                    width=180, visible=False)  # fmt: skip


class LearnFrom:
    """Boxes of the recordings that a diagnosis and a fit learn from, the same on all pages."""

    def __init__(self, page: Page) -> None:
        self._session = page.session
        self.part = boxes(options=[], inline=True)
        self.part.param.watch(lambda _: self._choose(), "value")

    def update(self) -> None:
        """After the choice of recordings has changed."""
        self.part.options = [path.name for path in self._session.logs]
        chosen = self._session.learn_from or self._session.logs[:1]
        self.part.value = [path.name for path in chosen]

    def check(self) -> None:
        """BadInput where none is chosen."""
        if not self.part.value:
            raise BadInput("choose at least one recording to learn from")

    def _choose(self) -> None:
        names = set(self.part.value)
        self._session.learn_from = tuple(p for p in self._session.logs if p.name in names)


class SaveControls:
    """Undo, redo, a name, and a button that saves the vessel; a name is proposed at first."""

    def __init__(
        self, page: Page, label: str, ending: str, *more: Any, widths: tuple[int, int], **style: Any
    ) -> None:
        self._page, self._session, self._ending = page, page.session, ending
        self._undo = button("Undo", page.guarded(page.session.undo), width=90)
        self._redo = button("Redo", page.guarded(page.session.redo), width=90)
        self._name = field(label, width=widths[0])
        save = button("Save vessel file", page.guarded(self._save), width=widths[1], **style)
        self.part = control_row(self._undo, self._redo, self._name, save, *more)

    def update(self) -> None:
        """After the vessel has changed."""
        self._undo.disabled = len(self._session.versions) < 2
        self._redo.disabled = not self._session.undone
        file = self._session.vessel_file
        if file is not None and not self._name.value:
            self._name.value = f"{file.stem}-{self._ending}.toml"

    def _save(self) -> None:
        file = self._session.save(self._name.value.strip())
        self._page.notify(f"saved: {file}", good=True)
