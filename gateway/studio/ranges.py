"""A marked range as the input of all work: its numbers, its name, and whether it alone is used."""

from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np

from gateway.errors import BadInput
from gateway.figures.style import velocity_texts
from gateway.studio.page import Page, button, control_row, field, html, select, stack
from gateway.studio.session import Session
from gateway.studio.views import WHOLE, Scope, TimeRanges, TrialView, VesselView, inside

ALL, ONLY, WITHOUT = "all of the time", "only what is marked", "all but what is marked"
NONE = "–"


def scope_text(session: Session) -> str:
    """That not all of the time is worked on, as HTML; empty where all of it is."""
    text = session.scope.text
    return f"<p class='warn'>Worked on {escape(text)}.</p>" if text else ""


class RangeControls:
    """Below the choice of a recording: use the mark, keep it under a name, mark what was kept.

    mark    what to do to mark stretches of a recording
    marked  which recording is shown, and what is marked on it
    """

    def __init__(
        self,
        page: Page,
        mark: Callable[[str, TimeRanges], None],
        marked: Callable[[], tuple[str, TimeRanges]],
    ) -> None:
        self._page, self._session, self._mark, self._marked = page, page.session, mark, marked
        self._quiet = False
        self._use = select("Compare, diagnose and fit on", [ALL, ONLY, WITHOUT], width=230)
        self._name = field("Name of the marked range", width=190)
        self._kept = select("Kept ranges", [NONE], width=190)
        self._use.param.watch(self._chosen(self._apply), "value")
        self._kept.param.watch(self._chosen(self._show_kept), "value")
        self._numbers = html()
        self.part = stack(
            control_row(
                self._use, self._name, button("Keep", page.guarded(self._keep), width=80),
                self._kept, button("Forget", page.guarded(self._forget), width=90),
            ),
            self._numbers,
        )  # fmt: skip

    def update(self) -> None:
        """After the layout or what is worked on has changed."""
        self._quiet = True
        self._kept.options = [NONE, *self._session.layout.ranges]
        scope = self._session.scope
        self._use.value = ALL if not scope.times else WITHOUT if scope.without else ONLY
        self._quiet = False

    def show_numbers(self, trial: TrialView | None, vessel: VesselView | None) -> None:
        """The errors within what is marked."""
        times = self._marked()[1]
        self._numbers.object = range_text(trial, vessel, times) if trial and vessel else ""

    def follow(self) -> None:
        """Another range was marked: where one is worked on, it is that one from now on."""
        scope, (name, times) = self._session.scope, self._marked()
        if scope.times and scope.recording == name and times and scope.times != times:
            self._session.set_scope(Scope(name, times, scope.without))

    def _chosen(self, work: Callable[[], None]) -> Callable[[Any], None]:
        def run(_: Any) -> None:
            if not self._quiet:
                self._page.guarded(work)()

        return run

    def _apply(self) -> None:
        name, times = self._marked()
        if self._use.value == ALL:
            self._session.set_scope(WHOLE)
        elif not times:
            self.update()
            raise BadInput("mark a stretch of time first: drag along a time axis")
        else:
            self._session.set_scope(Scope(name, times, self._use.value == WITHOUT))

    def _keep(self) -> None:
        name = self._name.value.strip()
        self._session.keep_range(name, *self._marked())
        self._page.notify(f"range {name} kept", good=True)

    def _show_kept(self) -> None:
        kept = self._session.layout.ranges.get(self._kept.value)
        if kept is not None:
            self._name.value = self._kept.value
            self._mark(kept.recording, kept.times)

    def _forget(self) -> None:
        if self._kept.value == NONE:
            raise BadInput("choose a kept range first")
        self._session.forget_range(self._kept.value)


def range_text(trial: TrialView, vessel: VesselView, times: TimeRanges) -> str:
    """Errors of the free predictions within stretches of time; nothing where none is marked."""
    if not times or vessel.motion is None:
        return ""
    error = (trial.motion - vessel.motion)[inside(trial.time, times)][:, 3:]
    known = np.isfinite(error).all(axis=1)
    seconds = sum(end - start for start, end in times)
    if not known.any():
        return f"<p>Marked: {seconds:.0f} s, without any prediction in them.</p>"
    rmse = dict(zip("uvr", np.sqrt((error[known] ** 2).mean(axis=0)), strict=True))
    u, v, r = velocity_texts(rmse)
    return (f"<p>Marked: {seconds:.0f} s; there {escape(vessel.name)} is off by {u} m/s ahead, "
            f"{v} m/s sideways and {r} °/s, root mean square.</p>")  # fmt: skip
