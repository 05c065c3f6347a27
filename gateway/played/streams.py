"""Who is due when: each message has an interval and a moment at which it is due next."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from gateway.played.settings import Rates
from gateway.played.telemetry import MESSAGES

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
