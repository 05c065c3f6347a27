"""Where MAVLink comes from, written as pymavlink writes it: `udpin:127.0.0.1:14550`."""

from dataclasses import dataclass
from enum import StrEnum

from gateway.errors import BadInput

BAUD = 115200  # as pymavlink assumes
FORMS = (
    "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT, /dev/NAME[,BAUD] "
    "or serial:/dev/NAME[:BAUD]"
)


class Kind(StrEnum):
    """How the other side is reached."""

    UDP_IN = "udpin"  # wait for datagrams, answer to where they come from
    UDP_OUT = "udpout"  # send to a fixed address, hear what comes back
    TCP_CLIENT = "tcp"
    TCP_SERVER = "tcpin"
    SERIAL = "serial"


@dataclass(frozen=True)
class Endpoint:
    """One parsed connection string; `host` is the device of a serial port."""

    text: str
    kind: Kind
    host: str
    port: int = 0
    baud: int = 0

    def __str__(self) -> str:
        return self.text

    @property
    def listens(self) -> bool:
        """Is it ours to offer? Then it can be refused at once, and reaching it needs nobody."""
        return self.kind in (Kind.UDP_IN, Kind.TCP_SERVER)

    @property
    def speaks_first(self) -> bool:
        """Does the other side learn of us only by what we send?"""
        return self.kind is Kind.UDP_OUT


def parse_endpoint(text: str) -> Endpoint:
    """A connection string -> endpoint; BadInput with the forms that exist."""
    scheme, _, rest = text.partition(":")
    if text.startswith("/"):
        return _serial(text, text, ",")
    if scheme == "serial":
        return _serial(text, rest, ":" if ":" in rest else ",")
    if scheme == "udp":
        return _network(text, Kind.UDP_IN, rest)
    if scheme in {kind.value for kind in Kind}:
        return _network(text, Kind(scheme), rest)
    raise _wrong(text, "not a connection string")


def _network(text: str, kind: Kind, rest: str) -> Endpoint:
    host, _, port = rest.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")  # an IPv6 address
    if not host:
        raise _wrong(text, "host or port is missing")
    number = _number(text, port, "port")
    if number > 65535:
        raise _wrong(text, f"there is no port {number}")
    return Endpoint(text, kind, host, port=number)


def _serial(text: str, rest: str, separator: str) -> Endpoint:
    device, _, baud = rest.partition(separator)
    if not device.startswith("/"):
        raise _wrong(text, "the device is missing")
    return Endpoint(text, Kind.SERIAL, device, baud=_number(text, baud, "baud") if baud else BAUD)


def _number(text: str, digits: str, name: str) -> int:
    if not (digits.isascii() and digits.isdigit() and int(digits) > 0):
        raise _wrong(text, f'the {name} "{digits}" is no positive number')
    return int(digits)


def _wrong(text: str, why: str) -> BadInput:
    return BadInput(f'endpoint "{text}": {why}; expected {FORMS}')
