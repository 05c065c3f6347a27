"""One message of a live link -> measurements, by the same table and clock as a log's columns."""

from typing import Any

from gateway.ingest.boats import Boat
from gateway.ingest.clock import BoatClock
from gateway.ingest.clock_step import UNIX_FROM_US, Verdict
from gateway.ingest.mapping.rule import Counter, Rule, instance_of
from gateway.ingest.mapping.table import MAVLINK, by_message
from gateway.samples import Measurement, Quantity

STREAM = {rule.source: number for number, rule in enumerate(MAVLINK)}
RULES = by_message(MAVLINK)


class BoatDecoder:
    """Turns the messages of one boat into measurements; holds that boat's clock."""

    def __init__(self, boat: Boat) -> None:
        self.boat = boat
        self.clock = BoatClock(len(MAVLINK))

    def measurements(self, message: Any, receive_time_ns: int) -> tuple[Measurement, ...]:
        """A pymavlink message of this boat and its receipt -> its facts; none from a duplicate."""
        found: list[Measurement] = []
        for rule in RULES.get(message.get_type(), ()):
            if instance_of(message, rule, rule.number) == rule.number:
                found += self._facts(message, rule, receive_time_ns)
        return tuple(found)

    def _facts(self, message: Any, rule: Rule, receive: int) -> list[Measurement]:
        vehicle, verdict = self.clock.stamp(
            STREAM[rule.source], rule.counter, counter_us(message, rule), receive
        )
        if verdict in (Verdict.DUPLICATE, Verdict.UNPLACED):
            return []
        facts = [(q, tuple(float(value) for value in values)) for q, values in rule.facts(message)]
        return [
            Measurement(quantity, rule.source, vehicle, receive, values)
            for quantity, values in facts
            if quantity is Quantity.ACTUATORS or all(value == value for value in values)
        ]


def counter_us(message: Any, rule: Rule) -> int:
    """The boat's counter in µs; 0 where the message has none."""
    raw = int(getattr(message, rule.field, 0)) if rule.field else 0
    return min(raw, UNIX_FROM_US) * (1000 if rule.counter == Counter.BOOT_MS else 1)
