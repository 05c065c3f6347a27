"""How often boats are asked for which messages: everything, or what a slow radio can carry.

A radio pair at 57600 baud carries less than half of the 5.8 kB/s of its serial line one way, and
the autopilot's own streams share it. `radio` takes 1.2 kB/s at most and keeps what the model needs:
heading, velocity, and commands above the 5 Hz below which nothing can be said of their lag.

Asking one boat for message rates: one request at a time, because an answer names none.

COMMAND_ACK tells the command and the result, not the message that was asked for. So the next
request waits for the answer to the one before; an answer that comes after its request was given up
can still be credited to the wrong one. The rates that arrive have the last word (`observed`).

Which messages the boats of a link are asked for, and when: pure, time comes from outside.

Default telemetry is thin; every boat that is heard is asked once for the rates configured,
again after a reboot, and again when what it accepted does not arrive (a ground station may have set
its own). Nothing but these requests and our own heartbeat is ever said, and nothing at all when
silent.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.ingest.mavlink.boats import GROUND_STATION
from gateway.ingest.mavlink.definitions import ids_by_name
from gateway.links.transmitter import SET_RATE, Identity

MOST_HZ = 1000.0
FULL_HZ: Mapping[str, float] = MappingProxyType(
    {
        "ATTITUDE": 50.0,
        "LOCAL_POSITION_NED": 25.0,
        "SERVO_OUTPUT_RAW": 25.0,
        "GLOBAL_POSITION_INT": 5.0,
        "GPS_RAW_INT": 5.0,
        "SYS_STATUS": 2.0,
        "BATTERY_STATUS": 2.0,
        "SYSTEM_TIME": 1.0,
    }
)
RADIO_HZ: Mapping[str, float] = MappingProxyType(
    {
        "ATTITUDE": 10.0,
        "LOCAL_POSITION_NED": 5.0,
        "SERVO_OUTPUT_RAW": 8.0,
        "GLOBAL_POSITION_INT": 1.0,
        "GPS_RAW_INT": 1.0,
        "SYS_STATUS": 1.0,
        "BATTERY_STATUS": 0.0,  # the voltage is in SYS_STATUS too
        "SYSTEM_TIME": 1.0,
    }
)
PRESETS: Mapping[str, Mapping[str, float]] = MappingProxyType({"full": FULL_HZ, "radio": RADIO_HZ})


def check_rates(rates_hz: Mapping[str, float]) -> None:
    """Raise BadInput for what cannot be asked for; a rate of 0 is not asked for."""
    for name, rate in rates_hz.items():
        if name not in FULL_HZ and not _is_message(name):
            raise BadInput(f"[links.rates] {name}: there is no such MAVLink message")
        if not 0.0 <= rate <= MOST_HZ:
            raise BadInput(
                f"[links.rates] {name} = {rate}: expected Hz, 0 (not asked for) to {MOST_HZ:.0f}"
            )


def _is_message(name: str) -> bool:
    from gateway.ingest.mavlink.definitions import ids_by_name

    return name in ids_by_name()


SECOND = 1_000_000_000
WAITS_NS = (SECOND, 2 * SECOND, 4 * SECOND)  # for an answer to each try
AGAIN_NS = 30 * SECOND  # between two rounds of asking for what does not arrive
ROUNDS = 3  # … after which it is said and left
ENOUGH = 0.5  # of the rate asked for
ANSWERS: Mapping[int, str] = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "rejected for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "unsupported",
    dialect.MAV_RESULT_FAILED: "failed",
}
ACCEPTED = ANSWERS[dialect.MAV_RESULT_ACCEPTED]
NO_ANSWER = "no answer"


class Address(NamedTuple):
    """Of a boat's autopilot."""

    system: int
    component: int


class Answer(NamedTuple):
    """What became of a request, in words."""

    boat: Address
    message: str
    rate_hz: float
    answer: str

    @property
    def says(self) -> str:
        """One line for people."""
        return f"system {self.boat.system}: {self.message} at {self.rate_hz:g} Hz: {self.answer}"


class Ask(NamedTuple):
    """One request; `tries` goes out as `confirmation`."""

    boat: Address
    message: str
    rate_hz: float
    tries: int


@dataclass(frozen=True)
class Conversation:
    """Where we are with one boat. Times [ns] are those of any clock that only goes forward."""

    boat: Address
    rates_hz: Mapping[str, float]
    pending: tuple[str, ...]  # the first is in flight once `tries` > 0
    due_ns: int  # when to speak next, while something is pending
    tries: int = 0
    refusal: str = NO_ANSWER  # what to say when the tries are used up
    accepted: frozenset[str] = frozenset()
    rounds: int = 0  # of asking again for what does not arrive
    asked_ns: int = 0
    last_ack: int = -1  # its sequence number: links repeat frames

    @classmethod
    def start(cls, boat: Address, rates_hz: Mapping[str, float], now_ns: int) -> "Conversation":
        """Everything is to be asked for, now."""
        return cls(boat, rates_hz, tuple(rates_hz), now_ns)

    def speak(self, now_ns: int) -> tuple["Conversation", Ask | None, Answer | None]:
        """What to ask for now, if anything, and which request is given up."""
        if not self.pending or now_ns < self.due_ns:
            return self, None, None
        if self.tries == len(WAITS_NS):
            over = self._answer(self.refusal)
            after, ask, _ = self._next(now_ns).speak(now_ns)
            return after, ask, over
        ask = Ask(self.boat, self.pending[0], self.rates_hz[self.pending[0]], self.tries)
        due_ns = now_ns + WAITS_NS[self.tries]
        return replace(self, tries=self.tries + 1, due_ns=due_ns, asked_ns=now_ns), ask, None

    def acknowledged(
        self, result: int, sequence: int, now_ns: int
    ) -> tuple["Conversation", Answer | None]:
        """COMMAND_ACK of a rate request came; `sequence` is its frame's."""
        if not self.pending or self.tries == 0 or sequence == self.last_ack:
            return self, None
        heard = replace(self, last_ack=sequence)
        if result == dialect.MAV_RESULT_IN_PROGRESS:
            return replace(heard, due_ns=now_ns + WAITS_NS[-1]), None
        answer = ANSWERS.get(result, f"refused with result {result}")
        if result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            return replace(heard, refusal=answer), None  # the next try comes when it is due
        accepted = self.accepted | ({self.pending[0]} if answer == ACCEPTED else set())
        return replace(heard._next(now_ns), accepted=accepted), self._answer(answer)

    def observed(
        self, rates_hz: Mapping[str, float], now_ns: int
    ) -> tuple["Conversation", tuple[Answer, ...]]:
        """Rates that arrive (0 where left out): what was accepted but is slow is asked again."""
        if self.pending or now_ns - self.asked_ns < AGAIN_NS or not any(rates_hz.values()):
            return self, ()
        slow = [m for m in self.rates_hz if m in self.accepted and self._slow(m, rates_hz)]
        if not slow:
            return replace(self, rounds=0), ()
        if self.rounds < ROUNDS:
            return replace(self, pending=tuple(slow), due_ns=now_ns, rounds=self.rounds + 1), ()
        says = [f"accepted, but {rates_hz.get(m, 0.0):.3g} Hz arrive" for m in slow]
        left = replace(self, accepted=self.accepted - set(slow))
        return left, tuple(
            Answer(self.boat, m, self.rates_hz[m], s) for m, s in zip(slow, says, strict=True)
        )

    def _slow(self, message: str, rates_hz: Mapping[str, float]) -> bool:
        return rates_hz.get(message, 0.0) < ENOUGH * self.rates_hz[message]

    def _next(self, now_ns: int) -> "Conversation":
        return replace(self, pending=self.pending[1:], tries=0, due_ns=now_ns, refusal=NO_ANSWER)

    def _answer(self, answer: str) -> Answer:
        return Answer(self.boat, self.pending[0], self.rates_hz[self.pending[0]], answer)


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
