"""Where the Foxglove server listens, as [HOST:]PORT; this machine alone by default."""

import ipaddress
from contextlib import suppress

from gateway.errors import BadInput

HOST = "127.0.0.1"


def parse_address(text: str) -> tuple[str, int]:
    """ "8765", "0.0.0.0:8765" or "[::1]:8765" -> host, port; port 0 is any that is free."""
    host, mark, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]") if mark else HOST
    if not host or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise BadInput(f'Foxglove server on "{text}": expected [HOST:]PORT, as in 8765')
    return host, int(port)


def on_this_machine(host: str) -> bool:
    """Does nobody else reach that address?"""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"
