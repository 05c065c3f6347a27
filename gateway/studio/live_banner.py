"""What a live gateway says of the model of its boat, with a way from there to a diagnosis."""

from collections.abc import Callable, Iterable
from html import escape
from typing import Any

import panel as pn

from gateway.studio.live_history import WatchedBoat
from gateway.studio.page import NO_BUTTON, button, html, stack
from sim.monitoring.alarm import ModelEvent

ALERT = {
    "background": "var(--paper)", "border": "2px solid var(--warn)", "border-radius": "10px",
    "padding": "8px 14px", "margin": "0 0 14px 0", "flex-direction": "row", "flex-wrap": "wrap",
    "align-items": "center", "gap": "4px 14px",
}  # fmt: skip


def sentence_of(boat: WatchedBoat) -> str | None:
    """What its gateway says now of a model that is wrong; None where it says nothing of the kind.

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
        """What is said now; a banner that stays the same keeps the keyboard's focus."""
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
