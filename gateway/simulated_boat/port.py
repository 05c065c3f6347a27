"""The simulated boat's end of a link, on the transports of `gateway.links`.

    udpout:HOST:PORT   sends there (the gateway listens: udpin)
    udpin:HOST:PORT    waits for a first datagram (from the gateway: udpout)
    tcpin:HOST:PORT    is the server (the gateway: tcp)
    tcp:HOST:PORT      connects, again and again until a server is there (the gateway: tcpin)

It is polled, and waits for nothing but a connection, a moment.
"""

import time
from contextlib import suppress
from typing import Self

from gateway.errors import BadInput, ShadowError
from gateway.links.sources import transport_of
from gateway.links.transport import Arrival, Peer, Transport, Waker

KINDS = {  # and what to report while nothing that is sent can be received
    "udpout": "",
    "udpin": "nobody has spoken yet; waiting",
    "tcpin": "nobody has called; waiting",
    "tcp": "",
}
MAX_PEERS = 16  # that are sent to because a datagram came from them
CONNECT_TIMEOUT_S, RETRY_S = 0.25, 1.0


class BoatPort:
    """One end of a link, open while inside."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint, self._transport = endpoint, boat_transport(endpoint)
        self._waiting = KINDS[endpoint.partition(":")[0]]
        self._waker = Waker()
        self._failure: str | None = "no answer"  # why it is not open; None: it is
        self._retry_s = float("-inf")
        self._senders: dict[Peer, None] = {}

    def __enter__(self) -> Self:
        try:
            self._open()
        except OSError as error:
            self._close(error)
            if self._transport.listens:
                self._waker.__exit__()
                raise ShadowError(f"{self._endpoint}: cannot open it: {self._failure}") from None
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()
        self._waker.__exit__()

    @property
    def no_listener(self) -> str | None:
        """Why nothing that is sent can be received; None where it may be."""
        if self._failure is not None:
            return f"{self._failure}; calling again every second"
        return None if self._peers() else self._waiting

    def send(self, data: bytes) -> None:
        """One frame to everybody who listens; lost where nobody does."""
        if self._failure is None:
            for peer in self._peers():
                self._transport.send(data, peer)

    def receive(self) -> list[Arrival]:
        """What has arrived since; connects where there is no connection."""
        arrivals: list[Arrival] = []
        try:
            if self._failure is not None:
                if time.monotonic() < self._retry_s:
                    return []
                self._open()
            while new := self._transport.receive(0.0):
                arrivals += new
        except OSError as error:
            self._close(error)
        for arrival in arrivals:
            if len(self._senders) < MAX_PEERS:
                self._senders[arrival.peer] = None
        return arrivals

    def _peers(self) -> tuple[Peer, ...]:
        connected = self._transport.connected()
        return tuple(self._senders) if connected is None else connected

    def _open(self) -> None:
        self._retry_s = time.monotonic() + RETRY_S
        self._transport.open(self._waker, lambda kind, text: None, CONNECT_TIMEOUT_S)
        self._failure = None

    def _close(self, error: OSError) -> None:
        self._transport.close()
        self._failure = error.strerror or str(error)


def boat_transport(endpoint: str) -> Transport:
    """The transport that an endpoint names, still closed; BadInput where it names none."""
    if endpoint.partition(":")[0] in KINDS:
        with suppress(BadInput):
            return transport_of(endpoint)
    raise BadInput(
        f"{endpoint}: expected {', '.join(KINDS)} with host and port, as in udpout:127.0.0.1:14550"
    )
