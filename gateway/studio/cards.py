"""What is in each recording, read in the background one after the other, as cards for people."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from html import escape
from pathlib import Path

import numpy as np

from gateway.errors import ShadowError
from gateway.ingest.open import open_log
from gateway.ingest.survey import Survey, survey
from gateway.offline.trials import FIRST_LOOK, trials_of
from gateway.studio.worker import Send, Worker
from sim.state import Eta, Floats

POINTS = 200  # of a small track
WIDTH, HEIGHT, EDGE = 150, 90, 6  # px of it
MOST_RATES = 8  # messages whose rates are shown
FIRST_YEAR = 2005  # a clock that says less was never set


@dataclass(frozen=True)
class CardView:
    """A recording: what is in it, and of its trials the first time [ns], place, usable time [s] and
    track (n, 2) east, north [m]; `why_not`: why none of it can be used."""

    survey: Survey
    start_time_ns: int = 0
    origin_deg: tuple[float, float] | None = None
    usable_s: float = 0.0
    track: Floats = field(default_factory=lambda: np.empty((0, 2)))
    why_not: str = ""


def card_task(send: Send, path: str, mapping: str | None = None) -> CardView:
    """Read a recording for its card."""
    log = open_log(path, mapping)
    found = survey(log)
    try:
        trials = trials_of(log, replace(FIRST_LOOK, mapping=mapping))
    except ShadowError as error:
        return CardView(found, why_not=" ".join(str(error).split()))
    track = np.concatenate([trial.eta[:, [Eta.EAST, Eta.NORTH]] for trial in trials])
    return CardView(
        found, trials[0].start_time_ns, trials[0].origin_deg,
        sum(float(trial.usable.sum()) * trial.dt for trial in trials),
        track[:: max(len(track) // POINTS, 1)],
    )  # fmt: skip


@dataclass
class CardReader:
    """A worker of its own and the cards it has read; `refused`: path -> why there is none."""

    worker: Worker = field(default_factory=Worker)
    cards: dict[str, CardView] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    _wanted: list[str] = field(default_factory=list)
    _reading: str = ""

    def want(self, paths: Sequence[Path]) -> None:
        """Read those that were not read yet, in this order."""
        known = {*self.cards, *self.refused, *self._wanted, self._reading}
        self._wanted += [str(path) for path in paths if str(path) not in known]

    def is_waiting(self, path: str) -> bool:
        """Whether a recording will be read, or is being read."""
        return path in self._wanted or path == self._reading

    def update(self, mapping: str | None) -> bool:
        """Take what was read, begin the next; whether there is something new."""
        news = False
        for message in self.worker.messages():
            if message.kind == "done":
                self.cards[self._reading] = message.value
            elif message.kind == "failed":
                self.refused[self._reading] = message.value
            if message.kind in ("done", "failed"):
                self._reading, news = "", True
        if self._wanted and not self.worker.busy:
            self._reading = self._wanted.pop(0)
            self.worker.start("look", card_task, self._reading, mapping)
            news = True
        return news


def card_text(path: Path, reader: CardReader) -> str:
    """A recording in words with its track, or why there is none, as HTML."""
    name = f"<h3>{escape(path.name)}</h3>"
    view = reader.cards.get(str(path))
    if view is None:
        why = reader.refused.get(str(path))
        waiting = "<p class='faint'>being read …</p>" if reader.is_waiting(str(path)) else ""
        return name + (f"<p class='warn'>{escape(why)}</p>" if why else waiting)
    found = view.survey
    boats = "; ".join(escape(f"{b.boat} {b.firmware}".strip()) for b in found.boats) or "no boat"
    fastest = sorted(found.messages.items(), key=lambda item: -item[1].rate_hz)[:MOST_RATES]
    rates = ", ".join(f"{escape(name)} {message.rate_hz:.1f} Hz" for name, message in fastest)
    warnings = [note for boat in found.boats for note in boat.notices]
    warnings += [view.why_not] if view.why_not else []
    notes = "".join(f"<p class='warn'>{escape(note)}</p>" for note in warnings)
    limits = "".join(f"<li>{escape(text)}</li>" for boat in found.boats for text in boat.good_for)
    return (
        f"{name}<p>{_when_and_where(view)}{_minutes(found.seconds)}, "
        f"<strong>{_minutes(view.usable_s)} usable</strong></p>{track_svg(view.track)}"
        f"<p class='faint'>{escape(found.kind)}, {found.statistics.size_bytes / 1e6:.1f} MB; "
        f"{boats}</p>{notes}<details><summary>What it is good for</summary><ul>{limits}</ul>"
        f"<p class='faint'>{rates}</p></details>"
    )


def _minutes(seconds: float) -> str:
    return f"{seconds / 60.0:.0f} min" if seconds >= 120.0 else f"{seconds:.0f} s"


def _when_and_where(view: CardView) -> str:
    """Date and place, as far as the recording knows them."""
    when = datetime.fromtimestamp(view.start_time_ns * 1e-9, UTC) if view.start_time_ns else None
    parts = [f"{when:%d %b %Y %H:%M} UTC"] if when and when.year >= FIRST_YEAR else []
    if view.origin_deg is not None:
        lat, lon = view.origin_deg
        parts.append(f"{abs(lat):.3f}° {'NS'[lat < 0]}, {abs(lon):.3f}° {'EW'[lon < 0]}")
    return "".join(f"{part}<br>" for part in parts)


def track_svg(track: Floats) -> str:
    """A track (n, 2) east, north [m] as a small picture, north up; empty without any motion."""
    size = float(np.ptp(track, axis=0).max()) if len(track) > 1 else 0.0
    if not size > 0.0:
        return ""
    scale = min((WIDTH - 2 * EDGE) / max(float(np.ptp(track[:, 0])), 1e-9),
                (HEIGHT - 2 * EDGE) / max(float(np.ptp(track[:, 1])), 1e-9))  # fmt: skip
    x = EDGE + scale * (track[:, 0] - track[:, 0].min())
    y = HEIGHT - EDGE - scale * (track[:, 1] - track[:, 1].min())
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return (f'<svg width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="track, {size:.0f} m '
            f'wide"><polyline points="{points}" fill="none" stroke="var(--accent)" '
            'stroke-width="2"/></svg>')  # fmt: skip
