"""Kinds of links: the one table, and the transport that a connection string names.

Connection strings are written as pymavlink writes them: `udpin:127.0.0.1:14550`. A plug-in
registers a `LinkSource` under the entry point group `shadow.links`.
"""

from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import entry_points
from typing import NamedTuple

from gateway.errors import BadInput
from gateway.links.serial_port import SerialTransport
from gateway.links.tcp import TcpClientTransport, TcpServerTransport
from gateway.links.transport import Endpoint, Transport
from gateway.links.udp import UdpTransport


class LinkSource(NamedTuple):
    """A kind of link; `transport` raises ValueError for an address that it cannot use."""

    kind: str  # what a connection string begins with
    form: str  # of its connection strings
    description: str
    transport: Callable[[Endpoint], Transport]


SERIAL_FORM = "/dev/NAME[,BAUD] or serial:/dev/NAME[:BAUD]"
SOURCES = (
    LinkSource("udpin", "udpin:HOST:PORT", "wait for datagrams", UdpTransport),
    LinkSource("udpout", "udpout:HOST:PORT", "speak first to a fixed address", UdpTransport),
    LinkSource("tcp", "tcp:HOST:PORT", "join a server", TcpClientTransport),
    LinkSource("tcpin", "tcpin:HOST:PORT", "be the server", TcpServerTransport),
    LinkSource("serial", SERIAL_FORM, "a serial port with its baud rate", SerialTransport),
)
ALIASES = {"udp": "udpin"}


@lru_cache(maxsize=1)
def known_sources() -> tuple[LinkSource, ...]:
    """The table, then what installed plug-ins add."""
    plugged = (point.load() for point in entry_points(group="shadow.links"))
    return (*SOURCES, *(source for source in plugged if isinstance(source, LinkSource)))


def transport_of(text: str) -> Transport:
    """A connection string -> its transport, still closed; BadInput with the forms that exist."""
    kind, _, address = text.partition(":")
    if text.startswith("/"):
        kind, address = "serial", text
    try:
        for source in known_sources():
            if source.kind == ALIASES.get(kind, kind):
                return source.transport(Endpoint(text, source.kind, address))
        raise ValueError("not a connection string")
    except ValueError as error:
        forms = ", ".join(source.form for source in known_sources())
        raise BadInput(f'endpoint "{text}": {error}; expected {forms}') from None
