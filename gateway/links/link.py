"""One link: a thread that waits for bytes, stamps their receipt and puts frames into the inbox.

wait → receipt → frames (checksum) → signature → pymavlink's decoder → one item per datagram

`SOURCES` is the one table of kinds of links. Connection strings are written as pymavlink writes
them: `udpin:127.0.0.1:14550`. A plug-in registers a `LinkSource` under the entry point group
`shadow.links`.
"""

import errno
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import lru_cache
from importlib.metadata import entry_points
from typing import Any, NamedTuple, Self

from gateway.errors import BadInput
from gateway.links import (
    Arrival,
    Closing,
    Datagram,
    Endpoint,
    EventReporter,
    Inbox,
    LinkCounts,
    LinkEventKind,
    Transport,
    Waker,
)
from gateway.links.frame_reader import FrameReader, Peers, split_frames
from gateway.links.transmitter import Identity, Signatures, Transmitter, permitted
from gateway.links.transports import (
    SerialTransport,
    TcpClientTransport,
    TcpServerTransport,
    UdpTransport,
)
from gateway.links.zenoh_key import FORM as ZENOH_FORM
from gateway.links.zenoh_key import ZenohTransport


class LinkSource(NamedTuple):
    """A kind of link; `transport` raises ValueError for an address that it cannot use."""

    kind: str  # what a connection string begins with
    form: str  # of its connection strings
    description: str
    transport: Callable[[Endpoint], Transport]
    opening: str = "reading"  # what it does there, before its address: "listening on"


LISTENS = "listening on"
SERIAL_FORM = "/dev/NAME[,BAUD] or serial:/dev/NAME[:BAUD]"
SOURCES = (
    LinkSource("udpin", "udpin:HOST:PORT", "wait for datagrams", UdpTransport, LISTENS),
    LinkSource(
        "udpout", "udpout:HOST:PORT", "speak first to a fixed address", UdpTransport, "calling"
    ),
    LinkSource("tcp", "tcp:HOST:PORT", "join a server", TcpClientTransport, "connecting to"),
    LinkSource("tcpin", "tcpin:HOST:PORT", "be the server", TcpServerTransport, LISTENS),
    LinkSource("serial", SERIAL_FORM, "a serial port with its baud rate", SerialTransport),
    LinkSource("zenoh", ZENOH_FORM, "a zenoh key with frames: BlueOS", ZenohTransport),
)
ALIASES = {"udp": "udpin"}


@lru_cache(maxsize=1)
def known_sources() -> tuple[LinkSource, ...]:
    """The table, then what installed plug-ins add."""
    plugged = (point.load() for point in entry_points(group="shadow.links"))
    return (*SOURCES, *(source for source in plugged if isinstance(source, LinkSource)))


def transport_of(text: str) -> Transport:
    """A connection string -> its transport, still closed; BadInput with the forms that exist."""
    try:
        source, address = _source_of(text)
        return source.transport(Endpoint(text, source.kind, address))
    except ValueError as error:
        forms = ", ".join(source.form for source in known_sources())
        short = ", ".join(f"{alias}: is {kind}:" for alias, kind in ALIASES.items())
        raise BadInput(f'endpoint "{text}": {error}; expected {forms}; {short}') from None


def _source_of(text: str) -> tuple[LinkSource, str]:
    """A connection string -> its kind and its address; ValueError where there is no such kind."""
    kind, _, address = text.partition(":")
    if text.startswith("/"):
        kind, address = "serial", text
    for source in known_sources():
        if source.kind == ALIASES.get(kind, kind):
            return source, address
    raise ValueError("not a connection string")


def opening(endpoints: Sequence[str]) -> str:
    """What a program begins to do on its links, by kind: "listening on A, B, connecting to C"."""
    by_verb: dict[str, list[str]] = {}
    for text in endpoints:
        by_verb.setdefault(_source_of(text)[0].opening, []).append(text)
    return ", ".join(f"{verb} {', '.join(texts)}" for verb, texts in by_verb.items())


BACKOFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)  # between attempts to open a transport again
CLOSE_TIMEOUT_S = 0.5  # a thread that looks up a host name may need longer: it is left behind


class Link:
    """A connection to one or more boats, opened with `with`.

    identity  our own address; None: this link is silent and sends nothing at all
    key       32 bytes: only frames signed with it are accepted, and ours are signed
    number    of this link among ours: the link id in our signatures
    """

    def __init__(
        self,
        endpoint: str,
        inbox: Inbox,
        identity: Identity | None = None,
        key: bytes | None = None,
        number: int = 0,
    ) -> None:
        self.name = endpoint
        self._transport = transport_of(endpoint)
        if identity is None and self._transport.speaks_first:
            raise BadInput(
                f'endpoint "{endpoint}": nobody answers a silent link that has to speak '
                "first; listen with udpin, or do without --silent"
            )
        self._inbox = inbox
        self._signatures = None if key is None else Signatures(key)
        self._transmitter = None if identity is None else Transmitter(identity, key, number)
        self._peers, self._counts = Peers(self._transport.connected), LinkCounts()
        self._reporter = EventReporter(self.name, inbox)
        self._reader = FrameReader(self._counts, self._peers, self._signatures, self._reporter)
        self._up: bool | None = None  # None: not tried yet
        self._attempt = 0  # to open the transport again
        self._lock = threading.Lock()  # the transport is never closed while another thread sends
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        split_frames(b"\xfd" * 12)  # compiles what has to be compiled before anything arrives
        self._waker = self._scope.enter_context(Waker())
        if self._transport.listens:
            self._listen()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._waker.wake()
        self._thread.join(CLOSE_TIMEOUT_S)
        if not self._thread.is_alive():
            self._scope.close()

    @property
    def announces(self) -> bool:
        """Must heartbeats be sent before any boat was received?

        A boat behind in time is accepted only once it has learnt the time from our signed frames.
        """
        return self._transmitter is not None and (
            self._transport.speaks_first or self._signatures is not None
        )

    def counts(self) -> LinkCounts:
        """A copy of what was counted so far."""
        return replace(self._counts)

    def send_message(self, message: Any) -> bool:
        """Pack, sign and send a message; False where nothing was sent."""
        if self._transmitter is None:
            return False
        stamp = 0 if self._signatures is None else self._signatures.next_timestamp(time.time_ns())
        return self.send(self._transmitter.pack(message, stamp))

    def send(self, raw: bytes) -> bool:
        """Send a frame to the system it is for, without waiting; ValueError if it is not permitted;
        False where no peer is known or the link is silent."""
        target = getattr(permitted(raw), "target_system", None)
        if self._transmitter is None:
            return False
        fixed = self._transport.fixed_peer
        peers = self._peers.addresses(target, time.monotonic_ns()) if fixed is None else (fixed,)
        with self._lock:
            sent = sum(self._transport.send(raw, peer) for peer in peers)
        self._counts.sent += sent
        self._counts.unsent += len(peers) - sent if peers else 1
        return sent > 0

    def _listen(self) -> None:
        """Open a transport that waits for others; what keeps it from that is the user's to know."""
        try:
            self._transport.open(self._waker, self._reporter.report)
        except OSError as error:
            self._transport.close()
            self._scope.close()
            asks = "is another program using the port?"
            if error.errno == errno.EADDRNOTAVAIL:
                asks = "that address is none of this machine's (0.0.0.0: all of them)"
            raise BadInput(
                f'endpoint "{self.name}": cannot listen there: {error.strerror or error}; {asks}'
            ) from None

    def _run(self) -> None:
        """The receiver's thread: serves the transport, opens it again when it is lost."""
        is_open = self._transport.listens
        try:
            while True:
                self._handle_loss(self._serve(is_open))
                is_open = False
                self._waker.sleep(BACKOFF_S[min(self._attempt, len(BACKOFF_S) - 1)])
                self._attempt += 1
        except Closing:
            self._close()

    def _serve(self, is_open: bool) -> str:
        """Receive until the transport is lost -> why."""
        try:
            if not is_open:
                self._transport.open(self._waker, self._reporter.report)
            self._up = True
            while True:
                for arrival in self._transport.receive():
                    self._attempt = 0
                    self._queue(arrival)
        except Closing:
            raise
        except OSError as error:
            return str(error.strerror or error)
        except Exception as error:  # a defect of ours: counted, reported, and opened again
            self._counts.faults += 1
            return repr(error)

    def _queue(self, arrival: Arrival) -> None:
        """One read of the transport into the inbox."""
        self._counts.datagrams += 1
        self._counts.bytes += len(arrival.data)
        try:
            frames = self._reader.read(arrival)
        except Exception as error:  # whatever a stranger sent must not end the connection
            self._counts.faults += 1
            text = f"a datagram was lost to {error!r}"
            self._reporter.report_rarely(LinkEventKind.FAULT, text)
            return
        if frames and not self._inbox.put(Datagram(self.name, arrival.receive_time_ns, frames)):
            self._counts.dropped += 1

    def _handle_loss(self, reason: str) -> None:
        """Close, and report once per loss, however many attempts to reconnect fail."""
        self._close()
        self._reader.forget()
        if self._up is not False:
            self._counts.losses += self._up is True
            self._reporter.report(LinkEventKind.LOST, f"{reason}; trying again")
        self._up = False

    def _close(self) -> None:
        with self._lock:
            self._transport.close()
