"""What is known of a vessel now: the latest message of each topic, events, whether it lives."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import orjson

from gateway.topics import TOPICS, Field, Kind

Message = Mapping[str, Any]
TYPES: Mapping[Kind, tuple[type, ...]] = {
    Kind.NUMBER: (float, int),
    Kind.INTEGER: (int,),
    Kind.STRING: (str,),
}


@dataclass(frozen=True)
class Latest:
    """The latest message of a topic; no age where it was there before we came."""

    message: Message
    age_s: float | None


@dataclass(frozen=True)
class VesselPicture:
    """One vessel as it looks now. Events come oldest first; `told` counts all there have been."""

    name: str
    alive: bool
    latest: Mapping[str, Latest]
    rate_hz: float
    events: tuple[Message, ...] = ()
    told: int = 0

    def message(self, topic: str) -> Message | None:
        """The latest message of a topic."""
        found = self.latest.get(topic)
        return None if found is None else found.message

    def age_s(self) -> float | None:
        """Time since anything new came; None where nothing has."""
        ages = [one.age_s for one in self.latest.values() if one.age_s is not None]
        return min(ages, default=None)

    def says(self) -> tuple[bool, dict[str, Message]]:
        """All that may be news: whether it lives, and its messages."""
        return self.alive, {topic: one.message for topic, one in self.latest.items()}

    def to_dict(self, events_before: int = 0) -> dict[str, Any]:
        """For programs: the messages as they were published, and the events not told before."""
        fresh = min(self.told - events_before, len(self.events))
        return {
            "vessel": self.name,
            "alive": self.alive,
            "age_s": self.age_s(),
            "rate_hz": self.rate_hz,
            "latest": self.says()[1],
            "events": self.events[len(self.events) - fresh :],
        }


def decode(topic: str, payload: bytes) -> Message | None:
    """A payload as the table of topics describes it; None where it is anything else.

    Whoever reaches the network can publish under these keys: nothing is believed unseen.
    """
    try:
        message = orjson.loads(payload)
    except orjson.JSONDecodeError:
        return None
    fields = TOPICS[topic].all_fields
    if not isinstance(message, dict) or not all(_fits(message.get(f.name), f) for f in fields):
        return None
    return {name: _printable(value) for name, value in message.items()}


def _fits(value: Any, field: Field) -> bool:
    return isinstance(value, TYPES[field.kind]) and not isinstance(value, bool)


def _printable(value: Any) -> Any:
    """Text without what a terminal would obey."""
    return plain(value) if isinstance(value, str) else value


def plain(text: str) -> str:
    """Text of others with every control character replaced."""
    return "".join(c if c.isprintable() else "?" for c in text)
