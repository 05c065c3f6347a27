"""Message rates that the boats of a link are asked for, and when. Pure: time comes from outside.

A rate that a boat denies is asked for again in steps, down to the lowest of `STEPS_HZ`: an
autopilot whose loop runs at 50 Hz denies 50 and gives 40.

Default telemetry is thin. Each boat is asked once for the rates configured, again after a reboot,
and again when what it accepted does not arrive (a ground station may have set its own). Nothing but
these requests, those for parameters (`transmitter.ParameterRequests`) and our own heartbeat is ever
sent, and nothing at all on a silent link.

COMMAND_ACK names the command and the result, not the message that was asked for. So one boat is
asked for one message at a time, and the next request waits for the answer to the one before; an
answer that comes after its request was given up can still be credited to the wrong one. The rates
that arrive decide (`observed`).

A radio pair at 57600 baud carries less than half of the 5.8 kB/s of its serial line one way, and
the autopilot's own streams share it. `radio` takes 1.2 kB/s at most and keeps what the model needs:
heading, velocity, and commands above the 5 Hz below which their lag cannot be identified.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gateway.errors import BadInput
from gateway.ingest.mavlink.frames import ids_by_name
from gateway.ingest.mavlink.mapping import from_heartbeat
from gateway.links.transmitter import SET_RATE, WANTED, Identity, ParameterRequests

MAX_RATE_HZ = 1000.0
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
        "EKF_STATUS_REPORT": 1.0,
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
        "EKF_STATUS_REPORT": 1.0,
    }
)
PRESETS: Mapping[str, Mapping[str, float]] = MappingProxyType({"full": FULL_HZ, "radio": RADIO_HZ})
INSTEAD = {"PX4": {"EKF_STATUS_REPORT": "ESTIMATOR_STATUS"}}  # what tells the same of another EKF

SECOND = 1_000_000_000
ANSWER_TIMEOUTS_NS = (SECOND, 2 * SECOND, 4 * SECOND)  # of each try
REPEAT_NS = 30 * SECOND  # between two rounds of asking for what does not arrive
MAX_ROUNDS = 3  # … after which it is reported and left
SUFFICIENT_SHARE = 0.5  # of the rate asked for: a link that loses half of it is not asked again
HEARTBEAT_NS = SECOND
STEPS_HZ = (40.0, 25.0, 20.0, 10.0)  # of a rate that is refused
RESULTS: Mapping[int, str] = {
    dialect.MAV_RESULT_ACCEPTED: "accepted",
    dialect.MAV_RESULT_TEMPORARILY_REJECTED: "rejected for now",
    dialect.MAV_RESULT_DENIED: "denied",
    dialect.MAV_RESULT_UNSUPPORTED: "unsupported",
    dialect.MAV_RESULT_FAILED: "failed",
}
ACCEPTED = RESULTS[dialect.MAV_RESULT_ACCEPTED]
TOO_FAST = (  # results that may mean that this rate is not to be had: PX4 says "failed"
    dialect.MAV_RESULT_DENIED, dialect.MAV_RESULT_UNSUPPORTED, dialect.MAV_RESULT_FAILED,
)  # fmt: skip
NO_ANSWER = "no answer"
UNHEARD = (
    ": the link may go one way only (then --silent), or the boat takes signed frames alone "
    "(then --signing-key)"
)


def check_rates(rates_hz: Mapping[str, float]) -> None:
    """Raise BadInput for what cannot be asked for; a rate of 0 is not asked for."""
    for name, rate in rates_hz.items():
        if name not in FULL_HZ and name not in ids_by_name():
            raise BadInput(f"[links.rates] {name}: there is no such MAVLink message")
        if not 0.0 <= rate <= MAX_RATE_HZ:
            raise BadInput(
                f"[links.rates] {name} = {rate}: expected Hz, 0 (not asked for) to "
                f"{MAX_RATE_HZ:.0f}"
            )


class Address(NamedTuple):
    """MAVLink ids of a boat's autopilot."""

    system: int
    component: int


class RateRequest(NamedTuple):
    """One request; `tries` goes out as `confirmation`."""

    boat: Address
    message: str
    rate_hz: float
    tries: int

    def command(self) -> Any:
        """MAV_CMD_SET_MESSAGE_INTERVAL: message id, interval [µs]."""
        number, interval_us = ids_by_name()[self.message], round(1e6 / self.rate_hz)
        return dialect.MAVLink_command_long_message(
            *self.boat, SET_RATE, self.tries, number, interval_us, 0, 0, 0, 0, 0
        )


class RequestOutcome(NamedTuple):
    """The result of a request, in words."""

    boat: Address
    message: str
    rate_hz: float
    result: str

    @property
    def text(self) -> str:
        """One line for people."""
        return f"system {self.boat.system}: {self.message} at {self.rate_hz:g} Hz: {self.result}"


@dataclass(frozen=True)
class BoatRequests:
    """The requests to one boat. Times [ns] are those of any clock that only goes forward."""

    boat: Address
    rates_hz: Mapping[str, float]
    pending: tuple[str, ...]  # messages; the first is in flight once `tries` > 0
    due_ns: int  # when to send next, while something is pending
    tries: int = 0
    refusal: str = NO_ANSWER  # the result when the tries are used up
    accepted: frozenset[str] = frozenset()
    stepped: Mapping[str, float] = field(default_factory=dict)  # message -> highest rate refused
    refused: Mapping[str, float] = field(default_factory=dict)  # message -> rate asked for at first
    rounds: int = 0  # of asking again for what does not arrive
    sent_ns: int = 0
    last_ack: int = -1  # its sequence number: links repeat frames
    first_sequence: int = -1  # that of the heartbeat by which it was found; -1: not known
    counts: bool = False  # whether its sequence numbers were seen to change
    autopilot: str = ""
    unheard: bool = False  # whether it was told why the boat may not answer at all

    @classmethod
    def start(
        cls,
        boat: Address,
        rates_hz: Mapping[str, float],
        now_ns: int,
        first_sequence: int = -1,
        autopilot: str = "",
    ) -> "BoatRequests":
        """Everything is to be asked for, now, by the names of that autopilot."""
        names = INSTEAD.get(autopilot, {})
        rates = {names.get(name, name): rate for name, rate in rates_hz.items()} | {
            name: rate for name, rate in rates_hz.items() if name not in names
        }
        return cls(
            boat, rates, tuple(rates), now_ns, first_sequence=first_sequence, autopilot=autopilot
        )

    def again(self, rates_hz: Mapping[str, float], now_ns: int) -> "BoatRequests":
        """The same boat has forgotten it all."""
        fresh = BoatRequests.start(self.boat, rates_hz, now_ns, self.first_sequence, self.autopilot)
        return replace(fresh, counts=self.counts, unheard=self.unheard)

    def due(self, now_ns: int) -> tuple["BoatRequests", RateRequest | None, RequestOutcome | None]:
        """The state after now, the request to send, if any, and the one that is given up."""
        if not self.pending or now_ns < self.due_ns:
            return self, None, None
        if self.tries == len(ANSWER_TIMEOUTS_NS):
            never = self.refusal == NO_ANSWER and self.last_ack < 0
            given_up = self._outcome(self.refusal + (UNHEARD * (never and not self.unheard)))
            left = replace(self._refused(), unheard=self.unheard or never)
            after, request, _ = left._next(now_ns).due(now_ns)
            return after, request, given_up
        message = self.pending[0]
        request = RateRequest(self.boat, message, self.rates_hz[message], self.tries)
        due_ns = now_ns + ANSWER_TIMEOUTS_NS[self.tries]
        return replace(self, tries=self.tries + 1, due_ns=due_ns, sent_ns=now_ns), request, None

    def acknowledged(
        self, result: int, sequence: int, now_ns: int
    ) -> tuple["BoatRequests", RequestOutcome | None]:
        """COMMAND_ACK of a rate request came; `sequence` is its frame's."""
        # numbers that stand still, as of a boat that sends 0 in all frames, tell of no repeat
        counts = self.counts or sequence != self.first_sequence
        repeated = counts and sequence == self.last_ack
        if not self.pending or self.tries == 0 or repeated:
            return self, None
        after = replace(self, last_ack=sequence, counts=counts)
        if result == dialect.MAV_RESULT_IN_PROGRESS:
            return replace(after, due_ns=now_ns + ANSWER_TIMEOUTS_NS[-1]), None
        text = RESULTS.get(result, f"refused with result {result}")
        if result == dialect.MAV_RESULT_TEMPORARILY_REJECTED:
            return replace(after, refusal=text), None  # the next try comes when it is due
        message, rate = self.pending[0], self.rates_hz[self.pending[0]]
        lower = [step for step in STEPS_HZ if step < rate]
        if result in TOO_FAST and lower:
            rates, stepped = {**self.rates_hz, message: lower[0]}, {message: rate, **self.stepped}
            again = replace(after, rates_hz=rates, stepped=stepped, tries=0, due_ns=now_ns)
            return again, None
        if text == ACCEPTED and message in self.stepped:
            text = _stepped_down(rate, self.stepped[message])
        if not text.startswith(ACCEPTED):
            return after._refused()._next(now_ns), self._outcome(text)
        accepted = self.accepted | {message}
        return replace(after._next(now_ns), accepted=accepted), self._outcome(text)

    def observed(
        self, rates_hz: Mapping[str, float], now_ns: int
    ) -> tuple["BoatRequests", tuple[RequestOutcome, ...]]:
        """Rates that arrive (0 where left out): what was accepted but is slow is asked again, of
        what was refused it is said once what that costs.
        """
        if self.pending or now_ns - self.sent_ns < REPEAT_NS or not any(rates_hz.values()):
            return self, ()
        if self.refused:
            had = ((m, rates_hz.get(m, 0.0), asked) for m, asked in self.refused.items())
            return replace(self, refused={}), tuple(
                RequestOutcome(self.boat, m, asked, _refused_text(rate, asked))
                for m, rate, asked in had
                if 0.0 < rate < SUFFICIENT_SHARE * asked
            )
        slow = [
            m for m in self.rates_hz
            if m in self.accepted and rates_hz.get(m, 0.0) < SUFFICIENT_SHARE * self.rates_hz[m]
        ]  # fmt: skip
        if not slow:
            return replace(self, rounds=0), ()
        if self.rounds < MAX_ROUNDS:
            return replace(self, pending=tuple(slow), due_ns=now_ns, rounds=self.rounds + 1), ()
        left = replace(self, accepted=self.accepted - set(slow))
        return left, tuple(
            RequestOutcome(
                self.boat, m, self.rates_hz[m],
                f"accepted, but {rates_hz.get(m, 0.0):.3g} Hz arrive",
            )
            for m in slow
        )  # fmt: skip

    def _refused(self) -> "BoatRequests":
        message = self.pending[0]
        asked = self.stepped.get(message, self.rates_hz[message])
        return replace(self, refused={**self.refused, message: asked})

    def _next(self, now_ns: int) -> "BoatRequests":
        return replace(self, pending=self.pending[1:], tries=0, due_ns=now_ns, refusal=NO_ANSWER)

    def _outcome(self, result: str) -> RequestOutcome:
        return RequestOutcome(self.boat, self.pending[0], self.rates_hz[self.pending[0]], result)


def _stepped_down(rate_hz: float, refused_hz: float) -> str:
    """The result of a request that was taken at a lower rate, and what that costs."""
    return f"{ACCEPTED}, {refused_hz:g} Hz refused: values are {_age(rate_hz, refused_hz)}"


def _refused_text(rate_hz: float, asked_hz: float) -> str:
    """What comes of a message whose rate was refused, and what that costs."""
    return f"not taken, {rate_hz:.3g} Hz arrive: values are {_age(rate_hz, asked_hz)}"


def _age(rate_hz: float, asked_hz: float) -> str:
    return f"up to {1000.0 / rate_hz:.0f} ms old instead of {1000.0 / asked_hz:.0f}"


class DueMessages(NamedTuple):
    """Messages to send now, outcomes to report, and the state after them."""

    requests: "LinkRequests"
    messages: tuple[Any, ...]  # of pymavlink, for `Link.send_message`
    outcomes: tuple[RequestOutcome, ...]


@dataclass(frozen=True)
class LinkRequests:
    """The requests of one link to its boats. Times [ns]: any clock that only goes forward.

    announce  send heartbeats before any boat was received, see `Link.announces`
    """

    identity: Identity | None  # None: silent
    rates_hz: Mapping[str, float] = field(default_factory=lambda: FULL_HZ)  # 0: not asked for
    announce: bool = False
    boats: Mapping[Address, BoatRequests] = field(default_factory=dict)
    parameters: Mapping[Address, ParameterRequests] = field(default_factory=dict)
    outcomes: tuple[RequestOutcome, ...] = ()  # not reported yet
    heartbeat_ns: int | None = None  # when the next one is due; None: at once

    def __post_init__(self) -> None:
        check_rates(self.rates_hz)

    def take(self, message: Any, now_ns: int) -> "LinkRequests":
        """A message of the link: HEARTBEAT, COMMAND_ACK and PARAM_VALUE mean something here."""
        kind = message.get_type()
        source = Address(message.get_srcSystem(), message.get_srcComponent())
        if kind == "HEARTBEAT" and (boat := from_heartbeat(message)) is not None:
            return self.found(source, now_ns, boat.autopilot, message.get_seq())
        if kind == "PARAM_VALUE" and source in self.parameters:
            answered = self.parameters[source].answered(message.param_id)
            return replace(self, parameters={**self.parameters, source: answered})
        if kind == "COMMAND_ACK" and message.command == SET_RATE and self._is_for_us(message):
            return self.acknowledged(source, message.result, message.get_seq(), now_ns)
        return self

    def found(
        self, boat: Address, now_ns: int, autopilot: str = "", sequence: int = -1
    ) -> "LinkRequests":
        """A boat's heartbeat came, with that number: the first one starts the requests."""
        if self.identity is None or boat in self.boats:
            return self
        begun = BoatRequests.start(boat, self._wanted, now_ns, sequence, autopilot)
        after = self._with(begun)
        if autopilot not in WANTED:
            return after
        asked = {**self.parameters, boat: ParameterRequests.of(*boat, autopilot)}
        return replace(after, parameters=asked)

    def rebooted(self, boat: Address, now_ns: int) -> "LinkRequests":
        """Its clock jumped back: it has forgotten what it had accepted."""
        known = self.boats.get(boat)
        return self if known is None else self._with(known.again(self._wanted, now_ns))

    def acknowledged(
        self, boat: Address, result: int, sequence: int, now_ns: int
    ) -> "LinkRequests":
        """A boat answered a request; `sequence` is that of the frame."""
        if boat not in self.boats:
            return self
        after, outcome = self.boats[boat].acknowledged(result, sequence, now_ns)
        return self._with(after, (outcome,) if outcome else ())

    def observed(self, boat: Address, rates_hz: Mapping[str, float], now_ns: int) -> "LinkRequests":
        """The rates at which a boat's messages arrive over this link."""
        if boat not in self.boats:
            return self
        return self._with(*self.boats[boat].observed(rates_hz, now_ns))

    def due(self, now_ns: int) -> DueMessages:
        """Everything that is to be sent by now; a heartbeat goes ahead of the first request."""
        messages: list[Any] = []
        heartbeat_ns = self.heartbeat_ns
        if self._sends and (heartbeat_ns is None or now_ns >= heartbeat_ns):
            messages.append(heartbeat())
            heartbeat_ns = now_ns + HEARTBEAT_NS
        boats, outcomes = dict(self.boats), list(self.outcomes)
        for boat, requests in self.boats.items():
            boats[boat], request, outcome = requests.due(now_ns)
            messages += [request.command()] if request else []
            outcomes += [outcome] if outcome else []
        parameters = dict(self.parameters)
        for boat, asked in self.parameters.items():
            if not boats[boat].pending:  # rates first
                parameters[boat], asks = asked.due(now_ns)
                messages += asks
        after = replace(
            self, boats=boats, parameters=parameters, outcomes=(), heartbeat_ns=heartbeat_ns
        )
        return DueMessages(after, tuple(messages), tuple(outcomes))

    @property
    def next_ns(self) -> int | None:
        """When `due` will have something, if nothing else happens; None: never."""
        if not self._sends:
            return None
        times = [requests.due_ns for requests in self.boats.values() if requests.pending]
        times += [
            asked.due_ns for boat, asked in self.parameters.items()
            if asked.next_ns is not None and not self.boats[boat].pending
        ]  # fmt: skip
        return min([*times, self.heartbeat_ns or 0])

    @property
    def _sends(self) -> bool:
        return self.identity is not None and (self.announce or bool(self.boats))

    @property
    def _wanted(self) -> Mapping[str, float]:
        return {message: rate for message, rate in self.rates_hz.items() if rate > 0.0}

    def _is_for_us(self, message: Any) -> bool:
        """Was the boat's answer for us? 0 stands for everyone."""
        us = self.identity
        if us is None or message.target_system not in (0, us.system):
            return False
        return message.target_component in (0, us.component)

    def _with(
        self, requests: BoatRequests, outcomes: tuple[RequestOutcome, ...] = ()
    ) -> "LinkRequests":
        boats = {**self.boats, requests.boat: requests}
        return replace(self, boats=boats, outcomes=self.outcomes + outcomes)


def heartbeat() -> Any:
    """Our own: some autopilots send only to those that they have received."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER,
        dialect.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=0,
        system_status=dialect.MAV_STATE_ACTIVE,
        mavlink_version=3,
    )
