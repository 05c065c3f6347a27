"""What is known of a vessel now: the latest message of each topic, events, whether it is alive.

Watching the bus: a session as a client, subscribed to what gateways publish.

zenoh's callbacks only put payloads away; decoding happens when somebody asks for the statuses, a
few times a second. A vessel that appears is asked for its last values, so that slow topics are
there at once.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, Self

import orjson
import zenoh
from zenoh import ext

from gateway.bus import DEFAULT_ENDPOINT, open_file, session_config
from gateway.errors import BadInput
from gateway.topics import JUDGING, WATCHED, Field, FieldType

Message = Mapping[str, Any]
TRUTH = "truth"  # of a boat in the loop: it comes from `shadow hil`, whatever its shadow does
SILENT_S = 2.0  # without a new message a boat is said to be silent; chosen, not measured
LINK_SILENT_S, HIGH_LOSS, HIGH_NIS = 1.0, 0.05, 3.0  # health is marked from there on; not measured
TYPES: Mapping[FieldType, tuple[type, ...]] = {
    FieldType.NUMBER: (float, int),
    FieldType.INTEGER: (int,),
    FieldType.STRING: (str,),
}


@dataclass(frozen=True)
class Latest:
    """The latest message of a topic; its age is None where it was published before we came."""

    message: Message
    age_s: float | None


@dataclass(frozen=True)
class Judged:
    """What a gateway said last of its model: an event; None where it has said nothing so far."""

    event: Message | None = None


@dataclass(frozen=True)
class VesselStatus:
    """One vessel as it is now; events oldest first, `event_count` of all that there have been.

    judged  None: it was not heard, and the gateway could not be asked
    """

    name: str
    alive: bool
    latest: Mapping[str, Latest]
    rate_hz: float
    events: tuple[Message, ...] = ()
    event_count: int = 0
    judged: Judged | None = None

    def message(self, topic: str) -> Message | None:
        """The latest message of a topic."""
        found = self.latest.get(topic)
        return None if found is None else found.message

    def messages(self) -> dict[str, Message]:
        """The latest message of every topic."""
        return {topic: one.message for topic, one in self.latest.items()}

    def motion(self) -> Message | None:
        """How it moves as measured; while the link is down, how its shadow does."""
        return self.message("measured") or self.message("shadow")

    def age_s(self) -> float | None:
        """Time since the last new message of its shadow; None where there was none."""
        heard = (one.age_s for topic, one in self.latest.items() if topic != TRUTH)
        ages = [age for age in heard if age is not None]
        return min(ages, default=None)

    @property
    def silent_s(self) -> float | None:
        """Time without any new message where that is too long, or it is gone; None while it lives.

        Of a boat that never sent one while we listened the time is not known: infinity.
        """
        age = self.age_s()
        if age is None:
            return float("inf")
        return None if self.alive and age <= SILENT_S else age

    @property
    def link_silent_s(self) -> float | None:
        """Time without a frame of the boat, as its gateway tells; None where it is heard."""
        health = self.message("health")
        if health is None or health["link_age_s"] <= LINK_SILENT_S:
            return None
        return float(health["link_age_s"])

    def to_dict(self, events_before: int = 0) -> dict[str, Any]:
        """A line of JSON: the messages as published, and the events after the first so many."""
        fresh = min(self.event_count - events_before, len(self.events))
        return {
            "vessel": self.name,
            "alive": self.alive,
            "age_s": self.age_s(),
            "rate_hz": self.rate_hz,
            "latest": self.messages(),
            "judged": None if self.judged is None else self.judged.event,
            "events": self.events[len(self.events) - fresh :],
        }


def decode(topic: str, payload: bytes) -> Message | None:
    """A payload as the table of topics describes it; None where it is anything else.

    Anybody on the network can publish under these keys: every field is checked.
    """
    try:
        message = orjson.loads(payload)
    except orjson.JSONDecodeError:
        return None
    fields = WATCHED[topic].all_fields
    if not isinstance(message, dict) or not all(_fits(message.get(f.name), f) for f in fields):
        return None
    return {k: printable(v) if isinstance(v, str) else v for k, v in message.items()}


def judged_in(payload: bytes) -> Judged | None:
    """What an answer to `status` says of the model; None where it does not say."""
    try:
        status = orjson.loads(payload)
    except orjson.JSONDecodeError:
        return None
    if not isinstance(status, dict) or "judged" not in status:
        return None
    told = status["judged"]
    event = decode("event", orjson.dumps(told))
    return None if event is None and told is not None else Judged(event)


def _fits(value: Any, field: Field) -> bool:
    return isinstance(value, TYPES[field.type]) and not isinstance(value, bool)


def printable(text: str) -> str:
    """Text with every control character replaced, so that it cannot command a terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)


def time_of_day(time_ns: int) -> str:
    """Local time of day; dashes for a time that does not exist."""
    try:
        return f"{datetime.fromtimestamp(time_ns * 1e-9):%H:%M:%S}"
    except (ValueError, OverflowError, OSError):
        return "--:--:--"


RATED_TOPIC = "shadow"  # the topic whose rate is shown
ANSWER_TIMEOUT_S = 5.0
RETRY_S = 1.0  # between attempts to join where nothing answers
RATE_WINDOW_S = 3.0
MOST_GONE = 20  # vessels that are remembered after they have gone
MOST_EVENTS = 100  # per vessel
BEGUN = "started"  # the first estimate of a gateway: what another one said before is over
STATUS = "status"  # which only answers


@dataclass(frozen=True)
class MonitorOptions:
    """Which endpoint or zenoh configuration to join, and which vessel to watch (`*`: all)."""

    endpoint: str = DEFAULT_ENDPOINT
    config_file: Path | None = None
    vessel: str = "*"
    patience_s: float = 5.0  # of `once`

    @property
    def where(self) -> str:
        """The place in words."""
        return str(self.config_file) if self.config_file else self.endpoint


def join_bus(endpoint: str, config_file: Path | None) -> zenoh.Session | None:
    """Join the gateway or router at `endpoint`; None while nothing answers there."""
    if config_file is not None:
        return open_file(config_file)
    try:
        config = session_config("client", {"connect": [endpoint]})
    except zenoh.ZError:
        raise BadInput(f"--connect {endpoint}: expected tcp/HOST:PORT or tls/HOST:PORT") from None
    with suppress(zenoh.ZError):
        return zenoh.open(config)
    return None


class BusWatcher:
    """Joins as soon as something answers, and watches from then on until `scope` ends."""

    def __init__(self, options: MonitorOptions, scope: ExitStack) -> None:
        self._options, self._scope = options, scope
        self._subscriber: VesselSubscriber | None = None
        self._next_try = -float("inf")

    @property
    def connected(self) -> bool:
        """Has anything answered?"""
        return self._subscriber is not None

    def statuses(self) -> tuple[VesselStatus, ...]:
        """All vessels known now."""
        if self._subscriber is None and time.monotonic() >= self._next_try:
            session = join_bus(self._options.endpoint, self._options.config_file)
            if session is not None:
                self._scope.enter_context(session)
                subscriber = VesselSubscriber(session, self._options.vessel)
                self._subscriber = self._scope.enter_context(subscriber)
            self._next_try = time.monotonic() + RETRY_S
        return () if self._subscriber is None else self._subscriber.statuses()


@dataclass
class _Received:
    """What came of one vessel: payload and arrival (None: an answer) by topic, events, arrivals."""

    alive: bool = False
    payloads: dict[str, tuple[bytes, float | None]] = field(default_factory=dict)
    arrivals: deque[float] = field(default_factory=lambda: deque(maxlen=100))
    events: deque[Message] = field(default_factory=lambda: deque(maxlen=MOST_EVENTS))
    event_count: int = 0
    judged: Judged | None = None

    def copy(self) -> "_Received":
        """A copy that later messages do not change."""
        return _Received(self.alive, dict(self.payloads), self.arrivals.copy(), self.events.copy(),
                         self.event_count, self.judged)  # fmt: skip

    def add_event(self, event: Message | None) -> None:
        """Once, though it may come as history, as an answer and as news."""
        if event is None or event in self.events:
            return
        self.events.append(event)
        self.event_count += 1
        if event["kind"] == BEGUN:
            self.judged = Judged()
        elif event["kind"] in JUDGING:
            self.judged = Judged(event)

    def status(self, name: str, now: float) -> VesselStatus:
        """Payloads decoded, ages and rate at the time `now`."""
        latest = {}
        for topic in WATCHED:
            payload, arrival = self.payloads.get(topic, (b"", None))
            message = decode(topic, payload)
            if message is not None:
                latest[topic] = Latest(message, None if arrival is None else now - arrival)
        events = tuple(sorted(self.events, key=lambda event: event["receive_time_ns"]))
        rate = _rate(self.arrivals, now)
        return VesselStatus(printable(name), self.alive, latest, rate, events, self.event_count,
                            self.judged)  # fmt: skip


class VesselSubscriber:
    """Subscribes to `shadow/<name>/…` over an open session; `*` means all vessels."""

    def __init__(
        self,
        session: zenoh.Session,
        name: str = "*",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._name, self._clock = session, name, clock
        self._lock = Lock()
        self._vessels: dict[str, _Received] = {}
        self._newcomers: set[str] = set()
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as scope:
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                f"shadow/{self._name}/*",
                self._on_sample,
                history=ext.HistoryConfig(max_samples=1, detect_late_publishers=True),
            )
            scope.callback(subscriber.undeclare)
            liveliness = self._session.liveliness().declare_subscriber(
                f"shadow/{self._name}/alive", self._on_liveliness, history=True
            )
            scope.callback(liveliness.undeclare)
            self._scope = scope.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._scope.close()

    def statuses(self) -> tuple[VesselStatus, ...]:
        """All vessels known, by name."""
        with self._lock:
            newcomers, self._newcomers = self._newcomers, set()
            received = {name: vessel.copy() for name, vessel in self._vessels.items()}
        for name in newcomers:
            self._session.get(f"shadow/{name}/*", self._on_reply, timeout=ANSWER_TIMEOUT_S)
        now = self._clock()
        return tuple(received[name].status(name, now) for name in sorted(received))

    def _on_sample(self, sample: Any) -> None:
        """A subscriber's callback, on a thread of zenoh."""
        self._keep(sample, self._clock())

    def _on_reply(self, reply: Any) -> None:
        """The last value of a topic from before; what came since is newer."""
        if reply.ok is not None:
            self._keep(reply.ok, None)

    def _keep(self, sample: Any, arrival: float | None) -> None:
        name, topic = _parts(sample.key_expr)
        if topic not in WATCHED and not (topic == STATUS and arrival is None):
            return
        payload = sample.payload.to_bytes()
        with self._lock:
            if topic == STATUS:
                vessel = self._vessel(name)
                vessel.judged = vessel.judged or judged_in(payload)
                return
            if topic == TRUTH and name not in self._vessels:
                return
            vessel = self._vessel(name)
            if topic == "event":
                vessel.add_event(decode(topic, payload))
            if arrival is None:
                vessel.payloads.setdefault(topic, (payload, None))
                return
            vessel.payloads[topic] = payload, arrival
            if topic == RATED_TOPIC:
                vessel.arrivals.append(arrival)

    def _on_liveliness(self, sample: Any) -> None:
        name, _ = _parts(sample.key_expr)
        with self._lock:
            vessel = self._vessel(name)
            vessel.alive = sample.kind == zenoh.SampleKind.PUT
            if vessel.alive:
                self._newcomers.add(name)

    def _vessel(self, name: str) -> _Received:
        """The entry of a vessel; those gone longest make room, so that names cannot pile up."""
        if name not in self._vessels:
            gone = [known for known, vessel in self._vessels.items() if not vessel.alive]
            for old in gone[: max(0, len(gone) - MOST_GONE)]:
                del self._vessels[old]
        return self._vessels.setdefault(name, _Received())


def _parts(key: Any) -> tuple[str, str]:
    """shadow/<vessel>/<topic> -> vessel, topic."""
    _, name, topic = str(key).split("/")
    return name, topic


def _rate(arrivals: deque[float], now: float) -> float:
    """Messages per second in the last few seconds, falling when they cease to come."""
    recent = [arrival for arrival in arrivals if now - arrival < RATE_WINDOW_S]
    if len(recent) < 2:
        return 0.0
    return len(recent) / max(now - recent[0], 1e-3)
