"""Messages of a live link -> inputs of the shadow path, one message at a time. Pure.

The same table of messages, the same clock and the same order of sources as for a log, without
looking ahead: a source counts while no better one was received for a moment.

The origin of the local frame is what the autopilot states; else a local and a global position of
the same moment give it. One such pair may be wrong, so two in a row have to agree; the same two
move an origin that was wrong. After a reboot the frame lies elsewhere. A boat that gives degrees
alone has its first position as origin, for good.
"""

from collections.abc import Mapping
from math import isnan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.estimation import FilterSettings, MeasurementKind
from gateway.estimation.events import KIND_OF, Events
from gateway.estimation.gyro_delay import tells_delay
from gateway.ingest.clock import BoatClock, StampStatus
from gateway.ingest.log import Boat
from gateway.ingest.mapping import (
    Origin,
    Rule,
    counter_us,
    distance_m,
    in_local_frame,
    instance_of,
    merge_pulses,
    of_a_battery,
    of_the_air,
    on_earth,
    to_degrees,
    to_local,
)
from gateway.ingest.mavlink.mapping import BY_SOURCE, rules_of
from gateway.ingest.mavlink.mapping import RULES as MAVLINK
from gateway.ingest.sources import PRIORITY
from gateway.samples import CHANNELS, Measurement, Quantity
from gateway.shadow import MOTION, NEVER, FilterInputs, PulseTable
from sim.state import Floats, Ints

# Chosen, not measured.
BETTER_SOURCE_NS = 2_000_000_000  # a better source that was silent for so long is given up
SAME_MOMENT_NS = 200_000_000  # local and global position further apart are not of one moment
AGREE_M = 10.0  # a GNSS receiver's own position lags and errs by metres

STREAM = {rule.source: number for number, rule in enumerate(MAVLINK)}
RANK: Mapping[tuple[Quantity, str], tuple[str, int]] = {
    (quantity, source): (name, rank)
    for name, candidates in PRIORITY.items()
    for rank, (quantity, source) in enumerate(candidates)
}
NO_PULSES = np.full(CHANNELS, np.nan)
MOVES = frozenset(KIND_OF)  # quantities of which nothing is held


class BoatDecoder:
    """Turns the messages of one boat into measurements; holds that boat's clock."""

    def __init__(self, boat: Boat) -> None:
        self.boat = boat
        self.clock = BoatClock(len(MAVLINK))
        rules = rules_of(boat)
        self._rules = {
            name: tuple(rule for rule in rules if rule.message == name)
            for name in {rule.message for rule in rules}
        }

    def measurements(self, message: Any, receive_time_ns: int) -> tuple[Measurement, ...]:
        """A pymavlink message of this boat and its receipt -> measurements, none if repeated."""
        found: list[Measurement] = []
        for rule in self._rules.get(message.get_type(), ()):
            if not rule.instance or instance_of(message, rule, rule.number) == rule.number:
                found += self._by_rule(message, rule, receive_time_ns)
        return tuple(found)

    def _by_rule(self, message: Any, rule: Rule, receive: int) -> list[Measurement]:
        vehicle, status = self.clock.stamp(
            STREAM[rule.source], rule.counter, counter_us(message, rule), receive
        )
        if status in (StampStatus.DUPLICATE, StampStatus.UNPLACED):
            return []
        facts = [(q, tuple(map(float, values))) for q, values in rule.facts(message)]
        return [
            Measurement(quantity, rule.source, vehicle, receive, values)
            for quantity, values in facts
            if quantity is Quantity.ACTUATORS or True not in map(isnan, values)
        ]


class OriginEstimate(NamedTuple):
    """The origin of the local frame, as far as it is known."""

    origin: Origin | None = None
    fixed: bool = False  # metres were made with it: it cannot change any more
    candidate: Origin | None = None  # from the last pair
    local: Measurement | None = None
    place: Measurement | None = None

    def update(self, m: Measurement) -> "OriginEstimate":
        """A measurement of any kind; only positions and origins change anything."""
        match m.quantity:
            case Quantity.ORIGIN if not self.fixed and on_earth(*m.values):
                return self._replace(origin=Origin(*m.values))
            case Quantity.GLOBAL_POSITION if on_earth(*m.values):
                return self._replace(place=m)._paired()
            case Quantity.POSITION if in_local_frame(*m.values):
                return self._replace(local=m)._paired()
        return self

    def rebooted(self) -> "OriginEstimate":
        """The autopilot's local frame starts elsewhere now."""
        return self if self.fixed else OriginEstimate()

    def in_metres(self, m: Measurement) -> tuple["OriginEstimate", Measurement | None]:
        """A position in degrees as metres from the origin, which is its first one if need be."""
        if not on_earth(*m.values):
            return self, None
        after = self._replace(origin=self.origin or Origin(*m.values), fixed=True)
        assert after.origin is not None
        north, east = to_local(np.array(m.values), after.origin).tolist()
        local = Measurement(
            Quantity.POSITION, m.source, m.vehicle_time_ns, m.receive_time_ns, (north, east)
        )
        return after, local

    def _paired(self) -> "OriginEstimate":
        """Use a position that came together with the latest of the other kind."""
        place, local = self.place, self.local
        if self.fixed or place is None or local is None:
            return self
        if abs(place.vehicle_time_ns - local.vehicle_time_ns) >= SAME_MOMENT_NS:
            return self
        found = to_degrees(-np.array(local.values), Origin(*place.values))
        if not on_earth(*found):
            return self
        candidate, before = Origin(*found.tolist()), self.candidate
        after = self._replace(candidate=candidate, place=None)  # a pair counts once
        if self.origin is not None and distance_m(self.origin, candidate) < AGREE_M:
            return after
        if before is None or distance_m(before, candidate) >= AGREE_M:
            return after
        return after._replace(origin=candidate)


class HeldValues(NamedTuple):
    """What holds until the next message."""

    pulses: Floats = NO_PULSES  # (32,) µs
    heard: float = NEVER  # receipt of the last message that told of some [s]
    armed: bool = True
    voltage: float = np.nan
    wind: tuple[float, ...] = (np.nan, np.nan)
    gps_fix: float = np.nan
    estimator: float = np.nan  # bits of `EstimatorFault`


class MessagePlan(NamedTuple):
    """What is the same in all messages that give measurements of the same kinds, K of them: one is
    made for all, since each array takes as long as a step of the filter.
    """

    kinds: Ints  # (K,)
    std: Floats  # (K, 2)
    complete: NDArray[np.bool_]  # (K,)
    pulse_row: Ints  # (K,)


class HeldColumns(NamedTuple):
    """What holds until the next message, for messages of K measurements."""

    voltage: Floats  # (K,)
    wind: Floats  # (K, 2)
    gps_fix: Floats  # (K,)
    estimator: Floats  # (K,)

    @classmethod
    def of(cls, now: HeldValues, count: int) -> "HeldColumns":
        """The same in each of so many rows."""
        wind = np.full((count, 2), now.wind)
        one = (np.full(count, value) for value in (now.voltage, now.gps_fix, now.estimator))
        voltage, gps_fix, estimator = one
        return cls(voltage, wind, gps_fix, estimator)


class MessageIntake:
    """Turns each message of a boat into `FilterInputs`; remembers the values that hold."""

    def __init__(self, boat: Boat, settings: FilterSettings) -> None:
        self.decoder = BoatDecoder(boat)
        self.settings = settings
        self.parameters: dict[str, float] = {}  # those that the filter uses
        self._first_ns: int | None = None  # receipt of the first message
        self._epoch_ns: int | None = None  # vehicle time of the first measurement of motion
        self._received: dict[str, dict[int, int]] = {}  # quantity -> rank of source -> last receipt
        self._order = 0  # of the message
        self._held = HeldValues()
        self._fixes: dict[str, float] = {}  # the latest of each receiver
        self._pulses: PulseTable | None = None  # of what is held, made when it is asked for
        self._origin = OriginEstimate()
        self._plans: dict[tuple[tuple[Quantity, str], ...], MessagePlan] = {}
        self._columns: dict[int, HeldColumns] = {}  # by count of measurements

    @property
    def reboots(self) -> int:
        """How often the autopilot booted again."""
        return self.decoder.clock.reboots

    @property
    def origin(self) -> Origin | None:
        """The place that the metres count from, once that is known."""
        return self._origin.origin

    def take(self, message: Any, receive_time_ns: int) -> FilterInputs | None:
        """A message, received then -> its measurements of motion; None where it has none."""
        if self._first_ns is None:
            self._first_ns = receive_time_ns
        self._order += 1
        reboots = self.reboots
        if message.get_type() == "PARAM_VALUE":
            self._note_parameter(message)
        motion = [
            m
            for measurement in self.decoder.measurements(message, receive_time_ns)
            if (m := self._use(measurement)) is not None
        ]
        if self.reboots > reboots:
            self._origin = self._origin.rebooted()
        # of the measurements in one message, yaw stands before what depends on it
        motion.sort(key=lambda m: KIND_OF[m.quantity])
        return self._inputs(motion) if motion else None

    def tick(self, moment_ns: int, vehicle_time_ns: int) -> FilterInputs:
        """A moment without any measurement, on the receiver's and the boat's clock."""
        epoch = vehicle_time_ns if self._epoch_ns is None else self._epoch_ns
        time = np.array([(vehicle_time_ns - epoch) * 1e-9])
        kinds = np.array([int(MeasurementKind.TICK)])
        plan = MessagePlan(kinds, np.ones((1, 2)), np.ones(1, np.bool_), np.zeros(1, np.int64))
        events = Events(time, kinds, np.zeros((1, 2)), plan.std)
        return self._with_held(events, plan, np.array([vehicle_time_ns]), np.array([moment_ns]))

    def _use(self, m: Measurement) -> Measurement | None:
        """A measurement of motion for the filter; of anything else the value is remembered."""
        if m.quantity is Quantity.FIX:  # of several receivers none is better: the best fix counts
            self._hold(m)
            return None
        name = self._quantity_it_gives(m)
        if name in MOTION and m.quantity is Quantity.GLOBAL_POSITION:
            self._origin, local = self._origin.in_metres(m)
            return local
        if name is not None or m.quantity is Quantity.GLOBAL_POSITION:
            self._origin = self._origin.update(m)
        if name is not None:
            self._hold(m)
        return m if name in MOTION else None

    def _quantity_it_gives(self, m: Measurement) -> str | None:
        """The quantity that it is the best source of at the moment; None where there is a better.

        The ports of one message report different channels: none is better.
        """
        ranked = RANK.get((m.quantity, BY_SOURCE[m.source].equivalent))
        if ranked is None:
            return None
        (name, rank), now = ranked, m.receive_time_ns
        received = self._received.setdefault(name, {})
        received[rank] = now
        assert self._first_ns is not None
        # a clock that was set back makes times to come of those before
        if rank > 0 and 0 <= now - self._first_ns < BETTER_SOURCE_NS and name in MOTION:
            return None  # a better one may yet come
        for other, at in received.items():
            if other < rank and 0 <= now - at <= BETTER_SOURCE_NS:
                return None
        return name

    def _hold(self, m: Measurement) -> None:
        """The value that holds from now on."""
        if m.quantity in (Quantity.ACTUATORS, Quantity.ARMED):
            self._pulses = None
        elif m.quantity not in MOVES:
            self._columns = {}
        match m.quantity:
            case Quantity.ACTUATORS:
                pulses = merge_pulses(self._held.pulses, BY_SOURCE[m.source].channels, m.values)
                self._held = self._held._replace(pulses=pulses, heard=m.receive_time_ns * 1e-9)
            case Quantity.VOLTAGE if of_a_battery(*m.values):
                self._held = self._held._replace(voltage=m.values[0])
            case Quantity.WIND if of_the_air(*m.values):
                self._held = self._held._replace(wind=m.values)
            case Quantity.FIX:
                self._fixes[m.source] = m.values[0]
                self._held = self._held._replace(gps_fix=max(self._fixes.values()))
            case Quantity.ESTIMATOR:
                self._held = self._held._replace(estimator=m.values[0])
            case Quantity.ARMED:
                self._held = self._held._replace(armed=m.values[0] != 0.0)

    def _note_parameter(self, message: Any) -> None:
        """A parameter came: this program asks for some (not on a silent link), as others may."""
        told = {message.param_id: float(message.param_value)}
        if tells_delay(told):
            self.parameters = told

    def _inputs(self, motion: list[Measurement]) -> FilterInputs:
        """The measurements of one message as inputs."""
        epoch = self._epoch_ns
        if epoch is None:
            epoch = self._epoch_ns = motion[0].vehicle_time_ns
        key = tuple([(m.quantity, m.source) for m in motion])
        plan = self._plans.get(key)
        if plan is None:
            plan = self._plans[key] = self._plan(motion)
        z = np.array([m.values if len(m.values) == 2 else (m.values[0], 0.0) for m in motion])
        stamps = [m.vehicle_time_ns for m in motion]
        vehicle = np.array(stamps, np.int64)
        receive = np.array([m.receive_time_ns for m in motion], np.int64)
        time_s = np.array([(stamp - epoch) * 1e-9 for stamp in stamps])
        return self._with_held(Events(time_s, plan.kinds, z, plan.std), plan, vehicle, receive)

    def _plan(self, motion: list[Measurement]) -> MessagePlan:
        kinds = [KIND_OF[m.quantity] for m in motion]
        std = [
            [self.settings.white_std(kind, m.source)] * 2
            for kind, m in zip(kinds, motion, strict=True)
        ]
        complete = np.zeros(len(motion), np.bool_)
        complete[-1] = True
        pulse_row = np.zeros(len(motion), np.int64)
        return MessagePlan(np.array(kinds, np.int64), np.array(std), complete, pulse_row)

    def _with_held(
        self, events: Events, plan: MessagePlan, vehicle: Ints, receive: Ints
    ) -> FilterInputs:
        """Events of one message (K,) with the values that hold now."""
        count, now = len(vehicle), self._held
        held = self._columns.get(count)
        if held is None:
            held = self._columns[count] = HeldColumns.of(now, count)
        if self._pulses is None:
            pulses = (now.pulses if now.armed else NO_PULSES)[np.newaxis]
            self._pulses = PulseTable.of(pulses, np.array([now.heard if now.armed else np.nan]))
        order = np.array([self._order] * count, np.int64)
        return FilterInputs(
            events, order, plan.complete, vehicle, receive, plan.pulse_row, held.voltage,
            held.wind, held.gps_fix, held.estimator, self._pulses,
        )  # fmt: skip


def warm_up_messages(boot_ms: int) -> list[Any]:
    """Messages that take every compiled step once."""
    messages: list[Any] = [
        dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0),
        dialect.MAVLink_local_position_ned_message(boot_ms, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0),
        dialect.MAVLink_global_position_int_message(
            boot_ms, 600000000, 100000000, 0, 0, 10, 0, 0, 500
        ),
        dialect.MAVLink_servo_output_raw_message(boot_ms * 1000, 0, *([1500] * 8)),
        dialect.MAVLink_sys_status_message(0, 0, 0, 0, 14800, 0, 0, 0, 0, 0, 0, 0, 0),
    ]
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    return [mav.decode(bytearray(message.pack(mav))) for message in messages]
