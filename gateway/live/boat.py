"""One boat of a live link: its datagrams and ticks in, messages of every topic out.

Pure in its inputs: the same datagrams and ticks in the same order give the same messages. Nothing
here reads a clock.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

from gateway.estimation.filter import Estimator
from gateway.ingest.log import Boat
from gateway.json_rows import TopicRows
from gateway.live.intake import MessageIntake
from gateway.shadow.events import EventDetector, MissingForceRange
from gateway.shadow.health import SECOND, LiveHealth
from gateway.shadow.inputs import BLIND_S, SILENCE_S, TICK_S, FilterInputs
from gateway.shadow.model_monitor import ModelMonitor
from gateway.shadow.path import Freshness, ShadowPath, ShadowRows
from gateway.shadow.topic_rows import EventRow, event_rows, topic_rows

BLIND_NS, SILENCE_NS, TICK_NS = (round(s * SECOND) for s in (BLIND_S, SILENCE_S, TICK_S))


class BoatOutput(NamedTuple):
    """Messages that go out; with the last ones of an estimate, the path's rows behind them."""

    rows: list[TopicRows]
    out: ShadowRows | None = None


class NewestTimes(NamedTuple):
    """Receipt of the newest measurements, and the boat's newest time by then."""

    receive_time_ns: int
    vehicle_time_ns: int


class LiveBoat:
    """The shadow of one boat, fed by the loop."""

    def __init__(self, boat: Boat, name: str, path: ShadowPath) -> None:
        self.boat = boat
        self.name = name
        self.health = LiveHealth()
        self.reboots = 0  # of the autopilot
        self._path = path
        self._settings = path.estimator.settings
        self._state = path.start()
        self._event_detector = EventDetector()
        self._force_range = MissingForceRange.start()
        self._model_monitor = ModelMonitor.of(path.model)
        self._intake = MessageIntake(boat, self._settings)
        self._parameters = self._intake.parameters
        self._newest: NewestTimes | None = None
        self._ticked_ns = 0
        self._reported_s = 0
        self._resting = False  # silent for too long to run on

    def datagram(self, messages: Sequence[Any], receive_time_ns: int) -> Iterator[BoatOutput]:
        """The boat's messages of one datagram -> what goes out, as it is made.

        One after the other, so that it does not matter how a link packs them. The caller takes
        all of it: only then has the state moved on.
        """
        for m in messages:
            self.health.frame(receive_time_ns, m.get_type(), m.get_srcComponent(), m.get_seq())
            inputs = self._intake.take(m, receive_time_ns)
            self._apply_parameters()
            if self._intake.reboots > self.reboots:
                yield BoatOutput(self._restart(receive_time_ns))
            if inputs is not None:
                self._note_times(inputs, receive_time_ns)
                yield from self._advance(inputs, spend=True)

    def tick(self, now_ns: int) -> Iterator[BoatOutput]:
        """A moment without telemetry -> the shadow runs on, for a while.

        The filter only predicts: a link that stalled delivers what waited, and none of that may be
        too late because of moments at which nothing was received.
        """
        self._ticked_ns, measured = now_ns, self._state.filter
        inputs = self._intake.tick(now_ns, self._vehicle_time(now_ns))
        yield from self._advance(inputs, spend=False)
        self._state = replace(self._state, filter=measured)

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
        return [self.health.row(now_ns, backlog, drops), *self._rest(now_ns)]

    def event(self, kind: str, severity: str, text: str, now_ns: int) -> list[TopicRows]:
        """An event of the gateway's own, at a moment on the receiver's clock."""
        vehicle = self._vehicle_time(now_ns)
        return [event_rows([EventRow(vehicle, now_ns, kind, severity, text)])]

    @property
    def address(self) -> tuple[int, int]:
        """System and component id."""
        return self.boat.system, self.boat.component

    def _restart(self, now_ns: int) -> list[TopicRows]:
        """The autopilot's clock, numbers and local frame start anew, and so does the filter."""
        self.reboots = self._intake.reboots
        self.health.rebooted()
        filter_state = self._path.estimator.start()
        self._state = replace(self._state, filter=filter_state, freshness=Freshness(), jumped=True)
        return self.event("reboot", "warning", "the autopilot rebooted", now_ns)

    def _note_times(self, inputs: FilterInputs, receive_time_ns: int) -> None:
        """Measurements came: the silence is over."""
        newest = int(inputs.vehicle_time_ns.max())
        if self._newest is not None:
            newest = max(newest, self._newest.vehicle_time_ns)
        self._newest = NewestTimes(receive_time_ns, newest)
        self._ticked_ns, self._resting = 0, False

    def _advance(self, inputs: FilterInputs, spend: bool) -> Iterator[BoatOutput]:
        self._state, out, filtered = self._path.advance(self._state, inputs, spend)
        if len(out):
            for rows in topic_rows(out, self._intake.origin):
                yield BoatOutput([rows])
        receive, vehicle = int(inputs.receive_time_ns[-1]), int(inputs.vehicle_time_ns[-1])
        self.health.filtered(filtered, receive, vehicle)
        self._event_detector, events = self._event_detector.observe(inputs, filtered, out)
        self._force_range, range_events = self._force_range.observe(out)
        self._model_monitor, monitored, model_events = self._model_monitor.observe(out)
        events += [*range_events, *model_events]
        yield BoatOutput([*monitored, event_rows(events)] if events else monitored, out)

    def _apply_parameters(self) -> None:
        """Use what the autopilot's parameters say about the filter, from here on."""
        if self._intake.parameters != self._parameters:
            self._parameters = self._intake.parameters
            self._path = copy(self._path)  # it is shared with other boats
            self._path.estimator = Estimator(self._settings.with_parameters(self._parameters))

    def _vehicle_time(self, now_ns: int) -> int:
        """The boat's time at a moment on the receiver's clock, as far as that is known."""
        if self._newest is None:
            return now_ns
        return self._newest.vehicle_time_ns + now_ns - self._newest.receive_time_ns

    def _rest(self, now_ns: int) -> list[TopicRows]:
        """An event, once, when the silence has become too long to run on."""
        if self._newest is None or now_ns - self._newest.receive_time_ns <= BLIND_NS:
            return []
        if self._resting:
            return []
        self._resting = True
        text = f"nothing of the boat for {BLIND_S:.0f} s: the shadow stands still until it is back"
        return self.event("shadow_rests", "warning", text, now_ns)
