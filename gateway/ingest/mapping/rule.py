"""What a line of the mapping table says: which message, which clock, which rows, which function.

A mapping function takes one message (attributes are scalars) or all messages of one name
(attributes are columns) and returns facts: pairs of a quantity and its values, in SI units. A
value that the boat did not give is NaN: sentinels, scales and units end here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from gateway.samples import Quantity

Column = Any  # a scalar or a (K,) array: mapping functions do not ask which
Facts = tuple[tuple[Quantity, tuple[Column, ...]], ...]


class Counter(IntEnum):
    """What a message says about the boat's time, and where it says it."""

    RECEIPT = 0  # nothing: the moment follows from the receipt
    BOOT_MS = 1  # time_boot_ms: uint32, ms since boot, at sending
    BOOT_US = 2  # time_usec or TimeUS: uint64, µs since boot, at sending
    BOOT_US32 = 3  # time_usec that is, or may be, a uint32: wraps every 71.6 minutes
    SAMPLE_US = 4  # time_usec: uint64, µs since boot at the measurement, which may be old


COUNTER_FIELD = {
    Counter.BOOT_MS: "time_boot_ms",
    Counter.BOOT_US: "time_usec",
    Counter.BOOT_US32: "time_usec",
    Counter.SAMPLE_US: "time_usec",
}


@dataclass(frozen=True)
class Rule:
    """How one message (or some of its instances) becomes samples of `source`."""

    message: str
    facts: Callable[[Any], Facts]
    counter: Counter
    source: str = ""  # default: the message's name
    instance: tuple[str, ...] = ()  # names under which the definitions number instances
    number: int = 0  # the instance that counts
    field: str = ""  # field of the counter; default by `COUNTER_FIELD`

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", self.source or self.message)
        object.__setattr__(self, "field", self.field or COUNTER_FIELD.get(self.counter, ""))


def known(value: Column, sentinel: float) -> Column:
    """The value as float, NaN where it is the sentinel that stands for "not known"."""
    value = np.asarray(value, dtype=np.float64)
    return np.where(value == sentinel, np.nan, value)


def only_where(condition: Column, value: Column) -> Column:
    """The value as float, NaN where the condition does not hold."""
    return np.where(condition, np.asarray(value, dtype=np.float64), np.nan)


def optional(message: Any, name: str, default: float = np.nan) -> Column:
    """A field that older definitions lack."""
    return getattr(message, name, default)


def instance_of(message: Any, rule: Rule, unnamed: int) -> Column:
    """Number of the instance that a message (or each row) speaks of."""
    for name in rule.instance:
        if hasattr(message, name):
            return getattr(message, name)
    return unnamed
