"""Frames on a zenoh key, as mavlink-server (BlueOS) publishes them: `mavlink_raw/out`.

Each sample is a stretch of the octet stream, usually one frame. The session joins a router or peer
as a client and looks for nobody else. What is sent goes to the key that ends in `/in` where the one
listened to ends in `/out`; from any other key nothing can be sent.

zenoh hands samples over on a thread of its own: they wait in a bounded queue, a socket wakes the
link. zenoh joins a router that comes back by itself.
"""

import re
import socket
import time
from collections import deque
from contextlib import suppress
from typing import Any

from gateway.links import (
    CONNECT_TIMEOUT_S,
    Arrival,
    Endpoint,
    EventSink,
    LineSelector,
    LinkEventKind,
    Peer,
    Waker,
)

ROUTER = "tcp/127.0.0.1:7447"  # of BlueOS, on the vehicle itself
FORM = "zenoh:KEY[@tcp/HOST:PORT]"
MAX_WAITING = 20_000  # samples: of more the oldest are lost
MAX_SAMPLE_BYTES = 65_536  # a longer sample is no frame of anybody
KEY = re.compile(r"[^\s/#?$*]+(/[^\s/#?$*]+)*")  # a key without wildcards


class ZenohTransport:
    """One subscriber; nothing that a publisher does closes it."""

    listens = False
    speaks_first = False

    def __init__(self, endpoint: Endpoint) -> None:
        self.key, _, where = endpoint.address.partition("@")
        self.router = where or ROUTER
        if not KEY.fullmatch(self.key):
            raise ValueError(f'"{self.key}" is no zenoh key without wildcards')
        if not re.fullmatch(r"[a-z]+/[^\s/]+:\d{1,5}", self.router):
            raise ValueError(f'"{self.router}" is no place of a zenoh router, such as {ROUTER}')
        self.fixed_peer: Peer | None = endpoint.text
        self._name = endpoint.text
        self._waiting: deque[Arrival] = deque(maxlen=MAX_WAITING)
        self._near: socket.socket | None = None
        self._far: socket.socket | None = None
        self._selector: LineSelector | None = None
        self._session: Any = None
        self._subscriber: Any = None

    @property
    def answer_key(self) -> str | None:
        """Where frames for the boat go; None where nobody takes any."""
        return f"{self.key.removesuffix('/out')}/in" if self.key.endswith("/out") else None

    def open(self, waker: Waker, report: EventSink, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        import zenoh

        from gateway.bus import first_line_of, session_config

        config = session_config("client", {"connect": [self.router]})
        config.insert_json5("connect/timeout_ms", str(round(timeout_s * 1000)))
        self._near, self._far = socket.socketpair()
        self._near.setblocking(False)
        self._far.setblocking(False)
        self._selector = LineSelector(waker)
        self._selector.add(self._near)
        try:
            self._session = zenoh.open(config)
            self._subscriber = self._session.declare_subscriber(self.key, self._take)
        except zenoh.ZError as error:
            raise OSError(f"no zenoh router at {self.router}: {first_line_of(error)}") from None
        report(LinkEventKind.CONNECTED, f"subscribed to {self.key} at {self.router}")

    def _take(self, sample: Any) -> None:
        """One sample, on a thread of zenoh's."""
        data = bytes(sample.payload)
        if len(data) > MAX_SAMPLE_BYTES:
            return
        self._waiting.append(Arrival(data, self._name, time.time_ns()))
        far = self._far
        if far is not None:
            with suppress(OSError):  # full: the link is awake already
                far.send(b"!")

    def connected(self) -> tuple[Peer, ...] | None:
        return (self._name,)

    def receive(self, timeout_s: float | None = None) -> list[Arrival]:
        assert self._selector is not None
        assert self._near is not None
        self._selector.wait(timeout_s)
        with suppress(BlockingIOError):
            self._near.recv(4096)
        found = []
        while self._waiting:
            found.append(self._waiting.popleft())
        return found

    def send(self, raw: bytes, peer: Peer) -> bool:
        if self._session is None or self.answer_key is None:
            return False
        import zenoh

        try:
            self._session.put(
                self.answer_key,
                raw,
                encoding=zenoh.Encoding.APPLICATION_OCTET_STREAM,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        except zenoh.ZError:
            return False
        return True

    def close(self) -> None:
        session, subscriber = self._session, self._subscriber
        self._session = self._subscriber = None
        if subscriber is not None:
            _quietly(subscriber.undeclare)  # before the session: no sample comes after it
        if session is not None:
            _quietly(session.close)
        for part in (self._selector, self._near, self._far):
            if part is not None:
                part.close()
        self._selector = self._near = self._far = None
        self._waiting.clear()


def _quietly(end: Any) -> None:
    """End something of zenoh's that may be gone already."""
    import zenoh

    with suppress(zenoh.ZError):
        end()
