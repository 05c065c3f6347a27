"""Who is due when: each message has an interval and a moment at which it is due next.

Messages to frames, signed where there is a key; and fields that hold nonsense.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from numpy.random import Generator
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gateway.simulated_boat.settings import Rates
from gateway.simulated_boat.telemetry import MESSAGES, Message

SPREAD = 0.618034  # successive streams start at phases that never meet
SLACK = 1e-6  # s, for sums of binary fractions


class Stream(NamedTuple):
    """Interval [s] (infinite: once) and when it is due next [s since play began]."""

    interval: float
    due: float


Streams = Mapping[str, Stream]  # in the order of `MESSAGES`


def started(rates: Rates, now: float) -> Streams:
    """All streams from a moment on, spread over their intervals; the heartbeat comes first."""
    order = [name for name in MESSAGES if name in rates]
    return {
        name: Stream(1.0 / rates[name], now + (i * SPREAD % 1.0) / rates[name])
        for i, name in enumerate(order)
    }


def due(streams: Streams, now: float) -> list[str]:
    """What is to be sent at this moment."""
    return [name for name, stream in streams.items() if stream.due <= now + SLACK]


def moved_on(streams: Streams, names: list[str], now: float) -> Streams:
    """The same streams after these have been sent; one that cannot keep up skips."""
    after = dict(streams)
    for name in names:
        interval, was = streams[name]
        following = was + interval
        after[name] = Stream(interval, following if following > now else now + interval)
    return {name: stream for name, stream in after.items() if stream.due < math.inf}


def asked(streams: Streams, name: str, interval: float, now: float) -> Streams:
    """One stream at another interval [s], 0 for none; once at once."""
    after = {**streams, name: Stream(interval, now)} if interval > 0.0 else dict(streams)
    if interval <= 0.0:
        after.pop(name, None)
    return {key: after[key] for key in MESSAGES if key in after}


def once(streams: Streams, name: str, now: float) -> Streams:
    """One message now; its stream goes on from here."""
    interval = streams[name].interval if name in streams else math.inf
    return asked(streams, name, interval, now)


SIGNING_EPOCH_S = 1_420_070_400  # 1 January 2015
CLOCKS = ("time_boot_ms", "time_usec", "time_unix_usec")  # not touched: another kind of fault
ABSURD = (float("nan"), float("inf"), 1e30)
EXTREMES = {
    "uint8_t": 255, "int8_t": -128, "uint16_t": 65535, "int16_t": -32768,
    "uint32_t": 4294967295, "int32_t": -2147483648,
}  # fmt: skip


class Speaker:
    """Gives frames their address, number and signature; holds pymavlink's packer, no state."""

    def __init__(self, system: int, component: int, key: bytes | None, unix_s: float) -> None:
        self._mav = mavlink.MAVLink(None, system, component)
        self._since = round((unix_s - SIGNING_EPOCH_S) * 1e5)  # units of 10 µs
        if key is not None:
            self._mav.signing.secret_key = key
            self._mav.signing.link_id = 0
            self._mav.signing.sign_outgoing = True

    def frame(self, message: Message, number: int) -> bytes:
        """The `number`-th frame of this speaker."""
        self._mav.seq = number % 256
        self._mav.signing.timestamp = self._since + number
        return bytes(message.pack(self._mav))


def spoiled(message: Message, dice: Generator) -> Any:
    """The same message with a value in one field that no boat has."""
    names = [
        (name, kind)
        for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True)
        if name not in CLOCKS and (kind in EXTREMES or kind == "float")
        and isinstance(getattr(message, name), int | float)
    ]  # fmt: skip
    if names:
        name, kind = names[int(dice.integers(len(names)))]
        value = ABSURD[int(dice.integers(3))] if kind == "float" else EXTREMES[kind]
        setattr(message, name, value)
    return message
