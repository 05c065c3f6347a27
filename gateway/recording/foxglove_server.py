"""A live Foxglove WebSocket: the channels of a recording, as they are made.

It listens at [HOST:]PORT, on this machine alone by default. The library's threads serve the
sockets; the loop only hands messages over, and only those that somebody asked for. It never waits:
a client that is too slow loses the oldest of its backlog. Clients can do nothing but subscribe. The
boat of the first vessel has the topics of a recording, so that the same layout fits; those of other
boats begin with their names. `gateway.recording.origin_gate` stands in front.
"""

import ipaddress
import logging
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Thread
from typing import Any, Self

import numpy as np
import orjson
from numpy.typing import NDArray

from gateway.errors import BadInput, ShadowError
from gateway.json_rows import TopicRows
from gateway.long_running import LogLine
from gateway.recording import foxglove
from gateway.recording.foxglove import PlayerRows
from gateway.recording.origin_gate import (
    FULL,
    MAX_CLIENTS,
    ORIGINS,
    PROTOCOL,
    UPDATE,
    OriginGate,
    inner_host,
)
from gateway.recording.recorder import JSON, JSON_SCHEMA
from gateway.topics import TOPICS

HOST = "127.0.0.1"


def parse_address(text: str, what: str = "Foxglove server") -> tuple[str, int]:
    """ "8765", "0.0.0.0:8765" or "[::1]:8765" -> host, port; port 0 is any that is free."""
    host, mark, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") if mark else HOST
    if not host or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise BadInput(f'{what} on "{text}": expected [HOST:]PORT, as in 8765')
    return host, int(port)


def on_this_machine(host: str) -> bool:
    """Does nobody else reach that address?"""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


BACKLOG = 1024  # messages that wait for one client: about three seconds of a boat at 50 Hz
FULL_AGAIN_S = 60.0  # until it is told again that there is no place for a player
MAX_TOLD = 8  # pages that were refused, and subprotocols, that are named
STOP_S = 0.5  # a client that does not read would hold up the end
NAME = "digital shadow"


class BoatView:
    """The channels of one boat; `prefix` is its name where the topics are another's."""

    def __init__(self, sdk: Any, context: Any, rate_hz: float, prefix: str) -> None:
        self._sdk, self._context = sdk, context
        start = f"{prefix}/" if prefix else ""
        known = [foxglove.named(c, prefix) if prefix else c for c in foxglove.CHANNELS]
        self._topics = {
            name: self._channel(f"{start}{name}", topic.schema, orjson.dumps(topic.json_schema()))
            for name, topic in TOPICS.items()
        }
        self._known = {
            c.topic: self._channel(c.topic, c.schema, foxglove.schema_text(c.schema)) for c in known
        }
        self._players = PlayerRows(rate_hz, known)

    def show(self, rows: Sequence[TopicRows]) -> None:
        """Send messages to the players that have subscribed; without any, nothing is made."""
        for part in rows:
            channel, times = self._topics[part.topic], part.receive_time_ns
            if channel.has_sinks():
                self._log(channel, times, part.payloads)
            for shown in self._players.of(part, self._wanted):
                self._log(self._known[shown.channel.topic], times[shown.rows], shown.payloads)

    def _wanted(self, channel: foxglove.Channel) -> bool:
        return bool(self._known[channel.topic].has_sinks())

    def _log(self, channel: Any, times: NDArray[np.int64], payloads: Sequence[bytes]) -> None:
        for time_ns, payload in zip(times.tolist(), payloads, strict=True):
            channel.log(payload, log_time=time_ns)

    def _channel(self, topic: str, schema: str, text: bytes) -> Any:
        described = self._sdk.Schema(name=schema, encoding=JSON_SCHEMA, data=text)
        return self._sdk.Channel(
            topic, schema=described, message_encoding=JSON, context=self._context
        )


class FoxgloveServer:
    """Listens while inside.

    address   [HOST:]PORT
    origins   of web pages that may connect, beside `ORIGINS` and those of this machine
    progress  is told of pages and players that were refused
    """

    def __init__(
        self,
        address: str,
        rate_hz: float,
        origins: Sequence[str] = (),
        progress: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.host, self._port = parse_address(address)
        self._rate_hz = rate_hz
        self._origins, self._progress = (*ORIGINS, *origins), progress
        self._server: Any = None
        self._gate: OriginGate | None = None
        self._refused: set[str] = set()
        self._foreign: set[str] = set()  # subprotocols
        self._plain_given = False
        self._told_full = -math.inf  # s

    def __enter__(self) -> Self:
        self._sdk = _library()
        self._context = self._sdk.Context()
        inner = inner_host()
        try:
            self._server = self._sdk.start_server(
                name=NAME, host=inner, port=0, context=self._context, message_backlog_size=BACKLOG,
            )  # fmt: skip
            inside = inner, int(self._server.port)
            outside = self.host, self._port
            gate = OriginGate(outside, inside, self._origins, self._refuse, self._tell_outdated,
                              self._tell_full)  # fmt: skip
            self._gate = gate.__enter__()
        except (RuntimeError, OSError) as error:
            self.__exit__()
            why = (getattr(error, "strerror", None) or str(error)).split(" (")[0]
            raise BadInput(
                f"Foxglove server on {self.host}:{self._port}: cannot listen there: {why}; "
                "is another program using the port?"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        gate, self._gate = self._gate, None
        if gate is not None:
            gate.__exit__()
        server, self._server = self._server, None
        if server is None:  # the library does not stand being stopped twice
            return
        ending = Thread(target=server.stop, name="foxglove", daemon=True)
        ending.start()
        ending.join(STOP_S)

    @property
    def port(self) -> int:
        """The TCP port that it listens on."""
        assert self._gate is not None
        return self._gate.port

    @property
    def text(self) -> str:
        """The address to connect to, and from where that is possible, in words."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        others = "" if on_this_machine(self.host) else ", for everyone who reaches this machine"
        return f"Foxglove WebSocket on ws://{host}:{self.port}{others}"

    def _refuse(self, origin: str) -> None:
        """Tell of a page that was refused, once for each of the first few."""
        if _is_new(origin, self._refused):
            self._progress(
                f"Foxglove: a web page of {origin[:100] or 'several origins'} was refused; "
                "origins under [foxglove] in gateway.toml lists those that may watch"
            )

    def _tell_outdated(self, protocols: str) -> None:
        """Tell of a player that speaks other subprotocols, once for each of the first few."""
        if _is_new(protocols, self._foreign):
            text = (
                f"Foxglove: a player that speaks {protocols[:100] or 'no subprotocol'} was "
                f"refused; this server speaks {PROTOCOL}: {UPDATE}"
            )
            self._progress(LogLine(text, "warning", "foxglove_refused"))

    def _tell_full(self) -> None:
        """Tell that there was no place for a player, at most once a minute."""
        now = time.monotonic()
        if now - self._told_full < FULL_AGAIN_S:
            return
        self._told_full = now
        text = f"Foxglove: {MAX_CLIENTS} players are connected, and one more was refused: {FULL}"
        self._progress(LogLine(text, "warning", "foxglove_refused"))

    def boat(self, name: str, leading: bool) -> BoatView:
        """Channels for a boat; the first leading one has the topics of a recording."""
        plain = leading and not self._plain_given
        self._plain_given |= plain
        return BoatView(self._sdk, self._context, self._rate_hz, "" if plain else name)


def _is_new(kind: str, told: set[str]) -> bool:
    """Whether a kind was not told of before, and is one of the first few: it is noted."""
    new = kind not in told and len(told) < MAX_TOLD
    if new:
        told.add(kind)
    return new


def _library() -> Any:
    """Loaded only where it is wanted: it is large. What it has to say of strangers is left out."""
    try:
        import foxglove as sdk
    except ImportError as error:
        raise ShadowError(
            f"the Foxglove server needs the library foxglove-sdk ({error}): "
            "pip install foxglove-sdk, or do without --foxglove"
        ) from None
    log = logging.getLogger("foxglove")
    log.addHandler(logging.NullHandler())
    log.propagate = False
    return sdk
