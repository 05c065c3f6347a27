"""What happens to a link goes into the inbox as events; trouble that repeats is said seldom."""

import time

from gateway.links.inbox import Inbox
from gateway.links.items import Kind, LinkEvent

QUIET_NS = 10_000_000_000  # between two reports of the same trouble


class Reporter:
    """The voice of one link towards the loop."""

    def __init__(self, link: str, inbox: Inbox) -> None:
        self._link, self._inbox = link, inbox
        self._said_ns: dict[Kind, int] = {}

    def say(self, kind: Kind, says: str) -> None:
        """One event."""
        self._inbox.put(LinkEvent(self._link, time.time_ns(), kind, says))

    def seldom(self, kind: Kind, says: str) -> None:
        """One event at most in `QUIET_NS`, for what may come with every datagram."""
        now_ns = time.monotonic_ns()
        if now_ns - self._said_ns.get(kind, now_ns - QUIET_NS) >= QUIET_NS:
            self._said_ns[kind] = now_ns
            self.say(kind, says)
