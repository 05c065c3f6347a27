"""One link: a thread that waits for bytes, stamps their receipt and puts frames into the inbox.

wait → receipt → frames (checksum) → signature → pymavlink's decoder → one item per datagram
"""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Self

from gateway.errors import BadInput
from gateway.links.endpoint import Endpoint, Kind, parse_endpoint
from gateway.links.frame_reader import Reader, cut
from gateway.links.inbox import Counts, Datagram, Inbox, Reporter
from gateway.links.inbox import Kind as Event
from gateway.links.peers import Peers
from gateway.links.serial_port import SerialWire
from gateway.links.signing import Signatures
from gateway.links.tcp import TcpClientWire, TcpServerWire
from gateway.links.transmitter import Identity, Transmitter, permitted
from gateway.links.transport import Arrival, Closing, Waker, Wire
from gateway.links.udp import UdpWire

WIRES: dict[Kind, Callable[[Endpoint], Wire]] = {
    Kind.UDP_IN: UdpWire,
    Kind.UDP_OUT: UdpWire,
    Kind.TCP_CLIENT: TcpClientWire,
    Kind.TCP_SERVER: TcpServerWire,
    Kind.SERIAL: SerialWire,
}
BACKOFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)  # between attempts to open a line again
CLOSE_S = 0.5  # a thread that is looking up a host name may need longer: it is left behind


class Link:
    """A connection to one or more boats, opened with `with`.

    identity  who we are when we speak; None: this link is silent and sends nothing at all
    key       32 bytes: only frames signed with it are taken, and what we send is signed
    number    of this link among ours: the link id in our signatures
    """

    def __init__(
        self,
        endpoint: str | Endpoint,
        inbox: Inbox,
        identity: Identity | None = None,
        key: bytes | None = None,
        number: int = 0,
    ) -> None:
        self.endpoint = parse_endpoint(endpoint) if isinstance(endpoint, str) else endpoint
        if identity is None and self.endpoint.speaks_first:
            raise BadInput(
                f'endpoint "{self.endpoint}": nobody answers a silent link that has to speak '
                "first; listen with udpin, or do without --silent"
            )
        self.name = str(self.endpoint)
        self._inbox = inbox
        self._wire = WIRES[self.endpoint.kind](self.endpoint)
        self._signatures = None if key is None else Signatures(key)
        self._voice = None if identity is None else Transmitter(identity, key, number)
        self._peers, self._counts = Peers(), Counts()
        self._reporter = Reporter(self.name, inbox)
        self._reader = Reader(self._counts, self._peers, self._signatures, self._reporter)
        self._up: bool | None = None  # None: not tried yet
        self._attempt = 0  # to open the line again
        self._lock = threading.Lock()  # a line is never closed while another thread sends on it
        self._thread = threading.Thread(target=self._run, name=self.name, daemon=True)
        self._scope = ExitStack()

    def __enter__(self) -> Self:
        cut(b"\xfd" * 12)  # whatever has to be compiled is compiled before the line is open
        self._waker = self._scope.enter_context(Waker())
        if self.endpoint.listens:
            self._offer()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._waker.wake()
        self._thread.join(CLOSE_S)
        if not self._thread.is_alive():
            self._scope.close()

    @property
    def announces(self) -> bool:
        """Must we be heard before we can hear? A boat behind in time is taken only once it has
        learnt the time from our signed frames."""
        return self._voice is not None and (
            self.endpoint.speaks_first or self._signatures is not None
        )

    def counts(self) -> Counts:
        """A copy of what was counted so far."""
        return replace(self._counts)

    def say(self, message: Any) -> bool:
        """Pack, sign and send a message; False where nothing was sent."""
        if self._voice is None:
            return False
        stamp = 0 if self._signatures is None else self._signatures.next_timestamp(time.time_ns())
        return self.send(self._voice.pack(message, stamp))

    def send(self, raw: bytes) -> bool:
        """Send a frame to the system it is for, without waiting; ValueError if it is not ours to
        say; False where nobody was there or the link is silent."""
        target = getattr(permitted(raw), "target_system", None)
        if self._voice is None:
            return False
        fixed = self._wire.fixed_peer
        peers = self._peers.towards(target, time.monotonic_ns()) if fixed is None else (fixed,)
        with self._lock:
            sent = sum(self._wire.send(raw, peer) for peer in peers)
        self._counts.sent += sent
        self._counts.unsent += len(peers) - sent if peers else 1
        return sent > 0

    def _offer(self) -> None:
        """Open a port of ours; what stands in the way stays in the way, so it is the user's."""
        try:
            self._wire.open(self._waker, self._reporter.say)
        except OSError as error:
            self._wire.close()
            self._scope.close()
            why = error.strerror or error
            raise BadInput(
                f'endpoint "{self.endpoint}": cannot listen there: {why}; '
                "is another program using the port?"
            ) from None

    def _run(self) -> None:
        """The receiver's thread: serves the line, opens it again when it is lost."""
        opened = self.endpoint.listens
        try:
            while True:
                self._lost(self._served(opened))
                opened = False
                self._waker.sleep(BACKOFF_S[min(self._attempt, len(BACKOFF_S) - 1)])
                self._attempt += 1
        except Closing:
            self._close()

    def _served(self, opened: bool) -> str:
        """Serves the line until it is lost -> why."""
        try:
            if not opened:
                self._wire.open(self._waker, self._reporter.say)
            self._up = True
            while True:
                for arrival in self._wire.receive():
                    self._attempt = 0
                    self._take(arrival)
        except Closing:
            raise
        except OSError as error:
            return str(error.strerror or error)
        except Exception as error:  # a defect of ours: counted, said, and the line opened anew
            self._counts.faults += 1
            return repr(error)

    def _take(self, arrival: Arrival) -> None:
        """One read of the line into the inbox."""
        self._counts.datagrams += 1
        self._counts.bytes += len(arrival.data)
        try:
            frames = self._reader.read(arrival)
        except Exception as error:  # whatever a stranger sent must not end the connection
            self._counts.faults += 1
            self._reporter.seldom(Event.FAULT, f"a datagram was lost to {error!r}")
            return
        if frames and not self._inbox.put(Datagram(self.name, arrival.receive_time_ns, frames)):
            self._counts.dropped += 1

    def _lost(self, why: str) -> None:
        """Said once per loss, however many attempts to come back fail."""
        self._close()
        self._reader.forget()
        if self._up is not False:
            self._counts.losses += self._up is True
            self._reporter.say(Event.LOST, f"{why}; trying again")
        self._up = False

    def _close(self) -> None:
        with self._lock:
            self._wire.close()
