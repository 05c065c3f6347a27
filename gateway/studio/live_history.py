"""What shadows have said in the last minutes: looked at ten times a second, by one thread for all
pages. zenoh waits and joins here, never on the page's own loop.
"""

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Self

import numpy as np

from gateway.errors import ShadowError
from gateway.monitor.vessel_status import Message, VesselStatus
from gateway.monitor.watcher import BusWatcher, MonitorOptions
from sim.state import Floats

PERIOD_S = 0.1
WINDOW_S = 60.0
TRACK_S = 300.0
TRACK_EVERY = 5  # looks between two points of a track
MOVING = ("measured", "shadow", "reference")
LARGEST_M = 1e7


@dataclass(frozen=True)
class Now:
    """One boat as it is, with what it did."""

    name: str
    alive: bool
    events: Sequence[Message]
    picture: VesselStatus
    tracks: dict[str, tuple[list[float], list[float]]]
    rows: dict[str, Floats]

    def message(self, topic: str) -> Message | None:
        """The latest of a topic."""
        return self.picture.message(topic)

    def boat(self) -> Message | None:
        """How it moves as measured; while the link is down, how its shadow does."""
        return self.message("measured") or self.message("shadow")

    def track(self, topic: str) -> tuple[list[float], list[float]]:
        """East and north [m]."""
        return self.tracks.get(topic, ([], []))

    def since(self, topic: str, time: float) -> Floats:
        """Rows (n, 4) of Unix time [s], u, v [m/s], r [°/s] after that time."""
        rows = self.rows.get(topic)
        return np.empty((0, 4)) if rows is None else rows[rows[:, 0] > time]


class Pages:
    """The history of one boat."""

    def __init__(self) -> None:
        self.rows = {t: deque[tuple[float, ...]](maxlen=int(WINDOW_S / PERIOD_S)) for t in MOVING}
        length = int(TRACK_S / PERIOD_S / TRACK_EVERY)
        self.tracks = {t: deque[tuple[float, float]](maxlen=length) for t in MOVING[:2]}
        self._looks: dict[str, int] = defaultdict(int)

    def take(self, picture: VesselStatus) -> None:
        """One look: what is new of each topic."""
        for topic in MOVING:
            message = picture.message(topic)
            if message is not None and _sane(message):
                self._take(topic, message)

    def _take(self, topic: str, m: Message) -> None:
        time, rows = m["receive_time_ns"] * 1e-9, self.rows[topic]
        if rows and time <= rows[-1][0]:
            if time > rows[-1][0] - WINDOW_S:
                return
            rows.clear()  # the clock was set back, or a recording begins again
        rows.append((time, m["surge_mps"], m["sway_mps"], math.degrees(m["yaw_rate_radps"])))
        self._looks[topic] += 1
        if topic in self.tracks and self._looks[topic] % TRACK_EVERY == 1:
            self.tracks[topic].append((m["east_m"], m["north_m"]))


def _sane(m: Message) -> bool:
    """Anybody may publish: what would break a chart is left out."""
    return all(abs(m[k]) < LARGEST_M for k in ("east_m", "north_m", "surge_mps", "sway_mps")) and (
        0 < m["receive_time_ns"] < 1e19
    )


class LiveHistory:
    """Keeps watch while it is open."""

    def __init__(self, options: MonitorOptions) -> None:
        self.where = options.where
        self._options = options
        self._lock, self._stop = Lock(), Event()
        self._now: tuple[Now, ...] = ()
        self._thread = Thread(target=self._watch, name="live book", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join(3.0)

    def now(self) -> tuple[Now, ...]:
        """All boats, by name."""
        with self._lock:
            return self._now

    def _watch(self) -> None:
        histories: dict[str, Pages] = defaultdict(Pages)
        with ExitStack() as scope:
            eyes = BusWatcher(self._options, scope)
            while not self._stop.wait(PERIOD_S):
                try:
                    pictures = eyes.statuses()
                except ShadowError:
                    continue
                for picture in pictures:
                    histories[picture.name].take(picture)
                now = tuple(_now(p, histories[p.name]) for p in pictures)
                with self._lock:
                    self._now = now


def _now(picture: VesselStatus, history: Pages) -> Now:
    tracks = {
        topic: ([e for e, _ in points], [n for _, n in points])
        for topic, points in history.tracks.items()
    }
    rows = {topic: np.array(rows) for topic, rows in history.rows.items() if rows}
    return Now(picture.name, picture.alive, picture.events, picture, tracks, rows)
