"""One message of a live link -> measurements, by the same table and clock as a log's columns.

Where on Earth the metres of a live boat count from, as that becomes known. Pure.

An autopilot may state the origin of its local frame; else a local and a global position of the
same moment tell it. One such pair may be wrong, so two in a row have to agree; the same two move
an origin that was wrong. After a reboot the frame lies elsewhere. A boat that gives degrees alone
has its first position as origin, for good.

What a boat says on a live link → facts for the path, one message at a time.

The same table of messages, the same clock and the same order of sources as for a log, without
looking ahead: a source counts while no better one was heard for a moment.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from gateway.estimation.events import KIND_OF, Events
from gateway.estimation.names import MeasurementKind
from gateway.estimation.settings import FilterSettings
from gateway.ingest.clock import BoatClock
from gateway.ingest.clock_step import StampStatus
from gateway.ingest.earth import Origin, to_degrees, to_local
from gateway.ingest.log import Boat
from gateway.ingest.mapping import Rule, counter_us, instance_of, merge_pulses
from gateway.ingest.mavlink.mapping import BY_SOURCE
from gateway.ingest.mavlink.mapping import RULES as MAVLINK
from gateway.ingest.sources import PRIORITY
from gateway.samples import CHANNELS, Measurement, Quantity
from gateway.shadow.inputs import FilterInputs
from sim.state import Floats, Ints

STREAM = {rule.source: number for number, rule in enumerate(MAVLINK)}
RULES = {
    name: tuple(rule for rule in MAVLINK if rule.message == name)
    for name in {rule.message for rule in MAVLINK}
}


class BoatDecoder:
    """Turns the messages of one boat into measurements; holds that boat's clock."""

    def __init__(self, boat: Boat) -> None:
        self.boat = boat
        self.clock = BoatClock(len(MAVLINK))

    def measurements(self, message: Any, receive_time_ns: int) -> tuple[Measurement, ...]:
        """A pymavlink message of this boat and its receipt -> its facts; none from a duplicate."""
        found: list[Measurement] = []
        for rule in RULES.get(message.get_type(), ()):
            if instance_of(message, rule, rule.number) == rule.number:
                found += self._facts(message, rule, receive_time_ns)
        return tuple(found)

    def _facts(self, message: Any, rule: Rule, receive: int) -> list[Measurement]:
        vehicle, status = self.clock.stamp(
            STREAM[rule.source], rule.counter, counter_us(message, rule), receive
        )
        if status in (StampStatus.DUPLICATE, StampStatus.UNPLACED):
            return []
        facts = [(q, tuple(float(value) for value in values)) for q, values in rule.facts(message)]
        return [
            Measurement(quantity, rule.source, vehicle, receive, values)
            for quantity, values in facts
            if quantity is Quantity.ACTUATORS or all(value == value for value in values)
        ]


TOGETHER_NS = 200_000_000  # local and global position further apart are not of one moment
AGREE_M = 10.0  # a GNSS receiver's own position lags and errs by metres
FAR_M = 1e6  # no local frame reaches further


def on_earth(latitude_deg: float, longitude_deg: float) -> bool:
    """Is there such a place?"""
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0


def distance_m(one: Origin, other: Origin) -> float:
    """Between two places."""
    return float(np.hypot(*to_local(np.array(one), other)))


@dataclass(frozen=True)
class Whereabouts:
    """What is known so far."""

    origin: Origin | None = None
    fixed: bool = False  # metres were made with it: it cannot change any more
    guess: Origin | None = None  # what the last pair told
    local: Measurement | None = None
    place: Measurement | None = None

    def heard(self, m: Measurement) -> "Whereabouts":
        """A fact of any kind; only positions and origins mean something here."""
        match m.quantity:
            case Quantity.ORIGIN if not self.fixed and on_earth(*m.values):
                return replace(self, origin=Origin(*m.values))
            case Quantity.GLOBAL_POSITION if on_earth(*m.values):
                return replace(self, place=m)._paired()
            case Quantity.POSITION if max(map(abs, m.values)) < FAR_M:
                return replace(self, local=m)._paired()
        return self

    def rebooted(self) -> "Whereabouts":
        """The autopilot counts its metres from somewhere else now."""
        return self if self.fixed else Whereabouts()

    def in_metres(self, m: Measurement) -> tuple["Whereabouts", Measurement | None]:
        """A position in degrees as metres from the origin, which is its first one if need be."""
        if not on_earth(*m.values):
            return self, None
        after = replace(self, origin=self.origin or Origin(*m.values), fixed=True)
        assert after.origin is not None
        north, east = to_local(np.array(m.values), after.origin).tolist()
        local = Measurement(
            Quantity.POSITION, m.source, m.vehicle_time_ns, m.receive_time_ns, (north, east)
        )
        return after, local

    def _paired(self) -> "Whereabouts":
        """A position came: does it tell the origin together with the latest of the other kind?"""
        place, local = self.place, self.local
        if self.fixed or place is None or local is None:
            return self
        if abs(place.vehicle_time_ns - local.vehicle_time_ns) >= TOGETHER_NS:
            return self
        behind = to_degrees(-np.array(local.values), Origin(*place.values))
        if not on_earth(*behind):
            return self
        guess, before = Origin(*behind.tolist()), self.guess
        after = replace(self, guess=guess, place=None)  # a pair tells once
        if self.origin is not None and distance_m(self.origin, guess) < AGREE_M:
            return after
        if before is None or distance_m(before, guess) >= AGREE_M:
            return after
        return replace(after, origin=guess)


MOTION = ("yaw", "yaw rate", "velocity", "position")
PATIENCE_NS = 2_000_000_000  # a better source that was silent for so long is given up
RANK: Mapping[tuple[Quantity, str], tuple[str, int]] = {
    (quantity, source): (name, rank)
    for name, candidates in PRIORITY.items()
    for rank, (quantity, source) in enumerate(candidates)
}
HIGHEST_V, FASTEST_WIND_MPS = 1000.0, 100.0  # beyond these it is a damaged field that speaks
GYRO_FILTER, GYRO_FILTER_HZ = "INS_GYRO_FILTER", (0.5, 500.0)  # 0 stands for none


NOTHING = np.full(CHANNELS, np.nan)


class Around(NamedTuple):
    """What holds at a moment."""

    pulses: Floats = NOTHING  # (32,) µs
    armed: bool = True
    voltage: float = np.nan
    wind: tuple[float, ...] = (np.nan, np.nan)


class MessageIntake:
    """Holds what the boat said last; turns each message into a `FilterInputs`."""

    def __init__(self, boat: Boat, settings: FilterSettings) -> None:
        self.decoder = BoatDecoder(boat)
        self.settings = settings
        self.parameters: dict[str, float] = {}  # those that tell the filter something
        self._first_ns: int | None = None  # receipt of the first message
        self._epoch_ns: int | None = None  # vehicle time of the first fact
        self._heard: dict[str, dict[int, int]] = {}  # quantity -> rank of source -> last receipt
        self._order = 0  # of the message
        self._around = Around()
        self._whereabouts = Whereabouts()
        self._white: dict[tuple[MeasurementKind, str], float] = {}

    @property
    def reboots(self) -> int:
        """How often the autopilot booted again."""
        return self.decoder.clock.reboots

    @property
    def origin(self) -> Origin | None:
        """Where the metres count from, once that is known."""
        return self._whereabouts.origin

    def take(self, message: Any, receive_time_ns: int) -> FilterInputs | None:
        """A message, received then -> its facts about motion; None where it has none."""
        if self._first_ns is None:
            self._first_ns = receive_time_ns
        self._order += 1
        reboots = self.reboots
        if message.get_type() == "PARAM_VALUE":
            self._note_parameter(message)
        facts = [
            fact
            for measurement in self.decoder.measurements(message, receive_time_ns)
            if (fact := self._about_motion(measurement)) is not None
        ]
        if self.reboots > reboots:
            self._whereabouts = self._whereabouts.rebooted()
        # of the facts in one message, yaw stands before what depends on it
        facts.sort(key=lambda m: KIND_OF[m.quantity])
        return self._feed(facts) if facts else None

    def tick(self, moment_ns: int, vehicle_time_ns: int) -> FilterInputs:
        """A moment without any fact, on the receiver's and the boat's clock."""
        epoch = vehicle_time_ns if self._epoch_ns is None else self._epoch_ns
        time = np.array([(vehicle_time_ns - epoch) * 1e-9])
        events = Events(
            time, np.array([int(MeasurementKind.TICK)]), np.zeros((1, 2)), np.ones((1, 2))
        )
        return self._with(events, np.array([vehicle_time_ns]), np.array([moment_ns]))

    def _about_motion(self, m: Measurement) -> Measurement | None:
        """What the filter is told of a measurement; anything else is kept in mind."""
        chosen = self._chosen(m)
        if chosen in MOTION and m.quantity is Quantity.GLOBAL_POSITION:
            self._whereabouts, local = self._whereabouts.in_metres(m)
            return local
        if chosen is not None or m.quantity is Quantity.GLOBAL_POSITION:
            self._whereabouts = self._whereabouts.heard(m)
        if chosen is not None:
            self._note(m)
        return m if chosen in MOTION else None

    def _chosen(self, m: Measurement) -> str | None:
        """What it tells, where it is the best source of that; else None."""
        # the ports of one message speak for different channels: none is better
        found = RANK.get((m.quantity, BY_SOURCE[m.source].equivalent))
        if found is None:
            return None
        name, rank = found
        return name if self._best(name, rank, m.receive_time_ns) else None

    def _best(self, name: str, rank: int, now: int) -> bool:
        """Is this the best source of the quantity that speaks at the moment?"""
        heard = self._heard.setdefault(name, {})
        heard[rank] = now
        assert self._first_ns is not None
        if rank > 0 and now - self._first_ns < PATIENCE_NS and name in MOTION:
            return False  # a better one may yet speak up
        return all(now - at > PATIENCE_NS for better, at in heard.items() if better < rank)

    def _note(self, m: Measurement) -> None:
        """What holds from now on."""
        match m.quantity:
            case Quantity.ACTUATORS:
                pulses = merge_pulses(self._around.pulses, BY_SOURCE[m.source].channels, m.values)
                self._around = self._around._replace(pulses=pulses)
            case Quantity.VOLTAGE if 0.0 < m.values[0] < HIGHEST_V:
                self._around = self._around._replace(voltage=m.values[0])
            case Quantity.WIND if max(map(abs, m.values)) < FASTEST_WIND_MPS:
                self._around = self._around._replace(wind=m.values)
            case Quantity.ARMED:
                self._around = self._around._replace(armed=m.values[0] != 0.0)

    def _note_parameter(self, message: Any) -> None:
        """The autopilot's parameters come when somebody else asks for them; we never do."""
        low, high = GYRO_FILTER_HZ
        value = float(message.param_value)
        if message.param_id == GYRO_FILTER and (value == 0.0 or low <= value <= high):
            self.parameters = {GYRO_FILTER: value}

    def _feed(self, facts: list[Measurement]) -> FilterInputs:
        """The facts of one message."""
        count = len(facts)
        if self._epoch_ns is None:
            self._epoch_ns = facts[0].vehicle_time_ns
        z, std = np.zeros((count, 2)), np.empty((count, 2))
        kinds = [KIND_OF[m.quantity] for m in facts]
        for k, m in enumerate(facts):
            z[k, : len(m.values)] = m.values
            std[k] = self._white_std(kinds[k], m.source)
        vehicle = np.array([m.vehicle_time_ns for m in facts], np.int64)
        receive = np.array([m.receive_time_ns for m in facts], np.int64)
        time_s = np.asarray((vehicle - self._epoch_ns) * 1e-9, np.float64)
        return self._with(Events(time_s, np.array(kinds, np.int64), z, std), vehicle, receive)

    def _white_std(self, kind: MeasurementKind, source: str) -> float:
        key = kind, source
        if key not in self._white:
            self._white[key] = self.settings.white_std(kind, source)
        return self._white[key]

    def _with(self, events: Events, vehicle: Ints, receive: Ints) -> FilterInputs:
        """Facts of one message (K,) with what holds now."""
        count, now = len(events), self._around
        complete = np.zeros(count, np.bool_)
        complete[-1] = True
        pulses, wind = np.empty((count, CHANNELS)), np.empty((count, 2))
        pulses[:] = now.pulses if now.armed else NOTHING
        wind[:] = now.wind
        return FilterInputs(
            events,
            np.full(count, self._order, np.int64),
            complete,
            vehicle,
            receive,
            pulses,
            np.full(count, now.voltage),
            wind,
        )
