"""What a boat says on a live link → facts for the path, one datagram at a time.

The same table of messages, the same clock and the same order of sources as for a log, without
looking ahead: a source counts while no better one was heard for a moment.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from gateway.estimation.events import KIND_OF, Events
from gateway.estimation.names import Kind
from gateway.estimation.settings import FilterSettings
from gateway.ingest.boats import Boat
from gateway.ingest.earth import Origin, to_degrees, to_local
from gateway.ingest.live import BoatDecoder
from gateway.ingest.mapping.actuators import CHANNELS, merged
from gateway.ingest.sources import PRIORITY
from gateway.pipelines.feed import Feed
from gateway.samples import Measurement, Quantity

MOTION = ("yaw", "yaw rate", "velocity", "position")
PATIENCE_NS = 2_000_000_000  # a better source that was silent for so long is given up
RANK = {
    (quantity, source): (name, rank)
    for name, candidates in PRIORITY.items()
    for rank, (quantity, source) in enumerate(candidates)
}


class Hearing:
    """Holds what the boat said last; turns each datagram into a `Feed`."""

    def __init__(self, boat: Boat, settings: FilterSettings) -> None:
        self.decoder = BoatDecoder(boat)
        self.settings = settings
        self.origin: Origin | None = None
        self.first_ns: int | None = None  # receipt of the first message
        self.epoch_ns: int | None = None  # vehicle time of the first fact
        self.order = 0
        self._heard: dict[str, dict[int, int]] = {}  # quantity -> rank of source -> last receipt
        self._pulses = np.full(CHANNELS, np.nan)
        self._armed = 1.0
        self._voltage = np.nan
        self._wind = np.full(2, np.nan)
        self._place: Measurement | None = None
        self._local: Measurement | None = None
        self._told_origin = False

    def take(self, messages: Iterable[Any], receive_time_ns: int) -> Feed:
        """All messages of one datagram, received then -> their facts about motion."""
        rows: list[tuple[Measurement, bool]] = []
        if self.first_ns is None:
            self.first_ns = receive_time_ns
        for message in messages:
            facts = [
                fact
                for measurement in self.decoder.measurements(message, receive_time_ns)
                for fact in self._about_motion(measurement)
            ]
            # of the facts in one message, yaw stands before what depends on it
            facts.sort(key=lambda m: KIND_OF[m.quantity])
            rows += [(fact, k == len(facts) - 1) for k, fact in enumerate(facts)]
            self.order += 1
        return self._feed(rows)

    def tick(self, moment_ns: int, vehicle_time_ns: int) -> Feed:
        """A moment without any fact, on the receiver's and the boat's clock."""
        epoch = vehicle_time_ns if self.epoch_ns is None else self.epoch_ns
        time = np.array([(vehicle_time_ns - epoch) * 1e-9])
        events = Events(
            time, np.array([int(Kind.TICK)], np.int64), np.zeros((1, 2)), np.ones((1, 2))
        )
        return self._around(events, np.array([vehicle_time_ns]), np.array([moment_ns]), [True])

    def _about_motion(self, m: Measurement) -> list[Measurement]:
        """What the filter is told of a measurement; anything else is kept in mind."""
        name, rank = RANK.get((m.quantity, m.source), ("", 0))
        if m.quantity is Quantity.ACTUATORS:
            self._pulses = merged(self._pulses, m.source, m.values)
        if not name or not self._best(name, rank, m.receive_time_ns):
            self._note_place(m)
            return []
        match m.quantity:
            case Quantity.VOLTAGE:
                self._voltage = m.values[0]
            case Quantity.WIND:
                self._wind = np.array(m.values)
            case Quantity.ARMED:
                self._armed = m.values[0]
            case Quantity.ORIGIN:
                self.origin, self._told_origin = Origin(*m.values), True
        self._note_place(m)
        if name not in MOTION:
            return []
        local = self._in_metres(m)
        return [local] if local is not None and local.quantity in KIND_OF else []

    def _best(self, name: str, rank: int, now: int) -> bool:
        """Is this the best source of the quantity that speaks at the moment?"""
        heard = self._heard.setdefault(name, {})
        heard[rank] = now
        assert self.first_ns is not None
        if rank > 0 and now - self.first_ns < PATIENCE_NS and name in MOTION:
            return False  # a better one may yet speak up
        return all(now - at > PATIENCE_NS for better, at in heard.items() if better < rank)

    def _in_metres(self, m: Measurement) -> Measurement | None:
        """A position in degrees as metres from the origin, which is its first one if need be."""
        if m.quantity is not Quantity.GLOBAL_POSITION:
            return m
        if self.origin is None:
            self.origin = Origin(*m.values)
        north, east = to_local(np.array(m.values), self.origin).tolist()
        return Measurement(
            Quantity.POSITION, m.source, m.vehicle_time_ns, m.receive_time_ns, (north, east)
        )

    def _note_place(self, m: Measurement) -> None:
        """Local and global position of one moment tell the origin where nobody states it."""
        if m.quantity is Quantity.GLOBAL_POSITION:
            self._place = m
        elif m.quantity is Quantity.POSITION:
            self._local = m
        else:
            return
        if self.origin is not None or self._place is None or self._local is None:
            return
        if abs(self._place.vehicle_time_ns - self._local.vehicle_time_ns) < 200_000_000:
            here = Origin(*self._place.values)
            behind = to_degrees(-np.array(self._local.values), here)
            self.origin = Origin(*behind.tolist())

    def _feed(self, rows: list[tuple[Measurement, bool]]) -> Feed:
        facts = [fact for fact, _ in rows]
        if self.epoch_ns is None and facts:
            self.epoch_ns = facts[0].vehicle_time_ns
        vehicle = np.array([m.vehicle_time_ns for m in facts], np.int64)
        z, std = np.zeros((len(facts), 2)), np.ones((len(facts), 2))
        for k, m in enumerate(facts):
            z[k, : len(m.values)] = m.values[:2]
            std[k] = self.settings.white_std(KIND_OF[m.quantity], m.source)
        events = Events(
            np.asarray((vehicle - (self.epoch_ns or 0)) * 1e-9, np.float64),
            np.array([int(KIND_OF[m.quantity]) for m in facts], np.int64),
            z,
            std,
        )
        receive = np.array([m.receive_time_ns for m in facts], np.int64)
        return self._around(events, vehicle, receive, [last for _, last in rows])

    def _around(self, events: Events, vehicle: Any, receive: Any, complete: list[bool]) -> Feed:
        """Facts with what holds at the moment."""
        count = len(events)
        pulses = self._pulses if self._armed else np.full(CHANNELS, np.nan)
        return Feed(
            events,
            np.full(count, self.order, np.int64),
            np.array(complete, dtype=bool),
            vehicle,
            receive,
            np.tile(pulses, (count, 1)),
            np.full(count, self._voltage),
            np.tile(self._wind, (count, 1)),
        )
