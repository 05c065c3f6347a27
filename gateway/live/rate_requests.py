"""The requests for rates and parameters on all links: nothing else is ever sent to a boat.

Only boats that are shadowed are asked. Times are those of a clock that never steps.
"""

from collections.abc import Iterable, Mapping

from gateway.links.inbox import Datagram
from gateway.links.link import Link
from gateway.links.rate_requests import Address, LinkRequests, RequestOutcome
from gateway.links.transmitter import Identity
from gateway.live.boats import LiveBoat
from gateway.shadow.health import SECOND

OBSERVE_NS = 5 * SECOND  # so often the rates that arrive are compared with those requested


class RateRequests:
    """The requests of all links."""

    def __init__(
        self, links: Iterable[Link], identity: Identity | None, rates_hz: Mapping[str, float]
    ) -> None:
        self._links = {link.name: link for link in links}
        self._requests = {
            name: LinkRequests(identity, rates_hz, link.announces)
            for name, link in self._links.items()
        }
        self._observed_ns = 0
        self._reboots: dict[int, int] = {}  # by system

    def take(self, datagram: Datagram, boats: Iterable[LiveBoat], now_ns: int) -> None:
        """Heartbeats and answers of boats, and reboots that they show."""
        if datagram.link not in self._requests:
            return
        addresses = {boat.address: boat for boat in boats}
        for frame in datagram.frames:
            m = frame.message
            if m is None or m.get_type() not in ("HEARTBEAT", "COMMAND_ACK", "PARAM_VALUE"):
                continue
            boat = addresses.get((m.get_srcSystem(), m.get_srcComponent()))
            if boat is not None:
                self._restart_if_rebooted(boat, now_ns)
                requests = self._requests[datagram.link]
                self._requests[datagram.link] = requests.take(m, now_ns)

    def _restart_if_rebooted(self, boat: LiveBoat, now_ns: int) -> None:
        """A boat that rebooted has forgotten what it had accepted."""
        if boat.reboots == self._reboots.get(boat.boat.system, 0):
            return
        self._reboots[boat.boat.system] = boat.reboots
        for name, requests in self._requests.items():
            self._requests[name] = requests.rebooted(Address(*boat.address), now_ns)

    def due(self, boats: Iterable[LiveBoat], now_ns: int) -> list[RequestOutcome]:
        """Send what is to be sent by now -> the outcomes of earlier requests."""
        if now_ns - self._observed_ns >= OBSERVE_NS:
            self._observed_ns = now_ns
            self._observe(boats, now_ns)
        outcomes: list[RequestOutcome] = []
        for name, requests in self._requests.items():
            if (at := requests.next_ns) is not None and now_ns >= at:
                due = requests.due(now_ns)
                self._requests[name] = due.requests
                outcomes += due.outcomes
                for message in due.messages:
                    self._links[name].send_message(message)
        return outcomes

    def _observe(self, boats: Iterable[LiveBoat], now_ns: int) -> None:
        for boat in boats:
            rates = boat.health.rates_hz()
            for name, requests in self._requests.items():
                self._requests[name] = requests.observed(Address(*boat.address), rates, now_ns)
