"""Asking one boat for message rates: one request at a time, because an answer names none.

COMMAND_ACK tells the command and the result, not the message that was asked for. So the next
request waits for the answer to the one before; an answer that comes after its request was given up
can still be credited to the wrong one. The rates that arrive have the last word (`observed`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

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
