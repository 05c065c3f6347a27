"""The boats of all links: datagrams and ticks in, messages of every topic out.

`Fleet` finds each boat by its autopilot's HEARTBEAT (a ground station is no boat) and gives it the
shadow of a vessel, a `LiveBoat`. Both are pure in their inputs: the same datagrams and ticks in the
same order give the same messages, and nothing here reads a clock.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from gateway.config import Settings
from gateway.estimation.filter import Estimator
from gateway.ingest.log import Boat
from gateway.ingest.mapping import Origin
from gateway.ingest.mavlink.mapping import from_heartbeat
from gateway.json_rows import TopicRows
from gateway.links import Datagram, Frame
from gateway.live.intake import MessageIntake, warm_up_messages
from gateway.recording.writer import warm_up
from gateway.shadow import BLIND_S, SILENCE_S, TICK_S, FilterInputs
from gateway.shadow.events import EventDetector, MissingForceRange
from gateway.shadow.health import SECOND, LiveHealth
from gateway.shadow.model_monitor import FIRST_S, Adapt, ModelMonitor, taken_over
from gateway.shadow.path import RowMemory, ShadowPath, ShadowRows
from gateway.shadow.sensor_checks import SensorMemory
from gateway.shadow.topic_rows import EventRow, event_rows, topic_rows
from gateway.topics import JUDGING, MODEL_RIGHT
from gateway.vessel_file import zenoh_key
from sim.plants import OWN_VESSEL, PlantChoice
from sim.vessel import Vessel

MAX_UNJUDGED = 25  # rows, half a second: whoever has no time for longer waits for them
BLIND_NS, SILENCE_NS, TICK_NS = (round(s * SECOND) for s in (BLIND_S, SILENCE_S, TICK_S))


# events that `shadow live` prints: what becomes of the boat's data and of its model
TOLD = JUDGING | {
    "started", "telemetry_silent", "telemetry_back", "sensor_failed", "sensor_restored",
    "residual_unusual", "residual_usual", "shadow_diverged", "shadow_steady", "shadow_reset",
    "parameter_changed", "parameter_usual", "parameter_inseparable",
}  # fmt: skip
# breaks of the estimate, printed too, but not all that one cause brings with it
BREAKS, QUIET_NS = frozenset({"jump", "restart"}), 10 * SECOND
NEVER_WRONG = "the model was not found wrong"
REBOOTED = "the autopilot rebooted: the estimate begins anew, and the shadow follows it again"


class BoatOutput(NamedTuple):
    """Messages that go out; with the last ones of an estimate, the path's rows behind them.

    events  those among the messages that a person at the terminal wants to read
    """

    rows: list[TopicRows]
    out: ShadowRows | None = None
    events: tuple[EventRow, ...] = ()


NOTHING = BoatOutput([])


class NewestTimes(NamedTuple):
    """Receipt of the newest measurements, and the boat's newest time by then."""

    receive_time_ns: int
    vehicle_time_ns: int


class Head(NamedTuple):
    """Who sent a frame of a message without a definition, and its number; asked as messages are."""

    system: int
    component: int
    sequence: int

    @classmethod
    def of(cls, raw: bytes) -> "Head":
        """Of the bytes of a frame; zeros where they are too few."""
        at = 4 if raw[:1] == b"\xfd" else 2
        sequence, system, component = raw[at : at + 3] if len(raw) > at + 2 else (0, 0, 0)
        return cls(system, component, sequence)

    def get_type(self) -> str:
        """Nobody knows its name."""
        return ""

    def get_srcSystem(self) -> int:
        """System id."""
        return self.system

    def get_srcComponent(self) -> int:
        """Component id."""
        return self.component


class LiveBoat:
    """The shadow of one boat, fed by the loop."""

    def __init__(self, boat: Boat, name: str, path: ShadowPath, adapt: Adapt = Adapt.OFF) -> None:
        self.boat = boat
        self.name = name
        self.health = LiveHealth()
        self.reboots = 0  # of the autopilot
        self.judged: EventRow | None = None  # what was last said of the model
        self._settings = path.estimator.settings
        self._state = path.start()
        self._event_detector = EventDetector.of(path.model.vessel)
        self._force_range = MissingForceRange.start(path.model.vessel)
        self._model_monitor = ModelMonitor.of(path.model, adapt is not Adapt.OFF)
        self._applies = adapt is Adapt.APPLY
        self._intake = MessageIntake(boat, self._settings)
        self._parameters = self._intake.parameters
        self._path = self._with_gyro_delay(path)
        self._newest: NewestTimes | None = None
        self._ticked_ns = 0
        self._reported_s = 0
        self._resting = False  # silent for too long to run on
        self.patient = False  # the caller calls `judge` when it has time
        self._unjudged: list[ShadowRows] = []
        self._break_ns: int | None = None  # receipt of the last break of the estimate that was told

    def datagram(self, messages: Sequence[Any], receive_time_ns: int) -> Iterator[BoatOutput]:
        """The boat's messages of one datagram, see `datagrams`."""
        return self.datagrams([(message, receive_time_ns) for message in messages])

    def datagrams(self, messages: Iterable[tuple[Any, int]]) -> Iterator[BoatOutput]:
        """The boat's messages that wait, each with its receipt -> what goes out, as it is made.

        Measurements of several messages move the shadow in one go, which gives the same as one
        after the other and takes a fraction of the time: a loop that falls behind catches up. The
        caller takes all of it: only then has the state moved on.
        """
        waiting, origin = list[FilterInputs](), self._intake.origin
        for m, receive_time_ns in messages:
            if isinstance(m, Head):
                self.health.unread(receive_time_ns, m.component, m.sequence)
                continue
            self.health.frame(receive_time_ns, m.get_type(), m.get_srcComponent(), m.get_seq())
            inputs = self._intake.take(m, receive_time_ns)
            rebooted = self._intake.reboots > self.reboots
            if waiting and (rebooted or self._changed(origin)):
                yield from self._advance(FilterInputs.joined(waiting), True, origin)
                waiting = []
            origin = self._intake.origin
            self._apply_parameters()
            if rebooted:
                yield self._restart(receive_time_ns)
            if inputs is not None:
                self._note_times(inputs, receive_time_ns)
                waiting.append(inputs)
                if self._applies:  # its numbers may change with each message
                    yield from self._advance(waiting.pop(), True, origin)
        if waiting:
            yield from self._advance(FilterInputs.joined(waiting), True, origin)

    def _changed(self, origin: Origin | None) -> bool:
        """Does the newest message change how those before it are to be taken?"""
        return self._intake.origin is not origin or self._intake.parameters != self._parameters

    def tick(self, now_ns: int) -> Iterator[BoatOutput]:
        """A moment without telemetry -> the shadow runs on, for a while.

        The filter only predicts: a link that stalled delivers what waited, and none of that may be
        too late because of moments at which nothing was received.
        """
        self._ticked_ns, measured = now_ns, self._state.filter
        inputs = self._intake.tick(now_ns, self._vehicle_time(now_ns))
        yield from self._advance(inputs, False, self._intake.origin)
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
    def verdict(self) -> EventRow | None:
        """What stands of the model: what was last said of it, or that nothing was; None where it
        was hardly judged.
        """
        if self.judged is not None or self._model_monitor.alarm.estimate.count < FIRST_S:
            return self.judged
        times = (0, 0) if self._newest is None else self._newest[::-1]
        return EventRow(*times, MODEL_RIGHT, "info", NEVER_WRONG)

    @property
    def address(self) -> tuple[int, int]:
        """System and component id."""
        return self.boat.system, self.boat.component

    def _restart(self, now_ns: int) -> BoatOutput:
        """The autopilot's clock, numbers and local frame start anew, and so does the filter."""
        self.reboots = self._intake.reboots
        self.health.rebooted()
        filter_state = self._path.estimator.start()
        self._state = replace(
            self._state,
            filter=filter_state,
            memory=RowMemory(published=self._state.memory.published, jumped=1.0),
            sensors=SensorMemory(),
        )
        self._break_ns = now_ns
        times = self._vehicle_time(now_ns), now_ns
        events = [EventRow(*times, "reboot", "warning", REBOOTED)]
        self._model_monitor, judged = self._model_monitor.rebooted(times)
        self.judged = judged[0] if judged else self.judged
        events += judged
        return BoatOutput([event_rows(events)], None, tuple(events))

    def _note_times(self, inputs: FilterInputs, receive_time_ns: int) -> None:
        """Measurements came: the silence is over."""
        newest = max(inputs.vehicle_time_ns.tolist())
        if self._newest is not None:
            newest = max(newest, self._newest.vehicle_time_ns)
        self._newest = NewestTimes(receive_time_ns, newest)
        self._ticked_ns, self._resting = 0, False

    def _advance(
        self, inputs: FilterInputs, spend: bool, origin: Origin | None
    ) -> Iterator[BoatOutput]:
        if self._applies:
            yield self.judge()  # whose numbers are to be taken over
            self._take_over(int(inputs.receive_time_ns[-1]))
        self._state, out, filtered = self._path.advance(self._state, inputs, spend)
        if len(out):  # the shadow first: it goes out while the others are being made
            topics = topic_rows(out, origin)
            yield BoatOutput([next(topics)])
            yield BoatOutput(list(topics))
        self.health.filtered(inputs, filtered, out)
        self._event_detector, events = self._event_detector.observe(inputs, filtered, out)
        self._force_range, range_events = self._force_range.observe(out)
        yield self._with_events([], [*events, *range_events], out)
        self._unjudged += [out] if len(out) else []
        if not self.patient or len(self._unjudged) > MAX_UNJUDGED:
            yield self.judge()

    def judge(self) -> BoatOutput:
        """Rows that went out since this was last called, held against the model.

        Once a second that takes as long as two datagrams; many boats may begin their seconds at
        one moment. So a caller with others that wait may do it a little later: nothing else
        depends on it, and what comes of it is the same.
        """
        rows, events = list[TopicRows](), list[EventRow]()
        if not self._unjudged:
            return NOTHING
        for out in self._unjudged:
            self._model_monitor, monitored, told = self._model_monitor.observe(out)
            rows, events = [*rows, *monitored], [*events, *told]
        self._unjudged = []
        return self._with_events(rows, events) if rows or events else NOTHING

    def _with_events(
        self, rows: list[TopicRows], events: Sequence[EventRow], out: ShadowRows | None = None
    ) -> BoatOutput:
        """Messages, and events as messages and for people."""
        if not events:
            return BoatOutput(rows, out)
        for event in events:
            self.judged = event if event.kind in JUDGING else self.judged
        told = tuple(event for event in events if event.kind in TOLD or self._is_new_break(event))
        return BoatOutput([*rows, event_rows(events)], out, told)

    def _is_new_break(self, event: EventRow) -> bool:
        """Is it a break of the estimate, with none told shortly before?"""
        now, last = event.receive_time_ns, self._break_ns
        if event.kind not in BREAKS or (last is not None and 0 <= now - last < QUIET_NS):
            return False
        self._break_ns = now
        return True

    def _take_over(self, receive_time_ns: int) -> None:
        """The shadow's numbers follow the boat's, from here on."""
        self._model_monitor, self._path = taken_over(
            self._model_monitor, self._path, receive_time_ns
        )

    def _apply_parameters(self) -> None:
        """Use what the autopilot's parameters say about the filter, from here on."""
        if self._intake.parameters != self._parameters:
            self._parameters = self._intake.parameters
            self._path = self._with_gyro_delay(self._path)

    def _with_gyro_delay(self, path: ShadowPath) -> ShadowPath:
        """A path of this boat alone whose filter takes the delay of its gyro into account."""
        own = copy(path)  # it is shared with other boats
        known = self._settings.with_parameters(self._parameters, self.boat.autopilot)
        own.estimator = Estimator(known)
        return own

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


MAX_BOATS = 32  # invented system ids may not use up files and memory
MAX_LISTED = 8  # boats without a vessel that are named
MAX_OTHERS = 8  # systems that are no boat of ours (ground stations, …) whose frames are recorded


@dataclass(frozen=True)
class BoatPlan:
    """A vessel for one boat (by system id), or for the first that no other plan is for (None)."""

    vessel: Vessel
    plant: PlantChoice = OWN_VESSEL
    system: int | None = None
    name: str | None = None  # on zenoh; default: the vessel's own

    @property
    def key(self) -> str:
        """Name on zenoh and of the recording."""
        return self.name or zenoh_key(self.vessel)


class FleetOutput(NamedTuple):
    """What came of a datagram or tick for one boat."""

    boat: LiveBoat
    output: BoatOutput


class Fleet:
    """The shadows of all boats; `found` and `ignored` are called with each new boat."""

    def __init__(
        self,
        plans: Sequence[BoatPlan],
        settings: Settings,
        found: Callable[[LiveBoat, BoatPlan], None] = lambda boat, plan: None,
        ignored: Callable[[Boat], None] = lambda boat: None,
    ) -> None:
        self.boats: dict[int, LiveBoat] = {}
        self._ignored_systems: set[int] = set()  # that no plan is for
        self._taken: set[int] = set()  # plans for any boat that have found theirs
        self._others: set[int] = set()  # systems beside the boats whose frames are recorded
        self._plans = tuple(plans)
        self._found, self._ignored = found, ignored
        following = settings.following
        self._adapt = following.adapt
        self._paths = [
            ShadowPath.of(
                plan.vessel,
                plan.plant,
                settings.filter,
                reference=following.reference,
                follower=following.follower,
                rate_hz=following.rate_hz,
            )
            for plan in plans
        ]

    def warm_up(self) -> None:
        """Compile everything before a link is open, by a few messages of a throw-away boat."""
        warm_up()
        for path, plan in zip(self._paths, self._plans, strict=True):
            boat = LiveBoat(Boat(1, 1), plan.key, path, self._adapt)
            for k in range(6):  # longer than a second, at whose end more is done
                list(boat.datagram(warm_up_messages(1000 + 300 * k), (k + 1) * 300_000_000))
            list(boat.tick(2_200_000_000))

    def datagrams(self, datagrams: Iterable[Datagram]) -> Iterator[FleetOutput]:
        """Datagrams in their order, boat by boat -> what comes of them, as it is made."""
        for boat, messages in self.received(datagrams):
            for output in boat.datagrams(messages):
                yield FleetOutput(boat, output)

    def received(
        self, datagrams: Iterable[Datagram]
    ) -> list[tuple[LiveBoat, list[tuple[Any, int]]]]:
        """The messages of each boat that is followed, each with its receipt [ns]; boats that are
        heard for the first time are found.
        """
        by_system: dict[int, list[tuple[Any, int]]] = {}
        for datagram in datagrams:
            for frame in datagram.frames:
                message = Head.of(frame.raw) if frame.message is None else frame.message
                if message.get_type() == "HEARTBEAT":
                    self._find_boat(message)
                boat = self.boats.get(message.get_srcSystem())
                if boat is not None and message.get_srcComponent() == boat.boat.component:
                    received = message, datagram.receive_time_ns
                    by_system.setdefault(boat.boat.system, []).append(received)
        return [(self.boats[system], messages) for system, messages in by_system.items()]

    def due(self, now_ns: int) -> list[LiveBoat]:
        """The boats that have been silent for so long that they want a tick."""
        return [boat for boat in self.boats.values() if boat.wants_tick(now_ns)]

    def tick(self, now_ns: int) -> Iterator[FleetOutput]:
        """A moment without telemetry: the shadows of silent boats run on."""
        for boat in self.due(now_ns):
            for output in boat.tick(now_ns):
                yield FleetOutput(boat, output)

    def recorded(self, frames: Sequence[Frame]) -> dict[int, list[bytes]]:
        """Frames for the recording of each boat, by its system: its own, and those of a few
        systems that are no boat, which go to all.

        A flood of invented ids neither fills the disk nor delays the boat.
        """
        found: dict[int, list[bytes]] = {}
        for frame in frames:
            system = sender(frame.raw)
            if system in self.boats:
                found.setdefault(system, []).append(frame.raw)
            elif self._beside(system):
                for boat in self.boats:
                    found.setdefault(boat, []).append(frame.raw)
        return found

    def _beside(self, system: int) -> bool:
        """Is it one of the few systems that are recorded, though they are no boat?"""
        if system in self._ignored_systems:
            return False
        if len(self._others) < MAX_OTHERS:
            self._others.add(system)
        return system in self._others

    def _find_boat(self, heartbeat: Any) -> None:
        system = heartbeat.get_srcSystem()
        if system in self.boats or system in self._ignored_systems:
            return
        boat = from_heartbeat(heartbeat)
        if boat is None:
            return
        index = self._plan_for(system)
        if index is None or len(self.boats) >= MAX_BOATS:
            self._ignored_systems.add(system)
            self._others.discard(system)
            self._ignored(boat)
            return
        plan = self._plans[index]
        if plan.system is None:
            self._taken.add(index)
        self.boats[system] = LiveBoat(
            boat, self._name(plan, system), self._paths[index], self._adapt
        )
        self._found(self.boats[system], plan)

    def _name(self, plan: BoatPlan, system: int) -> str:
        """The plan's name, with the system id where another boat or plan has it too."""
        taken = {boat.name for boat in self.boats.values()}
        taken |= {other.key for other in self._plans if other is not plan}
        name = plan.key
        while name in taken:
            name = f"{name}-{system}"
        return name

    def _plan_for(self, system: int) -> int | None:
        """The plan for this very boat, else one for any that has not found its boat yet."""
        for wanted in (system, None):
            for index, plan in enumerate(self._plans):
                if plan.system == wanted and index not in self._taken:
                    return index
        return None


def sender(raw: bytes) -> int:
    """System id of a frame; 0 where it is too short to have one."""
    place = 5 if raw[:1] == b"\xfd" else 3
    return raw[place] if len(raw) > place else 0
