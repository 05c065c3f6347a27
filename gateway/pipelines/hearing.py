"""What a boat says on a live link → facts for the path, one message at a time.

The same table of messages, the same clock and the same order of sources as for a log, without
looking ahead: a source counts while no better one was heard for a moment.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from gateway.estimation.events import KIND_OF, Events
from gateway.estimation.names import Kind
from gateway.estimation.settings import FilterSettings
from gateway.ingest.boats import Boat
from gateway.ingest.clock_step import S
from gateway.ingest.earth import Origin
from gateway.ingest.live import BoatDecoder
from gateway.ingest.mapping.actuators import CHANNELS, merged
from gateway.ingest.sources import PRIORITY
from gateway.pipelines.feed import Feed
from gateway.pipelines.whereabouts import Whereabouts
from gateway.samples import Measurement, Quantity
from sim.state import Floats, Ints

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


class Hearing:
    """Holds what the boat said last; turns each message into a `Feed`."""

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
        self._white: dict[tuple[Kind, str], float] = {}

    @property
    def reboots(self) -> int:
        """How often the autopilot booted again."""
        return int(self.decoder.clock.state[S.REBOOTS])

    @property
    def origin(self) -> Origin | None:
        """Where the metres count from, once that is known."""
        return self._whereabouts.origin

    def take(self, message: Any, receive_time_ns: int) -> Feed | None:
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

    def tick(self, moment_ns: int, vehicle_time_ns: int) -> Feed:
        """A moment without any fact, on the receiver's and the boat's clock."""
        epoch = vehicle_time_ns if self._epoch_ns is None else self._epoch_ns
        time = np.array([(vehicle_time_ns - epoch) * 1e-9])
        events = Events(time, np.array([int(Kind.TICK)]), np.zeros((1, 2)), np.ones((1, 2)))
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
        found = RANK.get((m.quantity, m.source.partition("/")[0]))
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
                pulses = merged(self._around.pulses, m.source, m.values)
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

    def _feed(self, facts: list[Measurement]) -> Feed:
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

    def _white_std(self, kind: Kind, source: str) -> float:
        key = kind, source
        if key not in self._white:
            self._white[key] = self.settings.white_std(kind, source)
        return self._white[key]

    def _with(self, events: Events, vehicle: Ints, receive: Ints) -> Feed:
        """Facts of one message (K,) with what holds now."""
        count, now = len(events), self._around
        complete = np.zeros(count, np.bool_)
        complete[-1] = True
        pulses, wind = np.empty((count, CHANNELS)), np.empty((count, 2))
        pulses[:] = now.pulses if now.armed else NOTHING
        wind[:] = now.wind
        return Feed(
            events,
            np.full(count, self._order, np.int64),
            complete,
            vehicle,
            receive,
            pulses,
            np.full(count, now.voltage),
            wind,
        )
