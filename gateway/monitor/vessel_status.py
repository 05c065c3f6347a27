"""What is known of a vessel now: the latest message of each topic, events, whether it is alive."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import orjson

from gateway.topics import TOPICS, Field, FieldType

Message = Mapping[str, Any]
LINK_SILENT_S, HIGH_LOSS, HIGH_NIS = 1.0, 0.05, 3.0  # health is marked from there on; not measured
TYPES: Mapping[FieldType, tuple[type, ...]] = {
    FieldType.NUMBER: (float, int),
    FieldType.INTEGER: (int,),
    FieldType.STRING: (str,),
}


@dataclass(frozen=True)
class Latest:
    """The latest message of a topic; its age is None where it was published before we came."""

    message: Message
    age_s: float | None


@dataclass(frozen=True)
class VesselStatus:
    """One vessel as it is now; events oldest first, `event_count` of all that there have been."""

    name: str
    alive: bool
    latest: Mapping[str, Latest]
    rate_hz: float
    events: tuple[Message, ...] = ()
    event_count: int = 0

    def message(self, topic: str) -> Message | None:
        """The latest message of a topic."""
        found = self.latest.get(topic)
        return None if found is None else found.message

    def messages(self) -> dict[str, Message]:
        """The latest message of every topic."""
        return {topic: one.message for topic, one in self.latest.items()}

    def motion(self) -> Message | None:
        """How it moves as measured; while the link is down, how its shadow does."""
        return self.message("measured") or self.message("shadow")

    def age_s(self) -> float | None:
        """Time since the last new message; None where there was none."""
        ages = [one.age_s for one in self.latest.values() if one.age_s is not None]
        return min(ages, default=None)

    def to_dict(self, events_before: int = 0) -> dict[str, Any]:
        """A line of JSON: the messages as published, and the events after the first so many."""
        fresh = min(self.event_count - events_before, len(self.events))
        return {
            "vessel": self.name,
            "alive": self.alive,
            "age_s": self.age_s(),
            "rate_hz": self.rate_hz,
            "latest": self.messages(),
            "events": self.events[len(self.events) - fresh :],
        }


def decode(topic: str, payload: bytes) -> Message | None:
    """A payload as the table of topics describes it; None where it is anything else.

    Anybody on the network can publish under these keys: every field is checked.
    """
    try:
        message = orjson.loads(payload)
    except orjson.JSONDecodeError:
        return None
    fields = TOPICS[topic].all_fields
    if not isinstance(message, dict) or not all(_fits(message.get(f.name), f) for f in fields):
        return None
    return {k: printable(v) if isinstance(v, str) else v for k, v in message.items()}


def _fits(value: Any, field: Field) -> bool:
    return isinstance(value, TYPES[field.type]) and not isinstance(value, bool)


def printable(text: str) -> str:
    """Text with every control character replaced, so that it cannot command a terminal."""
    return "".join(c if c.isprintable() else "?" for c in text)


def time_of_day(time_ns: int) -> str:
    """Local time of day; dashes for a time that does not exist."""
    try:
        return f"{datetime.fromtimestamp(time_ns * 1e-9):%H:%M:%S}"
    except (ValueError, OverflowError, OSError):
        return "--:--:--"
