"""Message streams: each has an interval and a moment at which it is due next.

Messages to frames, signed where there is a key; and fields with invalid values.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from numpy.random import Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.simulated_boat.settings import Rates
from gateway.simulated_boat.telemetry import MESSAGES, Message

PHASE_STEP = 0.618034  # of successive streams: a golden ratio, so that their phases never meet
TOLERANCE_S = 1e-6  # for sums of binary fractions


class Stream(NamedTuple):
    """Interval [s] (infinite: once) and when it is due next [s since the start]."""

    interval: float
    due: float


Streams = Mapping[str, Stream]  # in the order of `MESSAGES`


def start_streams(rates: Rates, now: float) -> Streams:
    """All streams from a moment on, spread over their intervals; the heartbeat comes first."""
    order = [name for name in MESSAGES if name in rates]
    return {
        name: Stream(1.0 / rates[name], now + (i * PHASE_STEP % 1.0) / rates[name])
        for i, name in enumerate(order)
    }


def due_messages(streams: Streams, now: float) -> list[str]:
    """Names of the messages to send at this moment."""
    return [name for name, stream in streams.items() if stream.due <= now + TOLERANCE_S]


def after_sending(streams: Streams, names: list[str], now: float) -> Streams:
    """The streams after these messages were sent; one that cannot keep up skips."""
    after = dict(streams)
    for name in names:
        interval, was_due = streams[name]
        next_due = was_due + interval
        after[name] = Stream(interval, next_due if next_due > now else now + interval)
    return {name: stream for name, stream in after.items() if stream.due < math.inf}


def with_interval(streams: Streams, name: str, interval: float, now: float) -> Streams:
    """One stream at another interval [s] from now on; 0 ends it."""
    after = {**streams, name: Stream(interval, now)} if interval > 0.0 else dict(streams)
    if interval <= 0.0:
        after.pop(name, None)
    return {key: after[key] for key in MESSAGES if key in after}


def with_one_message(streams: Streams, name: str, now: float) -> Streams:
    """One message now; its stream goes on from here."""
    interval = streams[name].interval if name in streams else math.inf
    return with_interval(streams, name, interval, now)


SIGNING_EPOCH_S = 1_420_070_400  # 1 January 2015
CLOCKS = ("time_boot_ms", "time_usec", "time_unix_usec")  # left alone: another kind of fault
INVALID_FLOATS = (float("nan"), float("inf"), 1e30)
EXTREME_INTEGERS = {
    "uint8_t": 255, "int8_t": -128, "uint16_t": 65535, "int16_t": -32768,
    "uint32_t": 4294967295, "int32_t": -2147483648,
}  # fmt: skip


class FramePacker:
    """Packs messages with address, number and signature; holds pymavlink's packer, no state."""

    def __init__(self, system: int, component: int, key: bytes | None, unix_s: float) -> None:
        self._mav = mavlink.MAVLink(None, system, component)
        self._since = round((unix_s - SIGNING_EPOCH_S) * 1e5)  # units of 10 µs
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.link_id = 0
            self._mav.signing.sign_outgoing = True

    def frame(self, message: Message, number: int) -> bytes:
        """The `number`-th frame of this sender."""
        self._mav.seq = number % 256
        self._mav.signing.timestamp = self._since + number
        return bytes(message.pack(self._mav))


def with_invalid_field(message: Message, rng: Generator) -> Any:
    """The same message, one field of it with a value that no boat has."""
    names = [
        (name, kind)
        for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True)
        if name not in CLOCKS and (kind in EXTREME_INTEGERS or kind == "float")
        and isinstance(getattr(message, name), int | float)
    ]  # fmt: skip
    if names:
        name, kind = names[int(rng.integers(len(names)))]
        value = INVALID_FLOATS[int(rng.integers(3))] if kind == "float" else EXTREME_INTEGERS[kind]
        setattr(message, name, value)
    return message
