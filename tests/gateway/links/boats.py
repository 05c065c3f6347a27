"""Stand-ins for the other end of a link."""

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from queue import Empty
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.links import Datagram, Inbox, LinkEvent, LinkEventKind

PATIENCE_S = 10.0


class Autopilot:
    """Packs what a boat says; numbers its frames."""

    def __init__(self, system: int = 1, key: bytes | None = None, timestamp: int = 0) -> None:
        self.mavlink = dialect.MAVLink(None, system, 1)
        if key is not None:
            self.mavlink.signing.secret_key = key
            self.mavlink.signing.sign_outgoing = True
            self.mavlink.signing.timestamp = timestamp

    def frame(self, message: Any, version1: bool = False) -> bytes:
        raw = message.pack(self.mavlink, force_mavlink1=version1)
        self.mavlink.seq = (self.mavlink.seq + 1) % 256
        return raw

    def heartbeat(self) -> bytes:
        return self.frame(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))

    def attitude(self, time_ms: int = 0, yaw: float = 0.3) -> bytes:
        return self.frame(dialect.MAVLink_attitude_message(time_ms, 0.1, 0.2, yaw, 0.0, 0.0, 0.1))

    def ack(self, result: int = 0, command: int = 511, system: int = 245) -> bytes:
        return self.frame(dialect.MAVLink_command_ack_message(command, result, 0, 0, system, 191))


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def udp_socket(port: int = 0) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", port))
        line.settimeout(PATIENCE_S)
        yield line


def items(inbox: Inbox, until: Callable[[list[Any]], bool]) -> list[Any]:
    """What arrives until the condition holds; fails when it never does."""
    found: list[Any] = []
    deadline = time.monotonic() + PATIENCE_S
    while not until(found):
        try:
            found.append(inbox.get(max(deadline - time.monotonic(), 0.0)))
        except Empty:
            raise AssertionError(f"waited in vain; there was {found}") from None
    return found


def datagrams(inbox: Inbox, count: int) -> list[Datagram]:
    """The next datagrams; events between them are left out."""
    found = items(inbox, lambda found: sum(isinstance(i, Datagram) for i in found) == count)
    return [item for item in found if isinstance(item, Datagram)]


def event(inbox: Inbox, kind: LinkEventKind) -> LinkEvent:
    """The next event of that kind, whatever comes before."""
    is_it = lambda item: isinstance(item, LinkEvent) and item.kind is kind  # noqa: E731
    return items(inbox, lambda found: bool(found) and is_it(found[-1]))[-1]


def decoded(raw: bytes) -> list[Any]:
    """All messages in bytes, by pymavlink alone."""
    parser = dialect.MAVLink(None)
    return parser.parse_buffer(raw) or []
