"""One boat of a live link: its datagrams and ticks in, messages of every topic out.

Pure in its inputs: the same datagrams and ticks in the same order give the same messages. Nothing
here reads a clock.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gateway.ingest.boats import Boat
from gateway.messages import Rows, encode
from gateway.pipelines.feed import BLIND_S, SILENCE_S, TICK_S, Feed
from gateway.pipelines.happenings import Watchman
from gateway.pipelines.health import SECOND
from gateway.pipelines.hearing import Hearing
from gateway.pipelines.live_health import LiveHealth
from gateway.pipelines.path import Shadowing, ShadowPath
from gateway.pipelines.rows import Happening, event_rows, topic_rows
from gateway.pipelines.usual import UsualRange

BLIND_NS, SILENCE_NS, TICK_NS = (round(s * SECOND) for s in (BLIND_S, SILENCE_S, TICK_S))


class Spoken(NamedTuple):
    """Messages that go out, and the rows of the path that they were made from."""

    rows: list[Rows]
    out: Shadowing | None = None


class LiveBoat:
    """The shadow of one boat, fed by the loop."""

    def __init__(self, boat: Boat, name: str, path: ShadowPath) -> None:
        self.boat = boat
        self.name = name
        self.health = LiveHealth()
        self._path = path
        self._state = path.start()
        self._watchman = Watchman()
        self._usual = UsualRange.start()
        self._hearing = Hearing(boat, path.estimator.settings)
        self._last_fact: tuple[int, int] | None = None  # receive, vehicle time of the newest fact
        self._last_tick_ns = 0
        self._reported_s = 0
        self._reboots = 0

    def datagram(self, messages: Sequence[Any], receive_time_ns: int) -> Spoken:
        """The boat's messages of one datagram -> what goes out."""
        for m in messages:
            self.health.frame(receive_time_ns, m.get_type(), m.get_srcComponent(), m.get_seq())
        feed = self._hearing.take(messages, receive_time_ns)
        if len(feed):
            newest = int(feed.vehicle_time_ns.max())
            if self._last_fact is None or newest >= self._last_fact[1]:
                self._last_fact = receive_time_ns, newest
            else:
                self._last_fact = receive_time_ns, self._last_fact[1]
        return self._advance(feed)

    def tick(self, now_ns: int) -> Spoken:
        """Time goes by without a word from the boat -> the shadow runs on, for a while."""
        assert self._last_fact is not None
        silent = now_ns - self._last_fact[0]
        self._last_tick_ns = now_ns
        return self._advance(self._hearing.tick(now_ns, self._last_fact[1] + silent))

    def wants_tick(self, now_ns: int) -> bool:
        """Is it time for the next tick?"""
        if self._last_fact is None:
            return False
        silent = now_ns - self._last_fact[0]
        return SILENCE_NS <= silent <= BLIND_NS and now_ns - self._last_tick_ns >= TICK_NS

    def status(self, now_ns: int, backlog: int, drops: int) -> list[Rows]:
        """The health topic, once a second."""
        if now_ns // SECOND <= self._reported_s:
            return []
        self._reported_s = now_ns // SECOND
        row = self.health.row(now_ns, backlog, drops)
        payload = encode("health", row)
        assert payload is not None
        times = np.array([row["vehicle_time_ns"]], np.int64), np.array([now_ns], np.int64)
        return [Rows("health", *times, [payload])]

    def say(self, kind: str, severity: str, says: str, now_ns: int) -> list[Rows]:
        """An event of the gateway's own, at a moment on the receiver's clock."""
        vehicle = now_ns
        if self._last_fact is not None:
            vehicle = self._last_fact[1] + now_ns - self._last_fact[0]
        return [event_rows([Happening(vehicle, now_ns, kind, severity, says)])]

    @property
    def address(self) -> tuple[int, int]:
        """System and component id."""
        return self.boat.system, self.boat.component

    def rebooted(self) -> bool:
        """Did the autopilot boot again since this was last asked?"""
        reboots = self._hearing.decoder.clock.report().reboots
        new, self._reboots = reboots > self._reboots, reboots
        return new

    def _advance(self, feed: Feed) -> Spoken:
        if not len(feed):
            return Spoken([])
        self._state, out, filtered = self._path.advance(self._state, feed)
        self.health.filtered(filtered, int(feed.receive_time_ns[-1]), int(feed.vehicle_time_ns[-1]))
        self._watchman, happened = self._watchman.observe(feed, filtered, out)
        self._usual, unusual = self._usual.observe(out)
        rows = topic_rows(out, self._hearing.origin) if len(out) else []
        if happened or unusual:
            rows.append(event_rows([*happened, *unusual]))
        return Spoken(rows, out)
