"""Addresses from which each system id sends over a link, and whether two boats share an id."""

import threading
from enum import Enum, auto

from gateway.links.transport import Peer

MAX_ADDRESSES = 8  # kept per system id
ADDRESS_TIMEOUT_NS = 60_000_000_000  # an address silent for so long is not sent to
# Two addresses are two boats with one id after so many changes between them, each within this time
# of the one before: a reconnection under another port changes once. Chosen, not measured.
SHARED_ID_CHANGES, CHANGE_WINDOW_NS = 4, 10_000_000_000


class SenderChange(Enum):
    """What a frame shows about the sender of its system id."""

    NONE = auto()
    FIRST = auto()  # the first frame under this system id
    SHARED = auto()  # two addresses use this system id: reported once


class Peers:
    """Addresses by the system ids that were received from them; two threads use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received_ns: dict[int, dict[Peer, int]] = {}
        self._latest: dict[int, Peer] = {}
        self._changes: dict[int, tuple[int, int]] = {}  # count, time of the last

    def note(self, system: int, peer: Peer, now_ns: int) -> SenderChange:
        """A frame of a system came from that peer."""
        with self._lock:
            known = self._received_ns.setdefault(system, {})
            known[peer] = now_ns
            before = self._latest.get(system)
            self._latest[system] = peer
            if before is None or before == peer:
                return SenderChange.FIRST if before is None else SenderChange.NONE
            if len(known) > MAX_ADDRESSES:
                del known[min(known, key=known.__getitem__)]
            count, when = self._changes.get(system, (0, now_ns))
            close = count >= SHARED_ID_CHANGES or now_ns - when < CHANGE_WINDOW_NS
            count = count + 1 if close else 1
            self._changes[system] = (count, now_ns)
            return SenderChange.SHARED if count == SHARED_ID_CHANGES else SenderChange.NONE

    def addresses(self, system: int | None, now_ns: int) -> tuple[Peer, ...]:
        """Of a system, of all for None; the latest of each even after a long silence."""
        found: dict[Peer, None] = {}
        with self._lock:
            for number, known in self._received_ns.items():
                if system is None or number == system:
                    found[self._latest[number]] = None
                    found |= {
                        p: None for p, when in known.items() if now_ns - when < ADDRESS_TIMEOUT_NS
                    }
        return tuple(found)
