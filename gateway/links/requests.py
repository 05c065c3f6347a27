"""Which messages the boats of a link are asked for, and when: pure, time comes from outside.

Default telemetry is thin; every boat that is heard is asked once for the rates configured,
again after a reboot, and again when what it accepted does not arrive (a ground station may have set
its own). Nothing but these requests and our own heartbeat is ever said, and nothing at all when
silent.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.ingest.boats import GROUND_STATION
from gateway.ingest.definitions import ids_by_name
from gateway.links.conversation import SECOND, Address, Answer, Ask, Conversation
from gateway.links.rates import FULL_HZ, check_rates
from gateway.links.voice import SET_RATE, Identity

HEARTBEAT_NS = SECOND


class Said(NamedTuple):
    """What is to be sent and told now, and the state after it."""

    requests: "Requests"
    messages: tuple[Any, ...]  # of pymavlink, for `Link.say`
    answers: tuple[Answer, ...]


@dataclass(frozen=True)
class Requests:
    """What one link asks of its boats. Times [ns]: any clock that only goes forward.

    announce  send heartbeats before any boat was heard, see `Link.announces`
    """

    identity: Identity | None  # None: silent
    rates_hz: Mapping[str, float] = field(default_factory=lambda: FULL_HZ)  # 0: not asked for
    announce: bool = False
    boats: Mapping[Address, Conversation] = field(default_factory=dict)
    answers: tuple[Answer, ...] = ()  # not told yet
    heartbeat_ns: int | None = None  # when the next one is due; None: at once

    def __post_init__(self) -> None:
        check_rates(self.rates_hz)

    def take(self, message: Any, now_ns: int) -> "Requests":
        """A message of the link: only HEARTBEAT and COMMAND_ACK mean anything here."""
        kind = message.get_type()
        source = Address(message.get_srcSystem(), message.get_srcComponent())
        if kind == "HEARTBEAT" and _is_boat(message):
            return self.heard(source, now_ns)
        if kind == "COMMAND_ACK" and message.command == SET_RATE and self._for_us(message):
            return self.acknowledged(source, message.result, message.get_seq(), now_ns)
        return self

    def heard(self, boat: Address, now_ns: int) -> "Requests":
        """A boat's heartbeat: the first one starts the asking."""
        if self.identity is None or boat in self.boats:
            return self
        return self._with(self._start(boat, now_ns))

    def rebooted(self, boat: Address, now_ns: int) -> "Requests":
        """Its clock jumped back: whatever it had accepted is forgotten."""
        if boat not in self.boats:
            return self
        return self._with(self._start(boat, now_ns))

    def acknowledged(self, boat: Address, result: int, sequence: int, now_ns: int) -> "Requests":
        """A boat answered a request; `sequence` is that of the frame."""
        if boat not in self.boats:
            return self
        after, answer = self.boats[boat].acknowledged(result, sequence, now_ns)
        return self._with(after, (answer,) if answer else ())

    def observed(self, boat: Address, rates_hz: Mapping[str, float], now_ns: int) -> "Requests":
        """The rates at which a boat's messages arrive over this link."""
        if boat not in self.boats:
            return self
        after, answers = self.boats[boat].observed(rates_hz, now_ns)
        return self._with(after, answers)

    def due(self, now_ns: int) -> Said:
        """Everything that is to be said by now; a heartbeat goes ahead of the first request."""
        messages: list[Any] = []
        heartbeat_ns = self.heartbeat_ns
        if self._speaking and (heartbeat_ns is None or now_ns >= heartbeat_ns):
            messages.append(heartbeat())
            heartbeat_ns = now_ns + HEARTBEAT_NS
        boats, answers = dict(self.boats), list(self.answers)
        for boat, conversation in self.boats.items():
            boats[boat], ask, answer = conversation.speak(now_ns)
            messages += [request(ask)] if ask else []
            answers += [answer] if answer else []
        after = replace(self, boats=boats, answers=(), heartbeat_ns=heartbeat_ns)
        return Said(after, tuple(messages), tuple(answers))

    @property
    def next_ns(self) -> int | None:
        """When `due` will have something, if nothing else happens; None: never."""
        if not self._speaking:
            return None
        times = [c.due_ns for c in self.boats.values() if c.pending]
        return min([*times, self.heartbeat_ns or 0])

    @property
    def _speaking(self) -> bool:
        return self.identity is not None and (self.announce or bool(self.boats))

    def _start(self, boat: Address, now_ns: int) -> Conversation:
        asked = {message: rate for message, rate in self.rates_hz.items() if rate > 0.0}
        return Conversation.start(boat, asked, now_ns)

    def _for_us(self, message: Any) -> bool:
        """Was it us whom the boat answered? 0 stands for everyone."""
        us = self.identity
        if us is None or message.target_system not in (0, us.system):
            return False
        return message.target_component in (0, us.component)

    def _with(self, conversation: Conversation, answers: tuple[Answer, ...] = ()) -> "Requests":
        boats = {**self.boats, conversation.boat: conversation}
        return replace(self, boats=boats, answers=self.answers + answers)


def heartbeat() -> Any:
    """Ours: some autopilots talk only to those whom they have heard."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER,
        dialect.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=dialect.MAV_STATE_ACTIVE,
        mavlink_version=3,
    )


def request(ask: Ask) -> Any:
    """MAV_CMD_SET_MESSAGE_INTERVAL: message id, interval [µs]."""
    number, interval_us = ids_by_name()[ask.message], round(1e6 / ask.rate_hz)
    return dialect.MAVLink_command_long_message(
        *ask.boat, SET_RATE, ask.tries, number, interval_us, 0, 0, 0, 0, 0
    )


def _is_boat(message: Any) -> bool:
    return message.autopilot != dialect.MAV_AUTOPILOT_INVALID and message.type != GROUND_STATION
