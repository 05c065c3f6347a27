"""A session that only watches: a client of whoever listens there, or what a file describes.

Subscribes to what gateways publish and keeps the latest of it.

zenoh's callbacks only put bytes away; decoding happens when somebody looks, a few times a second.
A vessel that shows up is asked for its last values, so that slow topics are there at once.
"""

import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import Any, Self

import orjson
import zenoh
from zenoh import ext

from gateway.bus import BusSettings, open_session
from gateway.errors import BadInput
from gateway.monitor.vessel_view import Latest, Message, VesselPicture, decode, plain
from gateway.topics import TOPICS


def join(endpoint: str, config_file: Path | None) -> zenoh.Session | None:
    """Join the gateway or router at `endpoint`; None while nobody answers there."""
    if config_file is not None:
        return open_session(BusSettings(config_file=config_file))
    config = _client(endpoint)
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        return None


def _client(endpoint: str) -> zenoh.Config:
    """It listens nowhere and looks for nobody else; zenoh itself joins again when a link broke."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    try:
        config.insert_json5("connect/endpoints", orjson.dumps([endpoint]).decode())
    except zenoh.ZError:
        raise BadInput(f"--connect {endpoint}: expected tcp/HOST:PORT or tls/HOST:PORT") from None
    return config


PACE = "shadow"  # the topic whose rate is told
PATIENCE_S = 5.0  # for answers
GONE_KEPT = 20  # vessels
EVENTS_KEPT = 20


@dataclass
class _Kept:
    """What came of one vessel: payload and arrival (None: an answer) by topic."""

    alive: bool = False
    payloads: dict[str, tuple[bytes, float | None]] = field(default_factory=dict)
    paces: deque[float] = field(default_factory=lambda: deque(maxlen=100))
    events: deque[Message] = field(default_factory=lambda: deque(maxlen=EVENTS_KEPT))
    told: int = 0


class Watcher:
    """Watches `shadow/<name>/…` over an open session; `*` means all vessels."""

    def __init__(
        self,
        session: zenoh.Session,
        name: str = "*",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._name, self._clock = session, name, clock
        self._lock = Lock()
        self._vessels: dict[str, _Kept] = {}
        self._newcomers: set[str] = set()
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as scope:
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                f"shadow/{self._name}/*",
                self._heard,
                history=ext.HistoryConfig(max_samples=1, detect_late_publishers=True),
            )
            scope.callback(subscriber.undeclare)
            life = self._session.liveliness().declare_subscriber(
                f"shadow/{self._name}/alive", self._life_sign, history=True
            )
            scope.callback(life.undeclare)
            self._scope = scope.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._scope.close()

    def pictures(self) -> tuple[VesselPicture, ...]:
        """All vessels known, by name."""
        with self._lock:
            newcomers, self._newcomers = self._newcomers, set()
            kept = {name: _copy(vessel) for name, vessel in self._vessels.items()}
        for name in newcomers:
            self._session.get(f"shadow/{name}/*", self._answered, timeout=PATIENCE_S)
        now = self._clock()
        return tuple(_picture(name, kept[name], now) for name in sorted(kept))

    def _heard(self, sample: Any) -> None:
        """A subscriber's callback, on a thread of zenoh."""
        name, topic = _parts(sample.key_expr)
        if topic in TOPICS:
            self._keep(name, topic, sample.payload.to_bytes(), self._clock())

    def _answered(self, reply: Any) -> None:
        """The last value of a topic from before; what came since is newer."""
        if reply.ok is not None:
            name, topic = _parts(reply.ok.key_expr)
            if topic in TOPICS:
                self._keep(name, topic, reply.ok.payload.to_bytes(), None)

    def _keep(self, name: str, topic: str, payload: bytes, arrival: float | None) -> None:
        with self._lock:
            vessel = self._vessel(name)
            if topic == "event":
                _remember(vessel, decode(topic, payload))
            if arrival is None:
                vessel.payloads.setdefault(topic, (payload, None))
                return
            vessel.payloads[topic] = payload, arrival
            if topic == PACE:
                vessel.paces.append(arrival)

    def _life_sign(self, sample: Any) -> None:
        name, _ = _parts(sample.key_expr)
        with self._lock:
            vessel = self._vessel(name)
            vessel.alive = sample.kind == zenoh.SampleKind.PUT
            if vessel.alive:
                self._newcomers.add(name)

    def _vessel(self, name: str) -> _Kept:
        """The entry of a vessel; those gone longest make room, so that names cannot pile up."""
        if name not in self._vessels:
            gone = [known for known, vessel in self._vessels.items() if not vessel.alive]
            for old in gone[: max(0, len(gone) - GONE_KEPT)]:
                del self._vessels[old]
        return self._vessels.setdefault(name, _Kept())


def _parts(key: Any) -> tuple[str, str]:
    """shadow/<vessel>/<topic> -> vessel, topic."""
    _, name, topic = str(key).split("/")
    return name, topic


def _remember(vessel: _Kept, event: Message | None) -> None:
    """Once, though it may come as history, as an answer and as news."""
    if event is not None and event not in vessel.events:
        vessel.events.append(event)
        vessel.told += 1


def _copy(vessel: _Kept) -> _Kept:
    return _Kept(
        vessel.alive, dict(vessel.payloads), vessel.paces.copy(), vessel.events.copy(), vessel.told
    )


def _picture(name: str, kept: _Kept, now: float) -> VesselPicture:
    latest = {}
    for topic in TOPICS:
        payload, arrival = kept.payloads.get(topic, (b"", None))
        message = decode(topic, payload)
        if message is not None:
            latest[topic] = Latest(message, None if arrival is None else now - arrival)
    events = sorted(kept.events, key=lambda event: event["receive_time_ns"])
    return VesselPicture(
        plain(name), kept.alive, latest, _rate(kept.paces, now), tuple(events), kept.told
    )


def _rate(arrivals: deque[float], now: float) -> float:
    """Messages per second of late, falling when they cease to come."""
    recent = [arrival for arrival in arrivals if now - arrival < 3.0]
    if len(recent) < 2:
        return 0.0
    return len(recent) / max(now - recent[0], 1e-3)
