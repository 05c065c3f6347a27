"""One boat of a live link: its datagrams and ticks in, messages of every topic out.

Pure in its inputs: the same datagrams and ticks in the same order give the same messages. Nothing
here reads a clock.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from gateway.estimation.filter import Estimator
from gateway.ingest.log import Boat
from gateway.json_rows import TopicRows, encode
from gateway.live.intake import MessageIntake
from gateway.shadow.events import EventDetector, UsualRange
from gateway.shadow.health import SECOND, LiveHealth
from gateway.shadow.inputs import BLIND_S, SILENCE_S, TICK_S, FilterInputs
from gateway.shadow.model_monitor import ModelMonitor
from gateway.shadow.path import NOTHING, Shadowing, ShadowPath
from gateway.shadow.topic_rows import Happening, event_rows, topic_rows

BLIND_NS, SILENCE_NS, TICK_NS = (round(s * SECOND) for s in (BLIND_S, SILENCE_S, TICK_S))


class Spoken(NamedTuple):
    """Messages that go out; with the last of an estimate, the rows of the path behind them."""

    rows: list[TopicRows]
    out: Shadowing | None = None


class Newest(NamedTuple):
    """The newest fact: receipt, and the boat's newest time by then."""

    receive_time_ns: int
    vehicle_time_ns: int


class LiveBoat:
    """The shadow of one boat, fed by the loop."""

    def __init__(self, boat: Boat, name: str, path: ShadowPath) -> None:
        self.boat = boat
        self.name = name
        self.health = LiveHealth()
        self._path = path
        self._settings = path.estimator.settings
        self._state = path.start()
        self._watchman = EventDetector()
        self._usual = UsualRange.start()
        self._lookout = ModelMonitor.of(path.model)
        self._hearing = MessageIntake(boat, self._settings)
        self._parameters = self._hearing.parameters
        self._newest: Newest | None = None
        self._ticked_ns = 0
        self._reported_s = 0
        self.reboots = 0  # of the autopilot
        self._resting = False

    def datagram(self, messages: Sequence[Any], receive_time_ns: int) -> Iterator[Spoken]:
        """The boat's messages of one datagram -> what goes out, as it is made.

        One after the other, so that it does not matter how a link packs them. Whoever asks takes
        all of it: the state has moved on only then.
        """
        for m in messages:
            self.health.frame(receive_time_ns, m.get_type(), m.get_srcComponent(), m.get_seq())
            feed = self._hearing.take(m, receive_time_ns)
            self._learn()
            if self._hearing.reboots > self.reboots:
                yield Spoken(self._rebooted(receive_time_ns))
            if feed is not None:
                self._note(feed, receive_time_ns)
                yield from self._advance(feed, spend=True)

    def tick(self, now_ns: int) -> Iterator[Spoken]:
        """Time goes by without a word from the boat -> the shadow runs on, for a while.

        The filter only looks ahead: a link that stalled delivers what waited, and none of that
        may be too late because of moments at which nothing was heard.
        """
        self._ticked_ns, heard = now_ns, self._state.filter
        moment = self._hearing.tick(now_ns, self._vehicle_time(now_ns))
        yield from self._advance(moment, spend=False)
        self._state = replace(self._state, filter=heard)

    def wants_tick(self, now_ns: int) -> bool:
        """Is it time for the next tick?"""
        if self._newest is None:
            return False
        silent = now_ns - self._newest.receive_time_ns
        return SILENCE_NS <= silent <= BLIND_NS and now_ns - self._ticked_ns >= TICK_NS

    def status(self, now_ns: int, backlog: int, drops: int) -> list[TopicRows]:
        """The health topic, once a second."""
        second = now_ns // SECOND
        if 0 <= self._reported_s - second <= 1:  # receipts of two links may change places
            return []
        self._reported_s = second
        row = self.health.row(now_ns, backlog, drops)
        payload = encode("health", row)
        assert payload is not None
        times = np.array([row["vehicle_time_ns"]], np.int64), np.array([now_ns], np.int64)
        return [TopicRows("health", *times, [payload]), *self._rest(now_ns)]

    def say(self, kind: str, severity: str, says: str, now_ns: int) -> list[TopicRows]:
        """An event of the gateway's own, at a moment on the receiver's clock."""
        vehicle = self._vehicle_time(now_ns)
        return [event_rows([Happening(vehicle, now_ns, kind, severity, says)])]

    @property
    def address(self) -> tuple[int, int]:
        """System and component id."""
        return self.boat.system, self.boat.component

    def _rebooted(self, now_ns: int) -> list[TopicRows]:
        """Its clock, its frame numbers and its local frame start anew, and so does the filter."""
        self.reboots = self._hearing.reboots
        self.health.rebooted()
        fresh = self._path.estimator.start()
        self._state = replace(self._state, filter=fresh, news=NOTHING, jumped=True)
        return self.say("reboot", "warning", "the autopilot rebooted", now_ns)

    def _note(self, feed: FilterInputs, receive_time_ns: int) -> None:
        """Facts came: no silence any more."""
        newest = int(feed.vehicle_time_ns.max())
        if self._newest is not None:
            newest = max(newest, self._newest.vehicle_time_ns)
        self._newest = Newest(receive_time_ns, newest)
        self._ticked_ns, self._resting = 0, False

    def _advance(self, feed: FilterInputs, spend: bool) -> Iterator[Spoken]:
        self._state, out, filtered = self._path.advance(self._state, feed, spend)
        if len(out):
            for rows in topic_rows(out, self._hearing.origin):
                yield Spoken([rows])
        self.health.filtered(filtered, int(feed.receive_time_ns[-1]), int(feed.vehicle_time_ns[-1]))
        self._watchman, happened = self._watchman.observe(feed, filtered, out)
        self._usual, unusual = self._usual.observe(out)
        self._lookout, around, odd = self._lookout.observe(out)
        events = [*happened, *unusual, *odd]
        yield Spoken([*around, event_rows(events)] if events else around, out)

    def _learn(self) -> None:
        """What the autopilot's parameters tell the filter, from here on."""
        if self._hearing.parameters != self._parameters:
            self._parameters = self._hearing.parameters
            self._path = copy(self._path)  # it is shared with other boats
            self._path.estimator = Estimator(self._settings.with_parameters(self._parameters))

    def _vehicle_time(self, now_ns: int) -> int:
        """The boat's time at a moment on the receiver's clock, as far as that is known."""
        if self._newest is None:
            return now_ns
        return self._newest.vehicle_time_ns + now_ns - self._newest.receive_time_ns

    def _rest(self, now_ns: int) -> list[TopicRows]:
        """Said once when the silence has become too long to run on."""
        if self._newest is None or now_ns - self._newest.receive_time_ns <= BLIND_NS:
            return []
        if self._resting:
            return []
        self._resting = True
        says = f"nothing of the boat for {BLIND_S:.0f} s: the shadow stands still until it is back"
        return self.say("shadow_rests", "warning", says, now_ns)
