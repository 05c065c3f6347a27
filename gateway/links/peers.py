"""Who sends which system id over a link: where answers go, and whether an id is used twice."""

import threading
from enum import Enum, auto

from gateway.links.transport import Peer

MOST = 8  # addresses kept per system id
FORGOTTEN_NS = 60_000_000_000  # an address silent for so long is not sent to …
SWITCHES = 4  # … and one that takes turns with another so often is not a reconnection,
TOGETHER_NS = 10_000_000_000  # where less than this lies between the turns


class News(Enum):
    """What a frame told about its sender."""

    NONE = auto()
    FIRST = auto()  # nobody had spoken under this system id yet
    SHARED = auto()  # it has become plain that two addresses use this system id


class Peers:
    """Addresses by the system ids that were heard from them; two threads use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._heard: dict[int, dict[Peer, int]] = {}
        self._latest: dict[int, Peer] = {}
        self._switches: dict[int, tuple[int, int]] = {}

    def hear(self, system: int, peer: Peer, now_ns: int) -> News:
        """Note a frame."""
        with self._lock:
            return self._hear(system, peer, now_ns)

    def _hear(self, system: int, peer: Peer, now_ns: int) -> News:
        known = self._heard.setdefault(system, {})
        known[peer] = now_ns
        before = self._latest.get(system)
        self._latest[system] = peer
        if before is None or before == peer:
            return News.FIRST if before is None else News.NONE
        if len(known) > MOST:
            del known[min(known, key=known.__getitem__)]
        count, when = self._switches.get(system, (0, now_ns))
        count = count + 1 if count >= SWITCHES or now_ns - when < TOGETHER_NS else 1
        self._switches[system] = (count, now_ns)
        return News.SHARED if count == SWITCHES else News.NONE

    def towards(self, system: int | None, now_ns: int) -> tuple[Peer, ...]:
        """Addresses of a system, of all for None; the latest of each even after a long silence."""
        found: dict[Peer, None] = {}
        with self._lock:
            for number, known in self._heard.items():
                if system is None or number == system:
                    found[self._latest[number]] = None
                    found |= {p: None for p, when in known.items() if now_ns - when < FORGOTTEN_NS}
        return tuple(found)
