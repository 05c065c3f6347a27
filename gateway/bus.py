"""Publishes the shadow on zenoh: `shadow/<vessel>/<topic>`, last values on request, a life sign.

By default the gateway is a peer that listens on the loopback interface and looks for nobody. Where
a router or another gateway already holds that port it joins as a client; with a zenoh configuration
file it does what that says.

Publishing never waits: a slow subscriber loses samples (DROP). zenoh's callbacks run on threads of
its own and only look at the last value kept here, under a lock.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any, Self

import orjson
import zenoh
from zenoh import ext

from gateway.errors import BadInput, ShadowError
from gateway.files import check_name
from gateway.json_rows import TopicRows
from gateway.keelson import KeelsonPublisher
from gateway.topics import TOPICS, Overflow, Topic

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
HEIR_LOOKS_S = 0.5  # so often a gateway that joined another one looks whether that is there
OTHERS_S = 0.5  # for other gateways to answer that they are there
MODEL_ENCODING = "application/toml"
STATUS_ENCODING = "application/json"
CONGESTION = {Overflow.DROP: zenoh.CongestionControl.DROP}
Payload = bytes | Callable[[], bytes]


@dataclass(frozen=True)
class BusSettings:
    """Where the session is: a zenoh configuration file, else `endpoint` of this machine.

    keelson  base path of Keelson's keys, under which all is published too; None: it is not
    """

    endpoint: str = DEFAULT_ENDPOINT
    config_file: Path | None = None
    keelson: str | None = None


def session_config(mode: str, endpoints: Mapping[str, Sequence[str]]) -> zenoh.Config:
    """A zenoh configuration without scouting."""
    config = zenoh.Config()
    entries: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
        **{f"{kind}/endpoints": list(endpoints.get(kind, ())) for kind in ("listen", "connect")},
    }
    for key, value in entries.items():
        config.insert_json5(key, orjson.dumps(value).decode())
    return config


def open_file(path: Path) -> zenoh.Session:
    """A session as a zenoh configuration file describes it, timestamps on in any case."""
    if not path.is_file():
        raise BadInput(f"{path}: no such zenoh configuration file: give an existing .json5 file")
    try:
        config = zenoh.Config.from_file(path)
        config.insert_json5("timestamping/enabled", "true")
    except (zenoh.ZError, ValueError) as error:
        raise BadInput(f"{path}: not a zenoh configuration: {first_line_of(error)}") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ShadowError(f"{path}: zenoh cannot start so: {first_line_of(error)}") from error


class PortHeir:
    """Listens on an endpoint once the gateway is gone that did, for a session that had joined it.

    Nobody would be reached there any more; the session finds the heir as it would find that gateway
    again. Where a router listens nothing is done, ever: it could not come back.
    """

    def __init__(self, joined: zenoh.Session, endpoint: str) -> None:
        self._joined, self._endpoint = joined, endpoint
        self._routed = bool(joined.info.routers_zid())
        self._own = ExitStack()
        self._ended = Event()
        self._thread = Thread(target=self._watch, name="zenoh port", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def stop(self) -> None:
        """No longer look; what listens goes on until the end."""
        self._ended.set()
        self._thread.join()

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._own.close()

    def _watch(self) -> None:
        while not self._routed and not self._ended.wait(HEIR_LOOKS_S):
            self._routed = bool(self._joined.info.routers_zid())
            alone = not self._routed and not self._joined.info.peers_zid()
            if alone and (listening := _listening(self._endpoint)) is not None:
                self._own.enter_context(listening)
                return


@contextmanager
def open_session(settings: BusSettings) -> Iterator[zenoh.Session]:
    """Inside: listen on the endpoint, or join whatever zenoh already listens there."""
    endpoint = settings.endpoint
    with ExitStack() as scope:
        if settings.config_file is not None:
            yield scope.enter_context(open_file(settings.config_file))
        elif (listening := _listening(endpoint)) is not None:
            yield scope.enter_context(listening)
        else:
            joined = _joined(endpoint)
            heir = scope.enter_context(PortHeir(joined, endpoint))
            scope.enter_context(joined)  # closed before the heir: others hear through it of the end
            scope.callback(heir.stop)
            yield joined


def _listening(endpoint: str) -> zenoh.Session | None:
    """A session that listens there; None where something does already."""
    with suppress(zenoh.ZError):
        return zenoh.open(session_config("peer", {"listen": [endpoint]}))
    return None


def _joined(endpoint: str) -> zenoh.Session:
    try:
        return zenoh.open(session_config("client", {"connect": [endpoint]}))
    except zenoh.ZError as error:
        raise ShadowError(
            f"{endpoint}: can neither listen nor join: {first_line_of(error)}: is another program "
            "on that port? choose another endpoint"
        ) from error


def first_line_of(error: Exception) -> str:
    """zenoh's own words without the places in its source code."""
    return str(error).splitlines()[0].split(" at /")[0].strip()


class _Channel:
    """One topic: its publisher, whether anyone listens, and the last value.

    Values are kept even while nobody listens, as bytes or as what makes them, so that whoever
    asks or comes late gets the last one at no cost to a loop without listeners.
    """

    def __init__(self, session: zenoh.Session, key: str, topic: Topic, scope: ExitStack) -> None:
        self.wanted = False
        self._key, self._encoding = key, topic.encoding
        self._lock = Lock()
        self._last: Payload | None = None
        self._sent = False
        self._publisher = ext.declare_advanced_publisher(
            session,
            key,
            encoding=topic.encoding,
            congestion_control=CONGESTION[topic.overflow],
            cache=ext.CacheConfig(1),
            publisher_detection=True,
        )
        scope.callback(self._publisher.undeclare)
        # The advanced publisher cannot tell who listens; a plain one beside it, never used, can.
        watcher = session.declare_publisher(key)
        scope.callback(watcher.undeclare)
        listener = watcher.declare_matching_listener(self._matched)
        scope.callback(listener.undeclare)
        # Documented as a bool, but an object with one in the versions seen so far.
        status = watcher.matching_status
        self.wanted = self.wanted or getattr(status, "matching", status)
        queryable = session.declare_queryable(key, self._answer, complete=True)
        scope.callback(queryable.undeclare)

    def publish(self, payload: Payload) -> None:
        """Send where anyone listens, keep in any case."""
        with self._lock:
            self._last, self._sent = payload, False
            if self.wanted:
                self._send()

    def _send(self) -> None:
        self._publisher.put(self._bytes())
        self._sent = True

    def _bytes(self) -> bytes:
        if callable(self._last):
            self._last = self._last()
        assert self._last is not None
        return self._last

    def _matched(self, status: Any) -> None:
        """The first subscriber came, or the last one went."""
        with self._lock:
            self.wanted = status.matching
            if self.wanted and self._last is not None and not self._sent:
                self._send()

    def _answer(self, query: Any) -> None:
        """Reply outside of the lock: replies wait for an asker that does not read."""
        with self._lock:
            payload = None if self._last is None else self._bytes()
        with query:
            if payload is not None:
                query.reply(self._key, payload, encoding=self._encoding)


class Bus:
    """The zenoh side of one vessel. `model` is its file's text, `status` makes a JSON object."""

    def __init__(
        self,
        vessel: str,
        *,
        model: bytes = b"",
        status: Callable[[], bytes] = lambda: b"{}",
        settings: BusSettings | None = None,
        session: zenoh.Session | None = None,
    ) -> None:
        self._vessel, self._root = vessel, f"shadow/{vessel}"
        self._model, self._status = model, status
        self._settings = settings or BusSettings()
        self._given = session
        self._scope = ExitStack()
        self._channels: dict[str, _Channel] = {}
        self._keelson: KeelsonPublisher | None = None
        self.others = False  # does another gateway publish under the same name?

    def __enter__(self) -> Self:
        check_name(self._vessel, "vessel name")
        with ExitStack() as scope:
            session = self._given or scope.enter_context(open_session(self._settings))
            for name, topic in TOPICS.items():
                key = f"{self._root}/{name}"
                self._channels[name] = _Channel(session, key, topic, scope)
            self._serve(session, scope, "model", lambda: self._model, MODEL_ENCODING)
            self._serve(session, scope, "status", self._status, STATUS_ENCODING)
            alive = f"{self._root}/alive"
            self.others = any(True for _ in session.liveliness().get(alive, timeout=OTHERS_S))
            token = session.liveliness().declare_token(alive)
            scope.callback(token.undeclare)
            if self._settings.keelson is not None:
                beside = KeelsonPublisher(session, self._settings.keelson, self._vessel)
                self._keelson = scope.enter_context(beside)
            self._scope = scope.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._channels.clear()
        self._keelson = None
        self._scope.close()

    def wants(self, topic: str) -> bool:
        """Does anyone listen to this topic now, under these keys or Keelson's?"""
        beside = self._keelson is not None and self._keelson.wants(topic)
        return beside or self._channels[topic].wanted

    def publish(self, topic: str, payload: Payload) -> None:
        """Publish a message, or what will make it when somebody wants it.

        A function is called at most once, here or later on a thread of zenoh: it must depend on
        nothing that changes.
        """
        if self._keelson is not None and self._keelson.wants(topic):
            payload = payload() if callable(payload) else payload
            self._keelson.publish(topic, payload)
        self._channels[topic].publish(payload)

    def publish_rows(self, rows: Iterable[TopicRows]) -> None:
        """All messages of topics that anyone listens to, of the others the last: it is kept for
        whoever asks or comes late, and encoded for them.
        """
        for part in rows:
            if self.wants(part.topic):
                for payload in part.payloads:
                    self.publish(part.topic, payload)
            elif len(part):
                self.publish(part.topic, part.last)

    def _serve(
        self,
        session: zenoh.Session,
        scope: ExitStack,
        name: str,
        content: Callable[[], bytes],
        encoding: str,
    ) -> None:
        key = f"{self._root}/{name}"

        def answer(query: Any) -> None:
            with query:
                query.reply(key, content(), encoding=encoding)

        queryable = session.declare_queryable(key, answer, complete=True)
        scope.callback(queryable.undeclare)
